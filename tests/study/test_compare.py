"""Arches, classes and arches of two studies compared motion by motion."""

import numpy as np
import pytest

from archfrag.errors import FitError, InputError
from archfrag.fragility.risk import HazardCurve
from archfrag.study.answer.compare import compare
from archfrag.study.answer.curves import Fitted, class_curve, curve_of, runs_of_cube
from tests.report import synthetic

HAZARD = HazardCurve(
    np.geomspace(0.5, 20.0, 6), 1e-3 * np.geomspace(0.5, 20.0, 6) ** -2.0
)
NAMES = ("before-1", "before-2", "after-1", "after-2")


@pytest.fixture(scope="module")
def cube():
    """Two classes of two arches each, the second 1.5 times as strong."""
    data = synthetic.cube(NAMES, synthetic.motions(12), n_level=15)
    generator = np.random.default_rng(8)
    record = generator.standard_normal((1, 12, 1))
    own = generator.standard_normal((4, 12, 1))
    theta = np.array([2.0, 2.4, 3.0, 3.6])[:, None, None]
    capacity = theta * np.exp(0.35 * record + 0.1 * own)
    verdict = (capacity < data["intensity"].values).astype(np.int8)
    return data.assign(
        verdict=(data["verdict"].dims, verdict),
        arch_class=("arch", ["before", "before", "after", "after"]),
        arch_friction=("arch", [0.5, 0.6, 0.5, 0.6]),
        measure=["PGA", "PGV"],
        record_measure=(("record", "measure"), np.ones((12, 2))),
    )


def curves_of(cube):
    arches = {name: curve_of(runs, 0.9) for name, runs in runs_of_cube(cube).items()}
    classes = {}
    for name, runs in runs_of_cube(
        cube, dict.fromkeys(cube["arch_class"].values)
    ).items():
        members = [arches[arch] for arch in runs.cube["arch"].values]
        classes[name] = class_curve(curve_of(runs, 0.9), members)
    return Fitted(arches, classes, cube)


def compared(cube, *names, other=None):
    one = curves_of(cube)
    return compare([one, one if other is None else curves_of(other)], names, HAZARD)


def test_classes_are_compared_as_their_arches_are(cube):
    found = compared(cube, "before", "after")
    each = compared(cube, "before-1", "after-1")
    for row, least, most in (("theta", 1.3, 1.7), ("rate", 0.2, 0.8)):
        assert (
            least
            < found[row]["lower"]
            < found[row]["ratio"]
            < found[row]["upper"]
            < most
        )
        assert found[row]["ratio"] == pytest.approx(each[row]["ratio"], rel=0.1)
    assert compared(cube, "before-1", "after-2") != each


def test_arches_of_two_studies_on_the_same_motions(cube):
    both = compared(cube, "before", "after")
    parts = cube.isel(arch=[0, 1]), cube.isel(arch=[2, 3], record=np.arange(12)[::-1])
    ratios = compare([*map(curves_of, parts)], ("before", "after"), HAZARD)
    assert ratios == both


def test_what_cannot_be_compared_is_refused(cube):
    def scaled(part):
        return part.assign(record_measure=1.01 * part["record_measure"])

    renamed = cube.assign_coords(record=[f"other{i}" for i in range(12)])
    swapped = cube.assign(arch_friction=("arch", [0.5, 0.6, 0.6, 0.5]))
    pgv = cube.assign(intensity=cube["intensity"].assign_attrs(measure="PGV"))
    upright = cube.assign(record_vertical=1 + cube["record_vertical"])
    for other, message in (
        (scaled(cube), "motions differ: .* is not the same in both"),
        (upright, "motions differ: .* is not the same in both"),
        (renamed, "is in one of them only"),
        (pgv, "levels are of PGA and of PGV"),
        (
            swapped,
            "before and after cannot be compared: their samples of friction differ",
        ),
    ):
        with pytest.raises(InputError, match=message):
            compared(cube, "before", "after", other=other)
    with pytest.raises(InputError, match="they have 2 and 1 arches"):
        compared(cube, "before", "after-1")
    with pytest.raises(InputError, match="there is no arch or class 'none'"):
        compared(cube, "before", "none")
    stands = cube.assign(verdict=0 * cube["verdict"])
    with pytest.raises(FitError, match="after has no curve: nothing bounds theta"):
        compared(cube, "before", "after", other=stands)


class TestAlike:
    """Rows that are alike in more than their earthquake."""

    @pytest.fixture
    def shaken(self):
        """An arch before and after first shocks, three in turn over 24 records."""
        data = synthetic.cube(("ring", "ring-after"), synthetic.motions(24), n_level=15)
        generator = np.random.default_rng(2)
        turn = np.arange(24) % 4
        record = generator.standard_normal((1, 24, 1))
        shock = generator.standard_normal(4)[turn]
        change = np.stack([0.0 * shock, -0.2 + 0.25 * shock])[:, :, None]
        capacity = 3.0 * np.exp(0.35 * record + change)
        verdict = (capacity < data["intensity"].values).astype(np.int8)
        return data.assign(
            verdict=(data["verdict"].dims, verdict),
            first_shock=("arch", [0.0, 2.0]),
            arch_class=("arch", ["ring", "ring-after"]),
            first_event=("record", turn.astype(str)),
            measure=["PGA", "PGV"],
            record_measure=(("record", "measure"), np.ones((24, 2))),
        )

    def test_a_ratio_after_first_shocks_is_as_wide_as_few_of_them_ask(self, shaken):
        found = compared(shaken, "ring", "ring-after")["theta"]
        every = shaken.assign(first_event=("record", np.arange(24).astype(str)))
        alone = compared(every, "ring", "ring-after")["theta"]
        assert found["ratio"] == pytest.approx(alone["ratio"], rel=0.01)
        widths = [np.log(each["upper"] / each["lower"]) for each in (found, alone)]
        assert widths[0] > 1.8 * widths[1]

    def test_two_first_shocks_have_no_interval(self, shaken):
        few = shaken.assign(first_event=("record", (np.arange(24) % 2).astype(str)))
        with pytest.raises(
            FitError, match="of 2 independent motions, earthquakes, first shocks"
        ):
            compared(few, "ring", "ring-after")

    def test_a_curve_after_first_shocks_counts_fewer_records(self, shaken):
        one, two = curves_of(shaken).arches.values()
        assert one.n_independent == 24.0
        assert two.n_independent < 14.0
        assert "Capacities within first shocks resemble each other" in two.assumptions

    def test_a_sample_of_a_stock_has_the_curve_of_all_its_runs(self, cube):
        stock = cube.assign(stock_row=("arch", list(NAMES)))
        runs = runs_of_cube(stock, ["before", "before-1"])
        assert {*runs["before"].groups} == {"record", "row"}
        assert not runs["before-1"].groups
        pooled = curve_of(runs["before"], 0.9)
        exactly = curve_of(runs_of_cube(cube, ["before"])["before"], 0.9)
        assert pooled.n_independent < 0.7 * exactly.n_independent
        members = list(curves_of(cube).arches.values())[:2]
        own = class_curve(pooled, members, stock=True)
        assert (own.theta, own.beta, own.members) == (pooled.theta, pooled.beta, None)
        assert own.assumptions.startswith("Its 2 arches are a sample of a larger stock")
        assert class_curve(exactly, members).members is not None

    def test_records_of_a_stock_are_alike_by_earthquake(self, cube):
        stock = cube.assign(
            stock_row=("arch", list(NAMES)),
            event=("record", (np.arange(12) // 2).astype(str)),
        )
        assert {*runs_of_cube(stock, ["after"])["after"].groups} == {"event", "row"}
