"""Curves of a cube's runs that no other test of studies makes."""

from dataclasses import replace

import lxml.html
import numpy as np
import pytest
import xarray as xr

from archfrag.errors import FitError, InputError
from archfrag.fragility.counts import Verdict
from archfrag.fragility.curve import Fragility
from archfrag.report.inputs import report_inputs
from archfrag.report.page import render
from archfrag.study.answer.cube import write_cube
from archfrag.study.answer.curves import Answer, Runs, _above, dispersion_split
from archfrag.study.answer.fits import (
    arch_cautions,
    cautions_of_cube,
    fit_cube,
    fit_text,
    open_cube,
    record_cautions,
)
from archfrag.study.file.schema import load_study
from archfrag.study.runs import Stripes
from archfrag.study.runs.ida import Ida
from tests.study.small import ROOT, TEXT, fitted, made, small_study

LEVELS = np.geomspace(0.1, 10.0, 60)


def test_a_limit_state_below_the_onset_of_motion_has_no_curve():
    fit = Fragility(0.744, 0.252, np.eye(2), 0.0, 9, 90, "stripes")
    message = _above(fit, 0.862)
    assert "0.72" in message
    assert _above(fit, 0.4) is fit
    assert _above(fit, 0.0) is fit
    assert _above(None, 0.862) is None


def with_verdicts(study, change):
    """Change the cube of a study, which is made if it is not there."""
    path = study.folder / "cube.nc"
    cube = xr.load_dataset(path if path.exists() else write_cube(study))
    change(cube)
    cube.to_netcdf(path)


def all_survive(cube):
    cube["verdict"][:] = Verdict.STANDING


class TestUnits:
    """All between study file and report is in SI: no unit of the levels changes an answer."""

    TEXT = f"""\
id: units
title: Units
output: out-{{unit}}
arches:
  - {{{{id: ring, profile: circular, radius: 10.0, thickness: 1.5, embrace: 157.5, voussoirs: 7,
     friction: 0.7}}}}
motions:
  index: {ROOT / "records" / "index.csv"}
  select: [syn-m55-r005, syn-m55-r030, syn-m60-r020, syn-m65-r005, syn-m65-r050, syn-m70-r020,
    syn-m75-r010, syn-m75-r060]
intensity: {{{{measure: {{measure}}, unit: {{unit}}, levels: {{levels}}}}}}
method: {{{{name: time_stepping, dt: 2.0e-3, follow: 2.0}}}}
"""
    LEVELS = (0.4, 1.0, 1.6, 2.2, 2.8)  # [g]
    DAMAGE = ("residual", "rotation", "contact lost", "collapse")

    @staticmethod
    def states(fits):
        """Curve of each limit state, or None."""
        states = fits["arches"]["ring"]["more"]["limit_states"]["states"]
        return {s["name"]: s["curve"] if "theta" in s["curve"] else None for s in states}

    def test_limit_states_are_the_same_in_every_unit(self, tmp_path):
        def written(measure, unit, levels):
            name = unit.replace("/", "")
            text = self.TEXT.format(measure=measure, unit=unit, levels=list(levels))
            (tmp_path / f"{name}.yaml").write_text(text.replace(f"out-{unit}", f"out-{measure}"))
            return tmp_path / f"{name}.yaml"

        in_g = made(written("PGA", "g", self.LEVELS)).fits
        for unit, factor in (("m/s2", 9.80665), ("cm/s2", 980.665)):
            path = written("PGA", unit, [round(factor * level, 6) for level in self.LEVELS])
            found = fitted(load_study(path))  # of the same cube
            assert self.states(found) == self.states(in_g)
            assert found["arches"]["ring"]["curve"] == in_g["arches"]["ring"]["curve"]
        in_pgv = made(written("PGV", "cm/s", (32.0, 85.0, 138.0, 190.0, 243.0))).fits
        assert list(self.states(in_pgv)) == list(self.states(in_g))
        for fits in (in_g, in_pgv):
            assert {k for k, curve in self.states(fits).items() if curve} == set(self.DAMAGE)

    def test_an_error_names_levels_in_the_unit_of_the_study(self, copied):
        with_verdicts(copied.study, all_survive)
        assert "above 1.2 g" in fit_cube(copied.study)[0]["ring"].curve


