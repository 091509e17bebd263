"""Rates of collapse of a study: of all designs, and by the command."""

import json

import numpy as np
import pytest

from archfrag.fragility.curve import Fragility
from archfrag.fragility.risk import HazardCurve
from archfrag.study.answer.fits import FITS
from archfrag.study.answer.risk import risk_of
from archfrag.study.file.hazard import Hazard
from archfrag.study.steps import finish
from tests.report.synthetic import answers_of, cube, motions
from tests.study.small import command, made, small_study

IM = np.geomspace(0.2, 20.0, 12)
CURVE = HazardCurve(IM, 2e-3 * IM**-2.0)
HAZARD = Hazard("PGA", "made up", {"mean": CURVE, "0.84": HazardCurve(IM, 4e-3 * IM**-2.0)})
FIT = Fragility(4.0, 0.4, np.diag([0.005, 0.003]), 0.0, 9, 270, "stripes")


@pytest.fixture(scope="module")
def data():
    return cube(items=motions(30))


def with_verdicts(data, verdict, joint):
    """The cube with other verdicts, (n_record, n_level), and joints where the arch collapsed."""
    dims, fell = data["verdict"].dims, verdict == 1
    return data.assign(
        verdict=(dims, verdict[None].astype(np.int8)),
        collapse_joint=(dims, np.where(fell, joint, -1)[None]),
        collapse_mode=(dims, fell[None].astype(np.int8)),
    )


class TestGrid:
    def test_rate_is_the_closed_form_to_which_all_parts_add_up(self, data):
        fit = answers_of(data)["ring"].curve
        found = risk_of(data, {"ring": fit}, HAZARD).arches["ring"]
        rate = found.rate.rate
        assert rate == pytest.approx(2e-3 * fit.theta**-2 * np.exp(2 * fit.beta**2), rel=1e-9)
        assert found.by_curve["0.84"] == pytest.approx(2.0 * rate, rel=1e-12)
        assert found.rate.lower < rate < found.rate.mean < found.rate.upper
        assert found.rate.outside < 0.05
        assert found.level_rate.sum() == pytest.approx(rate, rel=1e-12)
        for split in found.splits.values():
            assert split.rate.sum() + split.unassigned.sum() == pytest.approx(rate, rel=1e-12)
            assert split.counts.sum() == (data["verdict"].values == 1).sum()

    def test_short_hazard_curve_is_cautioned(self, data):
        short = Hazard("PGA", "made up", {"mean": HazardCurve([0.2, 1.0], [0.05, 2e-3])})
        found = risk_of(data, {"ring": FIT}, short).arches["ring"]
        assert found.rate.above > 0.9
        assert found.rate.quoted == pytest.approx(found.rate.rate * (1.0 - found.rate.above))
        assert np.isnan([found.rate.mean, found.rate.lower, found.rate.upper]).all()
        assert found.cautions[0].startswith("most of the rate is from outside the hazard curve")
        assert any("above the last point of the hazard curve" in each for each in found.cautions)


class TestDesigns:
    def test_bisected_records_give_the_fractions_of_the_full_grid(self, data):
        """A study of monotone records: what the bisection leaves out follows from the others."""
        generator, levels = np.random.default_rng(5), data["intensity"].values
        capacity = 4.0 * np.exp(0.4 * generator.standard_normal((30, 1)))
        full = (capacity < levels).astype(int)
        joint = np.broadcast_to(generator.integers(0, 8, (30, 1)), full.shape)
        first, place = np.argmax(full, axis=1)[:, None], np.arange(levels.size)
        seen = (place == first) | (place == first - 1) | ((full == 0) & (place % 3 == 0))
        assert not seen.all()
        one, other = (
            risk_of(with_verdicts(data, verdict, joint), {"ring": FIT}, HAZARD)
            for verdict in (full, np.where(seen, full, 4))
        )
        one, other = (found.arches["ring"].splits["mechanism"] for found in (one, other))
        assert one.categories == other.categories
        np.testing.assert_array_equal(one.rate, other.rate)

    def test_runs_each_at_an_intensity_of_its_own(self, data):
        generator = np.random.default_rng(6)
        at = np.exp(generator.uniform(0.0, 2.0, (30, 1)))
        verdict = (4.0 * np.exp(0.4 * generator.standard_normal(at.shape)) < at).astype(int)
        one = with_verdicts(data.isel(level=[4]).drop_vars("intensity"), verdict, 2)
        units = {"units": "m s-2", "measure": "PGA"}
        one = one.assign(intensity=(data["verdict"].dims, at[None], units))
        found = risk_of(one, {"ring": FIT}, HAZARD).arches["ring"]
        assert found.splits["mechanism"].counts.sum() == verdict.sum()
        assert found.level_rate.sum() == pytest.approx(found.rate.rate, rel=1e-12)
        assert at.min() < found.levels[0] < found.levels[-1] < at.max()


def test_by_the_command(tmp_path):
    study = made(small_study(tmp_path)).study
    hazard, out = tmp_path / "hazard.csv", tmp_path / "risk.json"
    hazard.write_text("PGA [g],rate,rate_0.84\n0.01,0.1,0.2\n0.1,1e-2,2e-2\n3,1e-5,2e-5\n")
    asked = ("risk", tmp_path / "small.yaml", "--hazard", hazard)

    def with_curves(**curves):
        """Put other curves of arches into the fits of the study, which stay up to date."""
        made_up = json.loads((study.folder / FITS).read_text())
        for name, curve in curves.items():
            made_up["arches"][name]["curve"] = curve
        (study.folder / FITS).write_text(json.dumps(made_up))
        finish(study, "fit")

    with_curves(ring=FIT.to_dict())
    result = command(*asked, "--json", "--out", out, "--years", 100)
    assert result.exit_code == 0, result.output
    for option, value in (("years", 0), ("confidence", 2), ("confidence", "nan")):
        assert command(*asked, f"--{option}", value).exit_code == 2
    facts = json.loads(result.stdout)
    assert json.loads(out.read_text()) == facts
    ring = facts["arches"]["ring"]
    assert ring["probability"] == pytest.approx(1.0 - np.exp(-100.0 * ring["rate"]))
    assert ring["theta"] == pytest.approx(FIT.theta / 9.80665)
    assert ring["rate_by_hazard_curve"]["0.84"] == pytest.approx(2.0 * ring["rate"])
    assert sum(ring["rate_by_level"]) == pytest.approx(ring["rate"])
    assert facts["hazard"]["curves"]["mean"]["im"] == pytest.approx([0.01, 0.1, 3.0])
    with_curves(ring={"none": "nothing fell"}, slab={"none": "nothing fell"})
    result = command(*asked)
    assert result.exit_code == 6
    assert "ring: no rate, since there is no curve: nothing fell" in result.stdout
    assert result.stderr == "archfrag: error: no arch has a curve, so there is no rate\n"
