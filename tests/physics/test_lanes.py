"""Four runs side by side: each as it would be alone, whatever stands beside it."""

from pathlib import Path

import numpy as np
import pytest

import archbench  # noqa: F401  registers the baselines
import archfrag as af
from archfrag.errors import InputError
from archfrag.motions.index import load_index
from archfrag.motions.read import load_motion
from tests.validation.scenes import g, oppenheim

RECORDS = load_index(Path(__file__).parents[2] / "records" / "index.csv")
# Arches, and the largest peak of their motions [g].
ARCHES = {
    "seven": (oppenheim(), 3.0),
    "sliding": (af.Arch.circular(10.0, 2.5, 140.0, voussoirs=9, friction=0.35), 4.0),
    "rough": (af.Arch.circular(2.5, 0.5, 140.0, voussoirs=5, friction=np.inf), 4.0),
    "block": (af.Block(0.6, 1.8, friction=0.4), 1.5),
    "many": (af.Arch.circular(10.0, 1.5, 157.5, voussoirs=27, friction=0.7), 2.0),
}


def runs(top, levels=4, count=3):
    """Shipped records, the second with a vertical component; levels one after the other."""
    motions = [load_motion(record) for record in RECORDS[: count + 1]]
    if count > 1:
        vertical = 0.6 * np.resize(
            motions[2].acceleration, len(motions[1].acceleration)
        )
        motions[1] = af.Motion(
            motions[1].acceleration, motions[1].dt, vertical=vertical
        )
    given = [
        (motion, peak * g / np.abs(motion.acceleration).max())
        for motion in motions[:count]
        for peak in np.linspace(0.15, 1.0, levels) * top
    ]
    return [motion for motion, _ in given], [factor for _, factor in given]


def assert_alone(arch, many, given, factors, some, **options):
    """Runs of a table have the results that each has alone, to the last bit."""
    for k in some:
        alone = af.simulate(arch, given[k], scale=factors[k], **options)
        for field in many.data_vars:
            value = many[field].values[k]
            expected = getattr(alone, field)
            if field == "status":
                expected = expected.name.lower()
            assert value == expected or (value != value and expected != expected), (
                k,
                field,
            )


@pytest.mark.parametrize("name", ARCHES)
def test_a_run_beside_others_is_the_run_alone_whatever_their_number_or_order(name):
    arch, top = ARCHES[name]
    given, factors = runs(top)
    many = af.simulate_many(arch, given, factors)
    # Otherwise runs in which nothing happens would be compared.
    assert (many.steps.values > 100).sum() >= 4
    assert set(many.status.values) <= {"standing", "collapsed"}
    assert_alone(arch, many, given, factors, range(0, len(factors), 2))
    for some in (
        np.random.default_rng(3).permutation(len(factors)),
        [2],
        [2, 3, 4, 5, 6],
    ):
        table = af.simulate_many(
            arch, [given[k] for k in some], [factors[k] for k in some]
        )
        assert many.isel(run=some).equals(table)


@pytest.mark.parametrize(
    "options",
    [
        {"method": "time_stepping", "dt": 1e-3},
        {"method": "event_driven"},
        {"method": "four_link"},
    ],
)
def test_other_methods_give_the_same_table(options):
    arch, top = ARCHES["seven"]
    given, factors = runs(top, levels=3, count=1)
    many = af.simulate_many(arch, given, factors, **options)
    assert many.attrs["method"] == options["method"]
    assert_alone(arch, many, given, factors, range(3), **options)


@pytest.mark.parametrize(("given", "factors"), [(2, [1.0]), (1, [[1.0], [2.0]])])
def test_motions_and_factors_that_do_not_match_are_refused(given, factors):
    with pytest.raises(InputError, match="one motion for each factor"):
        af.simulate_many(
            ARCHES["seven"][0], [af.Motion(np.zeros(9), 0.01)] * given, factors
        )
