"""The ladder's own limits: where it steps over all voussoirs, and where it never does."""

import numpy as np
import pytest

import archfrag as af
from archfrag.errors import InputError
from archfrag.methods.registry import step_of_ladder
from archfrag.simulation.checks import own_time

ARCH = af.Arch.circular(10.0, 1.5, 157.5, voussoirs=7, friction=0.7)
TIME = np.arange(0.0, 1.2, 0.001)
MOTION = af.Motion(6.0 * np.sin(2.0 * np.pi * TIME / 0.4), dt=0.001)


def run(rtol, **settings):
    return af.simulate(ARCH, MOTION, rtol=rtol, settings=settings, history=True)


def test_above_the_coarse_limit_all_voussoirs_are_stepped_by_the_tolerance_s_step():
    coarse = run(0.05)
    stepped = af.simulate(
        ARCH, MOTION, method="time_stepping", dt=own_time(ARCH) * step_of_ladder(0.05),
        history=True,
    )  # fmt: skip
    assert coarse.steps == stepped.steps
    assert np.array_equal(coarse.history.displacement, stepped.history.displacement)
    assert coarse.model_time["all_voussoirs"] > 0.0
    assert coarse.model_time["mega_voussoirs"] == coarse.model_time["four_hinges"] == 0.0
    assert coarse.method == "auto"


def test_below_it_events_are_located_and_a_limit_of_one_never_steps_throughout():
    for rtol, coarse, located in ((0.01, 0.02, True), (0.05, 1.0, True), (0.01, 0.0, False)):
        times = run(rtol, coarse=coarse).model_time
        assert (times["four_hinges"] + times["mega_voussoirs"] > 0.1) == located


def test_the_more_events_are_handed_over_the_longer_all_voussoirs_are_stepped():
    longer = [run(1e-3, hand_over=steps).model_time["all_voussoirs"] for steps in (0.0, 1e6)]
    assert longer[1] > 2.0 * longer[0]


@pytest.mark.parametrize(("name", "value"), [("hand_over", -1.0), ("coarse", 1.5)])
def test_a_limit_that_makes_no_sense_is_refused(name, value):
    with pytest.raises(InputError, match=f"settings.{name} is {value}"):
        run(1e-3, **{name: value})