def test_theta_is_given_with_all_runs_without_verdict_as_collapses_and_as_survivals(copied):
    def curves_with(verdict):
        def change(cube):
            cube["verdict"][:] = [[0, 0, 1], [0, 1, 1]]
            cube["verdict"][0, 0, 1] = verdict

        with_verdicts(copied.study, change)
        return fit_cube(copied.study)[0]

    found = curves_with(Verdict.SOLVER_FAILURE)
    assert found["slab"].more["without_verdict"] == {}
    lost = found["ring"].more["without_verdict"]
    assert lost["runs"] == 1
    for name, verdict in (("collapsed", Verdict.COLLAPSED), ("standing", Verdict.STANDING)):
        assert lost[name] == curves_with(verdict)["ring"].curve.to_dict()
    assert lost["collapsed"]["theta"] < lost["standing"]["theta"]
    low, high = (f"{lost[k]['theta'] / 9.80665:.4g} g" for k in ("collapsed", "standing"))
    text = fit_text(copied.study, "ring", found["ring"])
    assert f"1 run has no verdict: the median is {low} if all collapse, {high}" in text


class TestCloud:
    """Records as they are, of which no factor was chosen so that some cause collapse."""

    @pytest.mark.parametrize(
        ("factor", "records", "reason"),
        [(0.01, "*", "no run collapsed"), (4.0, "wave0*", "only one record")],
    )  # fmt: skip
    def test_ends_with_a_report_that_states_why_there_is_no_curve(
        self, tmp_path, factor, records, reason
    ):
        text = TEXT.replace("levels: [0.1, 0.6, 1.2]", "levels: [1.0]")
        text = text.replace("records/*.AT2", f"records/{records}.AT2")
        path = small_study(tmp_path, f"{text}design: {{kind: cloud, factor: {factor}}}\n")
        page = lxml.html.document_fromstring(render(report_inputs(made(path).study))[0])
        shown = page.xpath('string(//section[@id="arch1"])')
        assert reason in shown
        assert "error in archfrag" not in shown

    def test_a_part_that_cannot_be_made_is_left_out(self, copied, monkeypatch):
        from archfrag.study.answer import curves

        def spoiled(*_):
            raise ValueError("spoiled")

        write_cube(copied.study)
        for name in ("measures_compared", "limit_states"):
            monkeypatch.setattr(curves, name, spoiled)
        fitted(copied.study)
        page = lxml.html.document_fromstring(render(report_inputs(copied.study))[0])
        assert page.xpath('string(//section[@id="arch0"])').count("ValueError: spoiled") == 2


class TestDispersionOfAClass:
    """Capacities exp(record + arch), of which the strongest are beyond the largest level."""

    @staticmethod
    def made(largest, n_arch=30, n_record=60):
        generator = np.random.default_rng(5)
        arch = 0.2 * generator.standard_normal((n_arch, 1))
        record = 0.4 * generator.standard_normal(n_record)
        own = 0.1 * generator.standard_normal((n_arch, n_record))
        capacity = np.exp(arch + record + own)
        levels = LEVELS[largest > LEVELS]
        runs = [
            Runs("a", Stripes(), (levels >= row[:, None]).astype(int), levels) for row in capacity
        ]
        parts = arch.std(ddof=1), np.hypot(record.std(ddof=1), 0.1)
        fits = [each.design.likelihood(each.brackets) for each in runs]
        return runs, [Answer(fit, fit) for fit in fits], parts

    @pytest.mark.parametrize("largest", [20.0, 1.5])
    def test_arches_that_withstand_the_largest_level_count(self, largest):
        runs, answers, parts = self.made(largest)
        beta = float(np.hypot(*parts))
        found = dispersion_split(runs, answers, beta)
        assert found["beta_model"] == pytest.approx(parts[0], rel=0.1)
        assert found["beta_record_to_record"] == pytest.approx(parts[1], rel=0.1)
        assert np.hypot(*found.values()) == pytest.approx(beta, rel=1e-12)

    def test_without_two_curves_there_is_none(self):
        runs, answers, _ = self.made(1.5)
        with pytest.raises((FitError, InputError), match="one arch has no modelling dispersion"):
            dispersion_split(runs[:2], [answers[0], Answer("no curve", "no curve")], 0.4)


