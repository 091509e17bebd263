"""Four runs side by side: each as it would be alone, whatever stands beside it."""

from pathlib import Path

import numpy as np
import pytest

import archbench  # noqa: F401  registers the baselines
import archfrag as af
from archfrag.errors import InputError
from archfrag.motions.index import load_index
from archfrag.motions.read import load_motion

RECORDS = Path(__file__).parents[2] / "records" / "index.csv"
G = 9.80665
ARCHES = {
    "seven": af.Arch.circular(10.0, 1.5, 157.5, voussoirs=7, friction=0.7),
    "sliding": af.Arch.circular(10.0, 2.5, 140.0, voussoirs=9, friction=0.35),
    "rough": af.Arch.circular(2.5, 0.5, 140.0, voussoirs=5, friction=np.inf),
    "block": af.Block(0.6, 1.8, friction=0.4),
    "many": af.Arch.circular(10.0, 1.5, 157.5, voussoirs=27, friction=0.7),
}
TOP = {"seven": 3.0, "sliding": 4.0, "rough": 4.0, "block": 1.5, "many": 2.0}


def motions(count):
    """Shipped records, every other one with the next as its vertical component."""
    found = [load_motion(record) for record in load_index(RECORDS)[: count + 1]]
    mixed = []
    for k, motion in enumerate(found[:count]):
        vertical = None
        if k % 2:
            vertical = 0.6 * np.resize(found[k + 1].acceleration, len(motion.acceleration))
        mixed.append(af.Motion(motion.acceleration, motion.dt, vertical=vertical))
    return mixed


def runs(name, per_motion=4, count=3):
    """Motions and factors of some runs: a motion's levels one after the other."""
    levels = np.linspace(0.15, 1.0, per_motion) * TOP[name]
    given = [(motion, level) for motion in motions(count) for level in levels]
    factors = [level * G / np.abs(motion.acceleration).max() for motion, level in given]
    return [motion for motion, _ in given], factors


def same(one, other):
    return all(
        np.array_equal(one[name].values, other[name].values, equal_nan=one[name].dtype.kind == "f")
        for name in one.data_vars
    )


@pytest.fixture(scope="module", params=ARCHES)
def together(request):
    name = request.param
    given, factors = runs(name)
    return name, given, factors, af.simulate_many(ARCHES[name], given, factors)


class TestARunBesideOthers:
    def test_is_the_run_alone_to_the_last_bit(self, together):
        name, given, factors, many = together
        for k in range(0, len(factors), 2):
            alone = af.simulate(ARCHES[name], given[k], scale=factors[k])
            for field in many.data_vars:
                value, expected = many[field].values[k], getattr(alone, field)
                if field == "status":
                    expected = expected.name.lower()
                assert value == expected or (value != value and expected != expected), (k, field)

    def test_does_not_depend_on_its_neighbours_their_number_or_order(self, together):
        name, given, factors, many = together
        mixed = np.random.default_rng(3).permutation(len(factors))
        for some in (mixed, [2], [2, 3, 4, 5, 6]):
            table = af.simulate_many(
                ARCHES[name], [given[k] for k in some], [factors[k] for k in some]
            )
            assert same(many.isel(run=some), table)

    def test_moves_or_stands_or_falls_as_it_should(self, together):
        # Otherwise the other tests would compare runs in which nothing happens.
        _, _, _, many = together
        assert (many.steps.values > 100).sum() >= 4
        assert set(many.status.values) <= {"standing", "collapsed"}


@pytest.mark.parametrize(
    "options",
    [{"method": "time_stepping", "dt": 1e-3}, {"method": "event_driven"}, {"method": "four_link"}],
)
def test_other_methods_give_the_same_table(options):
    given, factors = runs("seven", per_motion=3, count=1)
    many = af.simulate_many(ARCHES["seven"], given, factors, **options)
    assert many.attrs["method"] == options["method"]
    for k, factor in enumerate(factors):
        alone = af.simulate(ARCHES["seven"], given[k], scale=factor, **options)
        assert many.peak_rotation.values[k] == alone.peak_rotation
        assert many.steps.values[k] == alone.steps
        assert many.collapsed.values[k] == alone.collapsed


def test_one_motion_serves_all_factors():
    motion = motions(1)[0]
    many = af.simulate_many(ARCHES["seven"], motion, [0.1, 0.2])
    assert many.sizes == {"run": 2}
    assert many.factor.values.tolist() == [0.1, 0.2]


@pytest.mark.parametrize(("given", "factors"), [(2, [1.0]), (1, [[1.0], [2.0]])])
def test_motions_and_factors_that_do_not_match_are_refused(given, factors):
    with pytest.raises(InputError, match="one motion for each factor"):
        af.simulate_many(ARCHES["seven"], motions(given), factors)
