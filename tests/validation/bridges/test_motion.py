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
from tests.validation.scenes import g, pulse, sampled
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
PEAKS = [
    ("two", "half sine of 0.25 s", 0.52, 0.01145, 0.1370),
    ("two", "half sine of 0.5 s", 0.33, 0.08852, 0.6865),
    ("two", "half sine of 1 s", 0.24, 0.03316, 0.7960),
    ("two", "sine of 0.5 s", 0.34, 0.01982, 0.3405),
    ("two", "sine of 1 s", 0.24, 0.00785, 0.4175),
    ("two", "steps of 0.3 s", 0.23, 0.01683, 0.3335),
    ("three", "half sine of 0.25 s", 0.52, 0.07401, 0.3115),
    ("three", "half sine of 0.5 s", 0.33, 0.04045, 0.3965),
    ("three", "half sine of 1 s", 0.25, 0.04208, 0.9855),
    ("three", "sine of 0.5 s", 0.33, 0.00964, 0.1980),
    ("three", "sine of 1 s", 0.25, 0.00892, 0.4985),
    ("three", "steps of 0.3 s", 0.24, 0.01992, 0.3565),
]


@pytest.mark.parametrize(("bridge", "name", "factor", "expected", "impact"), PEAKS)
def test_displacement_until_the_first_impact(bridge, name, factor, expected, impact):
    chain = chain_of(*BRIDGES[bridge])
    time, shift = displacements(chain, PULSES[name], factor)
    until = np.append(shift[time < impact], np.interp(impact, time, shift))
    assert until.max() == pytest.approx(expected, rel=0.01)


@pytest.mark.slow
def test_displacements_are_those_of_contact_dynamics():
    for bridge, name, factor, expected, impact in PEAKS:
        found = contact_dynamics(
            chain_of(*BRIDGES[bridge]), PULSES[name], factor, follow=0.3
        )
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
    "bridges", [3, pytest.param(25, marks=pytest.mark.slow, id="25 bridges")]
)
def test_random_bridges_under_records(bridges):
    """Four levels each: no run is refused, energy closes, and bodies do not overlap."""
    record = af.read_motion(RECORD)
    generator = np.random.default_rng(55)
    for _ in range(bridges):
        friction = generator.uniform(0.5, 0.9)
        chain = chain_of(**random_bridge(generator), friction=friction)
        level = onset_by_programme(chain) * np.array([1.2, 1.8, 2.7, 4.0])
        options, found = run_many(chain, record * (g / record.pga), level, follow=60.0)
        assert np.isin(found.status, (Status.STANDING, Status.COLLAPSED)).all()
        energy = found.energy.T
        parts = [Energy.GROUND, Energy.FRICTION, Energy.IMPACT, Energy.BALANCE_ERROR]
        gained = energy[[Energy.KINETIC, Energy.POTENTIAL]].sum(axis=0)
        scale = energy[Energy.LARGEST_KINETIC]
        assert (np.abs(energy[parts].sum(axis=0) - gained) <= 1e-6 * scale).all()
        assert (energy[Energy.BALANCE_ERROR_PEAK] <= 1e-2 * scale).all()
        assert (found.peak[:, Peak.OVERLAP] <= 1e-4).all()
        assert is_accurate(chain, options, found).all()


def test_wide_piers_leave_each_span_alone():
    """Its displacement is that of the same span between grounds."""
    ring = arc(2.5, 0.5, 9)
    pulse = PULSES["half sine of 0.5 s"]
    alone = run_many(chain_of([ring], []), pulse, [0.36, 0.44])[1]
    stiff = arc(2.5, 1.0, 3)
    for k in range(3):
        rings = [ring if i == k else stiff for i in range(3)]
        chain = chain_of(rings, [Pier(150.0, 4.0, 1)] * 2)
        found = run_many(chain, pulse, [0.36, 0.44])[1]
        column = Peak.DISPLACEMENT
        assert found.peak[:, column] == pytest.approx(alone.peak[:, column], rel=1e-4)


def test_mirror_images():
    """Where impacts do not follow each other until last bits count."""
    rings, piers = BRIDGES["three"]
    bridges = chain_of(rings, piers), chain_of(rings[::-1], piers[::-1])
    for name, factor in (("half sine of 0.5 s", 0.3), ("half sine of 1 s", 0.24)):
        one, other = (
            run_many(chain, PULSES[name], [sense * factor])[1].peak[0]
            for chain, sense in zip(bridges, (1.0, -1.0))
        )
        column = Peak.DISPLACEMENT
        assert one[column] == pytest.approx(other[column], rel=1e-6)
