"""Rates of collapse of a study: of all designs, and by the command."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from archfrag.fragility.curve import Fragility
from archfrag.fragility.risk import HazardCurve
from archfrag.study.answer.fits import FITS
from archfrag.study.answer.risk import risk_facts, risk_of, risk_text
from archfrag.study.file.hazard import Hazard
from archfrag.study.files import write_text
from archfrag.study.steps import finish
from tests.report.synthetic import answers_of, cube, motions
from tests.study.small import command, made, small_study

IM = np.geomspace(0.2, 20.0, 12)
CURVE = HazardCurve(IM, 2e-3 * IM**-2.0)
HAZARD = Hazard("PGA", "made up", {"mean": CURVE, "0.84": HazardCurve(IM, 4e-3 * IM**-2.0)})


@pytest.fixture(scope="module")
def grid():
    data = cube(items=motions(30))
    return data, {"ring": answers_of(data)["ring"].curve}


class TestGrid:
    def test_rate_is_the_closed_form_and_twice_it_with_twice_the_hazard(self, grid):
        data, fits = grid
        found = risk_of(data, fits, HAZARD).arches["ring"]
        fit = fits["ring"]
        exact = 2e-3 * fit.theta**-2.0 * np.exp(2.0 * fit.beta**2)
        assert found.rate.rate == pytest.approx(exact, rel=1e-9)
        assert found.by_curve["0.84"] == pytest.approx(2.0 * found.rate.rate, rel=1e-12)
        assert found.rate.lower < found.rate.rate < found.rate.mean < found.rate.upper

    def test_everything_adds_up_to_the_rate(self, grid):
        found = risk_of(*grid, HAZARD).arches["ring"]
        rate = found.rate.rate
        assert found.level_rate.sum() == pytest.approx(rate, rel=1e-12)
        for split in found.splits.values():
            assert split.rate.sum() + split.unassigned.sum() == pytest.approx(rate, rel=1e-12)
            assert split.counts.sum() == (grid[0]["verdict"].values == 1).sum()

    def test_a_mechanism_seen_once_is_told_without_a_band(self, grid):
        data, fits = grid
        collapsed = data["verdict"].values == 1
        once = collapsed & (np.cumsum(collapsed).reshape(collapsed.shape) == 1)
        joint = data["collapse_joint"].dims, np.where(once, 7, np.where(collapsed, 2, -1))
        mode = data["collapse_mode"].dims, collapsed.astype(np.int8)
        data = data.assign(collapse_joint=joint, collapse_mode=mode)
        study = SimpleNamespace(intensity=SimpleNamespace(factor=9.80665, unit="g"))
        facts = risk_facts(risk_of(data, fits, HAZARD), study)
        assert [part["collapses"] == 1 for part in facts["arches"]["ring"]["by_mechanism"]] == [
            False, True
        ]  # fmt: skip
        (line,) = [line for line in risk_text(facts).splitlines() if "joint 7" in line]
        assert line.endswith(", 1 collapse")

    def test_short_hazard_curve_is_cautioned(self, grid):
        short = Hazard("PGA", "made up", {"mean": HazardCurve([0.2, 1.0], [0.05, 2e-3])})
        found = risk_of(*grid, short).arches["ring"]
        assert found.rate.above > 0.9
        assert found.rate.quoted == pytest.approx(found.rate.rate * (1.0 - found.rate.above))
        assert np.isnan([found.rate.mean, found.rate.lower, found.rate.upper]).all()
        assert found.cautions[0].startswith("most of the rate is from outside the hazard curve")
        assert any("above the last point of the hazard curve" in each for each in found.cautions)
        assert not risk_of(*grid, HAZARD).arches["ring"].rate.outside > 0.05


class TestDesigns:
    def test_bisected_records_give_the_fractions_of_the_full_grid(self):
        """A study of monotone records: what the bisection leaves out follows from the others."""
        generator = np.random.default_rng(5)
        data = cube(items=motions(30))
        levels = data["intensity"].values
        capacity = 4.0 * np.exp(0.4 * generator.standard_normal((30, 1)))
        full = (capacity < levels).astype(np.int8)
        joint = np.where(full == 1, generator.integers(0, 8, (30, 1)), -1)
        first = np.argmax(full, axis=1)[:, None]
        place = np.arange(levels.size)
        bisected = np.where(
            (place == first) | (place == first - 1) | ((full == 0) & (place % 3 == 0)), full, 4
        )
        fit = Fragility(4.0, 0.4, np.diag([0.005, 0.003]), 0.0, 9, 270, "stripes")
        found = []
        for verdict in (full, bisected):
            seen = np.where(verdict == 1, joint, -1)
            made = data.assign(
                verdict=(data["verdict"].dims, verdict[None].astype(np.int8)),
                collapse_joint=(data["verdict"].dims, seen[None]),
                collapse_mode=(data["verdict"].dims, (verdict == 1)[None].astype(np.int8)),
            )
            found.append(risk_of(made, {"ring": fit}, HAZARD).arches["ring"].splits["mechanism"])
        assert (bisected == 4).any()
        assert found[0].categories == found[1].categories
        np.testing.assert_array_equal(found[0].rate, found[1].rate)

    def test_runs_each_at_an_intensity_of_its_own(self, grid):
        data, fits = grid
        generator = np.random.default_rng(6)
        at = np.exp(generator.uniform(0.0, 2.0, (1, 30, 1)))
        dims = ("arch", "record", "level")
        one = data.isel(level=[4]).drop_vars("intensity")
        verdict = (4.0 * np.exp(0.4 * generator.standard_normal(at.shape)) < at).astype(np.int8)
        one = one.assign(
            intensity=(dims, at, {"units": "m s-2", "measure": "PGA"}),
            verdict=(dims, verdict),
            collapse_joint=(dims, np.where(verdict == 1, 2, -1)),
        )
        found = risk_of(one, fits, HAZARD).arches["ring"]
        assert found.splits["mechanism"].counts.sum() == verdict.sum()
        assert found.level_rate.sum() == pytest.approx(found.rate.rate, rel=1e-12)
        assert found.levels[0] > at.min()
        assert found.levels[-1] < at.max()


def with_curves(study, **curves):
    """Put other curves of arches into the fits of a study, which stay up to date."""
    made_up = json.loads((study.folder / FITS).read_text())
    for name, curve in curves.items():
        made_up["arches"][name]["curve"] = curve
    write_text(study.folder / FITS, json.dumps(made_up))
    finish(study, "fit")


class TestCommand:
    @pytest.fixture
    def asked(self, tmp_path):
        """Arguments of the command for a finished study with a made-up curve; the study."""
        study = made(small_study(tmp_path)).study
        curve = Fragility(5.0, 0.4, np.diag([0.01, 0.005]), 0.0, 3, 6, "stripes")
        with_curves(study, ring=curve.to_dict())
        hazard = tmp_path / "hazard.csv"
        hazard.write_text("PGA [g],rate,rate_0.84\n0.01,0.1,0.2\n0.1,1e-2,2e-2\n3,1e-5,2e-5\n")
        return ("risk", tmp_path / "small.yaml", "--hazard", hazard), study

    def test_json(self, asked):
        result = command(*asked[0], "--json", "--years", 100)
        assert result.exit_code == 0, result.output
        for option, value in (("years", 0), ("confidence", 2), ("confidence", "nan")):
            assert command(*asked[0], f"--{option}", value).exit_code == 2
        facts = json.loads(result.stdout)
        ring = facts["arches"]["ring"]
        assert ring["probability"] == pytest.approx(1.0 - np.exp(-100.0 * ring["rate"]))
        assert ring["theta"] == pytest.approx(5.0 / 9.80665)
        assert ring["rate_by_hazard_curve"]["0.84"] == pytest.approx(2.0 * ring["rate"])
        assert sum(ring["rate_by_level"]) == pytest.approx(ring["rate"])
        assert facts["hazard"]["curves"]["mean"]["im"] == pytest.approx([0.01, 0.1, 3.0])

    def test_no_curve_at_all(self, asked):
        arguments, study = asked
        none = {"none": "nothing fell"}
        with_curves(study, ring=none, slab=none)
        result = command(*arguments)
        assert result.exit_code == 6
        assert "ring: no rate, since there is no curve: nothing fell" in result.stdout
        assert result.stderr == "archfrag: error: no arch has a curve, so there is no rate\n"