def test_of_a_study_they_name_the_arch_and_its_unit(copied):
    with_verdicts(copied.study, all_survive)
    none = dict.fromkeys(("ring", "slab"), Answer("no curve", "no curve"))
    *surviving, last = cautions_of_cube(copied.study, open_cube(copied.study), none)
    assert [text.split(";")[0] for text in surviving] == [
        f"{name}: no record caused collapse up to 1.2 g, the highest level"
        for name in ("ring", "slab")
    ]
    assert last.startswith("all records are of one earthquake (Test)")

    def undecide(cube):
        cube["verdict"][1, :, 2] = Verdict.UNFINISHED
        cube["scale_factor"][0, 1] = 11.0

    with_verdicts(copied.study, undecide)
    ring, first, second, _ = cautions_of_cube(copied.study, open_cube(copied.study), none)
    assert ring.startswith("ring: no record caused collapse")
    assert first.startswith("slab: more than 5 % of the runs")
    assert "(most: 2 of 2 at 1.2 g)" in first
    assert "(most: wave0, by 11)" in second


def test_contradictions_of_a_fleet_are_one_message():
    notes = {f"a{i}": {"checked": 14, "contradictions": 2} for i in range(50)}
    (one,) = Ida(kind="ida").cautions(notes)
    assert one.startswith("50 arches: 100 of 700 checks near the border contradict")


AGAIN = np.tile(np.array([0, 0, 1, 1], np.int8), (10, 1))
AGAIN[:2, 1:3] = [1, 0]
MORE = AGAIN.copy()
MORE[2, 1:3] = [1, 0]
CURVE = Fragility(1.3, 0.25, np.eye(2), 0.0, 3, 30, "posterior")


def of_events(count):
    events = [f"e{i % count}" for i in range(24)]
    shape = ("arch", "record", "level"), np.zeros((1, 24, 1))
    return record_cautions(
        xr.Dataset({"event": ("record", events), "verdict": shape, "scale_factor": shape})
    )


def of_arch(verdict, levels=(1.0, 1.2, 1.5), curve="none"):
    named = [f"{level:g} g" for level in levels]
    return arch_cautions(np.asarray(verdict), named, np.array(levels), curve)


def of_lost(count, kind):
    verdict = np.zeros((100, 3), dtype=int)
    verdict[:, 2], verdict[:count, 2] = 1, kind
    return of_arch(verdict, (1.0, 2.0, 3.0))


def of_spacing(beta):
    return of_arch([[0, 1, 1]], curve=replace(CURVE, beta=beta))


LOST = (
    "more than 5 % of the runs are unfinished or failed at 1 of 3 levels (most: 6 of 100 at 3 g)"
)


@pytest.mark.parametrize(
    ("found", "expected"),
    [
        *((of_lost(5, kind), "") for kind in (Verdict.UNFINISHED, Verdict.SOLVER_FAILURE)),
        *((of_lost(6, kind), LOST) for kind in (Verdict.UNFINISHED, Verdict.SOLVER_FAILURE)),
        (of_arch(AGAIN, (1.0, 2.0, 3.0, 4.0)), ""),
        (of_arch(MORE, (1.0, 2.0, 3.0, 4.0)), "3 of 10 records do not cause"),
        (of_spacing(0.25), ""),
        (of_spacing(0.2), "the levels n"),
        (of_events(4), ""),
        (of_events(3), "the 24 records are of 3 earth"),
        (of_events(1), "all records are of one"),
    ],
)
def test_a_caution_begins_where_its_rule_says(found, expected):
    messages = list(found)
    assert [message[: len(expected)] for message in messages] == ([expected] if expected else [])
