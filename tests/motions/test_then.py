"""Two motions as one: samples, time steps, and the arch that both of them shake."""

import numpy as np
import pytest

import archfrag as af
from archfrag.errors import InputError


def wave(n: int, dt: float, amplitude: float = 3.0, **more) -> af.Motion:
    time = np.arange(n) * dt
    samples = amplitude * np.sin(9.0 * time) * np.sin(np.pi * time / time[-1])
    return af.Motion(samples, dt, **more)


def test_samples_of_equal_steps_stay_to_the_bit():
    first = wave(150, 0.01, id="a")
    second = wave(200, 0.01, 2.0, id="b", metadata={"event": "B"})
    both = first.then(second, gap=0.5)
    assert np.array_equal(both.acceleration[:150], first.acceleration)
    assert not both.acceleration[150:200].any()
    assert np.array_equal(both.acceleration[200:], second.acceleration)
    assert (both.id, both.dt, both.record_start) == ("a+b", 0.01, 2.0)
    assert both.metadata["event"] == "B"
    assert np.array_equal(
        first.then(second, 0.0).acceleration[150:], second.acceleration
    )


@pytest.mark.parametrize(("one", "two"), [(0.01, 0.004), (0.004, 0.01), (0.005, 0.02)])
def test_other_steps_are_interpolated_as_in_a_simulation(one, two):
    first = wave(150, one)
    second = wave(150, two, 2.0)
    both = first.then(second, gap=1.0)
    assert both.dt == min(one, two)
    begins = both.record_start
    assert begins == pytest.approx(first.duration + 1.0, abs=1.5 * both.dt)
    for motion, start in ((first, 0.0), (second, begins)):
        time = np.arange(int(motion.duration / both.dt) + 1) * both.dt
        found = np.interp(start + time, both.time, both.acceleration)
        np.testing.assert_allclose(
            found, np.interp(time, motion.time, motion.acceleration), atol=1e-9
        )


def test_a_missing_vertical_is_zero():
    up = 0.1 * np.ones(100)
    both = wave(100, 0.01, vertical=up).then(wave(100, 0.01), gap=1.0)
    assert np.array_equal(both.vertical[:100], up)
    assert not both.vertical[100:].any()
    assert wave(100, 0.01).then(wave(100, 0.01)).vertical is None


@pytest.mark.parametrize("gap", [-1.0, np.inf, np.nan])
def test_a_gap_that_is_no_time_is_refused(gap):
    with pytest.raises(InputError, match=r"gap = .* s must be a time from 0 upwards"):
        wave(100, 0.01).then(wave(100, 0.01), gap)


@pytest.mark.parametrize(
    ("first", "second", "falls"), [(3.8, -3.5, False), (5.0, -5.0, True)]
)
def test_an_arch_keeps_what_the_first_motion_left(first, second, falls):
    """The same as two runs of which the second begins where the first one ended."""
    arch = af.Arch.circular(5.0, 1.2, 157.5, voussoirs=7, friction=0.35)
    one = wave(400, 0.01, first)
    two = wave(300, 0.01, second)
    both = af.simulate(arch, one.then(two), history=True)
    before = af.simulate(arch, one, history=True).history
    end = np.column_stack(
        [part.values[-1] for part in (before.displacement, before.rotation)]
    )
    after = af.simulate(arch, two, initial=(end, np.zeros_like(end)), history=True)
    alone = af.simulate(arch, two, history=True)
    assert (both.collapsed, after.collapsed, alone.collapsed) == (falls, falls, False)
    left = [run.history.displacement.values[-1] for run in (both, after, alone)]
    assert left[0] == pytest.approx(left[1], abs=2e-3)
    assert np.abs(left[0] - left[2]).max() > 0.1
