"""Motion of bridges of several spans: beside contact dynamics written here, and by laws."""

import math

import numpy as np
import pytest

import archfrag as af
from archfrag.physics.shared import is_accurate
from archfrag.physics.status import Energy, Peak, Status
from tests.validation.bridges.chains import (
    Pier,
    arc,
    chain_of,
    onset_by_programme,
    random_bridge,
)
from tests.validation.bridges.dynamics import contact_dynamics
from tests.validation.bridges.runs import displacements, run_many
from tests.validation.scenes import pulse, sampled
from tests.validation.test_histories import RECORD


def sine(duration, periods=0.5):
    """Return a sine of 1 g; without `periods` a half one."""
    return sampled(
        lambda t: np.sin(2.0 * math.pi * periods * t / duration), duration, 1e-3
    )


BRIDGES = {
    "two": ([arc(2.5, 0.5, 9)] * 2, [Pier(1.0, 4.0, 2)]),
    "three": (
        [arc(2.5, 0.5, 9), arc(3.0, 0.6, 8, 160.0), arc(2.0, 0.45, 7)],
        [Pier(1.2, 4.0, 2), Pier(1.0, 3.0, 3, 1.3)],
    ),
}
PULSES = {
    "half sine of 0.25 s": sine(0.25),
    "half sine of 0.5 s": sine(0.5),
    "half sine of 1 s": sine(1.0),
    "sine of 0.5 s": sine(0.5, 1.0),
    "sine of 1 s": sine(1.0, 1.0),
    "steps of 0.3 s": pulse(1.0, 0.3),
}
# Bridge, pulse, factor; by `contact_dynamics` displacement before the first impact [m], and when
# that is [s].
PEAKS = []


@pytest.mark.parametrize(("bridge", "name", "factor", "expected", "impact"), PEAKS)
def test_displacement_until_the_first_impact(bridge, name, factor, expected, impact):
    chain = chain_of(*BRIDGES[bridge])
    time, shift = displacements(chain, PULSES[name], factor)
    until = np.append(shift[time < impact], np.interp(impact, time, shift))
    assert until.max() == pytest.approx(expected, rel=0.01)


@pytest.mark.slow
def test_displacements_are_those_of_contact_dynamics():
    for bridge, name, factor, expected, impact in PEAKS:
        found = contact_dynamics(chain_of(*BRIDGES[bridge]), PULSES[name], factor)
        assert (found.before, found.impact) == pytest.approx((expected, impact), 1e-3)


@pytest.mark.slow
def test_borders_of_collapse_on_a_grid():
    """Of ten, nine are the same multiple of 0.02 g."""
    same = []
    cases = [("two", name) for name in PULSES]
    cases += [("three", name) for name in list(PULSES)[:4]]
    for bridge, name in cases:
        chain = chain_of(*BRIDGES[bridge])
        levels = 0.02 * (math.ceil(onset_by_programme(chain) / 0.02) + np.arange(40))
        _, runs = run_many(chain, PULSES[name], levels)
        first = np.argmax(runs.status == Status.COLLAPSED)
        assert (runs.status[:first] == Status.STANDING).all()
        falls = [
            contact_dynamics(chain, PULSES[name], level, 1e-3).falls
            for level in levels[first - 1 : first + 1]
        ]
        same.append(falls == [False, True])
    assert (len(same), sum(same) >= 9) == (10, True)


@pytest.mark.parametrize(
    "runs", [10, pytest.param(100, marks=pytest.mark.slow, id="100 runs")]
)
def test_random_bridges_under_records(runs):
    """No run is refused, energy is accounted for, and no bodies overlap."""
    record = af.read_motion(RECORD)
    unit = record * (1.0 / (af.Block(1.0, 1.0).chain.gravity * record.pga))
    generator = np.random.default_rng(55)
    ends = set()
    for _ in range(runs):
        given = random_bridge(generator)
        chain = chain_of(**given, friction=generator.uniform(0.5, 0.9))
        level = onset_by_programme(chain) * generator.uniform(1.0, 5.0)
        options, found = run_many(chain, unit, [level])
        ends.add(int(found.status[0]))
        energy = found.energy[0]
        parts = [Energy.GROUND, Energy.FRICTION, Energy.IMPACT, Energy.BALANCE_ERROR]
        gained = energy[Energy.KINETIC] + energy[Energy.POTENTIAL]
        scale = energy[Energy.LARGEST_KINETIC]
        assert energy[parts].sum() == pytest.approx(gained, abs=1e-6 * scale)
        assert energy[Energy.BALANCE_ERROR_PEAK] <= 1e-2 * scale
        assert found.peak[0, Peak.OVERLAP] <= 1e-4
        assert is_accurate(chain, options, found).all()
    assert ends <= {Status.STANDING, Status.COLLAPSED}


def test_wide_piers_leave_each_span_alone():
    """Its displacement is that of the same span between grounds."""
    ring = arc(2.5, 0.5, 9)
    pulse = PULSES["half sine of 0.5 s"]
    alone = run_many(chain_of([ring], []), pulse, [0.36, 0.44])[1]
    stiff = arc(2.5, 1.0, 9)
    for k in range(3):
        rings = [ring if i == k else stiff for i in range(3)]
        chain = chain_of(rings, [Pier(1500.0, 4.0, 2)] * 2)
        found = run_many(chain, pulse, [0.36, 0.44])[1]
        column = Peak.DISPLACEMENT
        assert found.peak[:, column] == pytest.approx(alone.peak[:, column], rel=1e-3)


def test_mirror_images():
    rings, piers = BRIDGES["three"]
    for name in ("half sine of 0.5 s", "sine of 0.5 s"):
        found = [
            run_many(chain_of(*bridge), PULSES[name], [sense * 0.3])[1].peak[0]
            for bridge, sense in (
                ((rings, piers), 1.0),
                ((rings[::-1], piers[::-1]), -1.0),
            )
        ]
        column = Peak.DISPLACEMENT
        assert found[0][column] == pytest.approx(found[1][column], rel=1e-3)
