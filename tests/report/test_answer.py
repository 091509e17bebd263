"""The answer on top, all arches together, what others add, and the numbers for programs."""

import json
from dataclasses import replace

import lxml.html
import numpy as np
import pytest

from archfrag.fragility.counts import Verdict
from archfrag.fragility.curve import Fragility
from archfrag.report import class_section, curve_figures, measure_figures
from archfrag.report.answer import classes, headline
from archfrag.report.page import render, write_report
from archfrag.report.summary import NOT_SIMULATED, arch_results, reading_scale
from archfrag.study.curves import Answer
from archfrag.study.members import shown
from tests.report import synthetic
from tests.report.test_figures import drawn, overlaps, results  # noqa: F401
from tests.report.test_page import table, text

GRAVITY = 9.80665


def curve_of(theta, beta=0.4):
    return Fragility(theta, beta, np.diag([0.01, 0.005]), -10.0, 9, 54, "stripes")


def answer_of(theta, **changes):
    """An answer with a band of a tenth to both sides."""
    im = np.linspace(0.0, 8.4, 120)
    chance = curve_of(theta).probability(im)
    made = Answer(
        curve_of(theta), curve_of(1.01 * theta), (0.8 * theta, 1.2 * theta), (0.3, 0.6),
        im.tolist(), (0.9 * chance).tolist(), (1.1 * chance).tolist(), 0.9, "made up",
        "Nothing is assumed.", 6.0, 2,
    )  # fmt: skip
    return replace(made, **changes)


MEASURES = {
    "message": "PGV is best.", "best": "PGV",
    "rows": [
        {"measure": name, "unit": unit, "theta": theta, "beta": beta, "efficiency": beta,
         "practicality": 1.0, "proficiency": beta, "p_magnitude": "nan", "p_distance": 0.5}
        for name, unit, theta, beta in (
            ("PGA", "m/s2", 4.0, 0.42), ("PGV", "m/s", 0.3, 0.3), ("Arias", "m/s", "nan", "nan"),
        )
    ],
}  # fmt: skip
STATES = {
    "message": "All are ordered.",
    "states": [
        {"name": "motion", "meaning": "a joint opens", "curve": curve_of(1.0).to_dict()},
        {"name": "impact", "meaning": "a joint closes", "curve": {"none": "all collapse"}},
    ],
}


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A study of two arches at a level, with all that an answer may hold."""
    study = synthetic.inputs(("thin", "thick"), at=0.35, classes={"both": answer_of(4.1)})
    study.cube["arch_class"] = ("arch", ["both", "both"])
    study.cube["arch_thickness"] = ("arch", [1.4, 1.5])
    free = {"kernel": {"im": [1.0, 4.0, 8.0], "probability": [0.0, 0.5, 1.0]},
            "test_of_fit": {"p_value": 0.4, "message": "Nothing contradicts it."}}  # fmt: skip
    study.answers["thin"].more.update(limit_states=STATES, free=free)
    study.answers["thick"].more["measures"] = MEASURES
    split = {"beta_record_to_record": 0.4, "beta_model": 0.1, "combined": 0.412, "theta": "nan"}
    study.classes["both"].more["dispersion"] = {**split, "message": "Two parts."}
    out = write_report(study, tmp_path_factory.mktemp("answer") / "report.html")
    page = lxml.html.document_fromstring(out.read_text(encoding="utf-8"))
    return study, page, json.loads((out.parent / "summary.json").read_text(encoding="utf-8"))


class TestAnswer:
    def test_probability_at_the_level_stands_first(self, written):
        study, page, _ = written
        (said,) = page.xpath('//header/p[@class="answer"]')
        chance = study.classes["both"].curve.probability(0.35 * GRAVITY)
        assert text(said).startswith("Probability of collapse at PGA = 0.350 g: ")
        assert f"both, 2 arches {chance:.2f} (90 %: " in text(said)
        heads, rows = table(page, "Answer for each arch")
        assert heads[:2] == ["arch", "P(collapse) at 0.350 g"]
        assert [row[0] for row in rows] == ["both, 2 arches", "thin", "thick"]
        assert rows[0][1].startswith(f"{chance:.2f} (")

    def test_band_and_likelihood_are_those_that_are_stored(self, written):
        study, page, data = written
        answer = study.answers["thin"]
        shown = data["arches"][0]
        _, low, high = answer.probability(0.35 * GRAVITY)
        assert shown["probability"]["interval"] == pytest.approx([low, high])
        _, rows = table(page, "Answer for each arch")
        likelihood = answer.likelihood
        assert rows[1][-1] == f"{likelihood.theta / GRAVITY:#.3g}, {likelihood.beta:.2f}"
        assert shown["curve"]["maximum_likelihood"]["beta"] == likelihood.beta
        (section,) = page.xpath('//section[@id="arch0"]')
        assert f"Shaded: pointwise band, {answer.method}. {answer.assumptions}" in text(section)
        assert "Nothing contradicts it." in text(section)

    def test_median_where_no_level_is_asked_for(self):
        answers = synthetic.answers_of(synthetic.cube())
        said = headline(answers, results().scale, None)
        assert said.startswith("PGA at which half of the motions bring the arch down (median θ): ")
        assert f"ring {answers['ring'].curve.theta / GRAVITY:#.3g} g (90 %: " in said

    def test_no_curve(self):
        said = headline({"ring": synthetic.none("no run collapsed")}, results().scale, 0.3)
        assert said == "ring: no fragility curve, for no run collapsed"

    def test_many_arches_are_named_by_their_range(self):
        said = headline({f"a{i}": answer_of(3.0 + i) for i in range(6)}, results().scale, None)
        assert "from a0 " in said
        assert " to a5 " in said
        assert "a3" not in said


class TestSummaryFile:
    def test_numbers_are_those_of_the_cube(self, written):
        study, _, data = written
        assert (data["format"], data["measure"], data["unit"]) == (
            "archfrag-summary/2",
            "PGA",
            "g",
        )
        assert data["level"] == 0.35
        assert data["unit_in_si"] == pytest.approx(GRAVITY)
        for arch, verdict in zip(data["arches"], study.cube["verdict"].values, strict=True):
            fit = study.answers[arch["id"]].curve
            assert arch["curve"]["theta"] == pytest.approx(fit.theta / GRAVITY)
            assert arch["curve"]["theta_interval"][0] < arch["curve"]["theta"]
            assert arch["curve"]["method"].startswith("posterior of capacities")
            assert arch["curve"]["independent"] == 6.0
            assert arch["counts"]["collapsed"] == (verdict == Verdict.COLLAPSED).sum()
            assert arch["counts"]["standing"] == (verdict == Verdict.STANDING).sum()
            assert sum(arch["mechanisms"]["mode"].values()) == pytest.approx(1.0, abs=1e-5)
            assert arch["onset"] == {"plus": 0.37, "minus": 0.37}
            value = arch["probability"]["value"]
            assert value == pytest.approx(fit.probability(0.35 * GRAVITY))

    def test_reason_where_there_is_no_curve(self, tmp_path):
        out = write_report(
            synthetic.inputs(answers={"ring": synthetic.none("no run collapsed")}),
            tmp_path / "report.html",
        )
        (arch,) = json.loads((out.parent / "summary.json").read_text())["arches"]
        assert arch["curve"] is None
        assert arch["probability"] is None
        assert arch["reason"] == "no run collapsed"

    def test_class_with_its_parts(self, written):
        _, _, data = written
        (both,) = data["classes"]
        assert both["arches"] == 2
        assert both["curve"]["theta"] == pytest.approx(4.1 / GRAVITY)
        assert both["dispersion"]["beta_model"] == 0.1
        assert both["dispersion"]["theta"] is None


class TestWhatAnswersHold:
    def test_limit_states(self, written):
        _, page, _ = written
        heads, rows = table(page, "Limit states of thin")
        assert heads == ["limit state", "meaning", "θ [g]", "β"]
        assert rows == [
            ["motion", "a joint opens", "0.102", "0.400"],
            ["impact", "a joint closes", "no curve", "–"],
        ]
        assert not page.xpath('//table[@aria-label="Limit states of thick"]')

    def test_measures(self, written):
        _, page, _ = written
        _, rows = table(page, "Intensity measures for thick")
        assert rows[0][:5] == ["PGV", "0.300", "m/s", "0.300", "0.300"]
        assert rows[2] == ["Arias", "–", "m/s", "–", "–", "1.00", "–", "–", "0.500"]
        assert "PGV is best." in text(page.xpath('//section[@id="arch1"]')[0])

    def test_figure_of_measures(self, drawn):  # noqa: F811
        rows = [{"measure": f"Sa({i / 10:g})", "efficiency": 0.2 + 0.01 * i} for i in range(25)]
        measure_figures.measures_figure(rows, "ring", "Sa(0)")
        assert [overlaps(sheet) for sheet in drawn] == [[], []]
        assert measure_figures.measures_figure(rows[:1], "ring", "Sa(0)") is None

    def test_class(self, written):
        _, page, _ = written
        (section,) = page.xpath('//section[@id="class0"]')
        assert "Two parts." in text(section)
        _, rows = table(page, "Dispersion of the class both")
        assert [row[1] for row in rows] == ["0.400", "0.100", "0.412"]
        assert "Median capacities of 2 arches of both against thickness" in " ".join(
            section.xpath(".//@aria-label")
        )

    def test_nothing_stored_nothing_shown(self):
        page = lxml.html.document_fromstring(render(synthetic.inputs()))
        heads = {text(head) for head in page.xpath("//h2 | //h3")}
        assert not heads & {"Risk", "Limit states", "Intensity measures compared", "All arches"}


class TestClasses:
    def test_panels_keep_clear(self, drawn):  # noqa: F811
        members = [answer_of(3.0 + 0.1 * i) for i in range(20)]
        values = {
            "thickness": np.linspace(1.3, 1.7, 20),
            "year": np.array([1850 + i for i in range(20)]),
            "a parameter with a very long name indeed": np.linspace(-1e-4, 1e-4, 20),
            "material": np.array([f"a long name of a stone {i % 9}" for i in range(20)]),
        }
        shown = class_section.theta_panels(members, values, "ring", results().scale)
        assert [overlaps(sheet) for sheet in drawn] == [[], []]
        assert "thickness +1.00; year +1.00" in shown.caption
        # A point for each arch in each panel.
        assert "".join(drawn[0].parts).count("a2.4 2.4 0 1 0 4.8") == 80

    def test_no_panel_without_a_difference(self):
        members = [answer_of(3.0), answer_of(4.0)]
        assert class_section.theta_panels(members, {}, "ring", results().scale) is None


class TestAllCurves:
    @pytest.mark.parametrize("count", [2, 12, 40])
    def test_legible(self, count, drawn):  # noqa: F811
        answers = {f"arch-number-{i}": answer_of(2.0 + 0.2 * i) for i in range(count)}
        shown = curve_figures.all_curves(answers, {}, {}, results().scale, (0.8, 0.3))
        assert [overlaps(sheet) for sheet in drawn] == [[], []]
        named = count if count <= curve_figures.MOST_NAMED else 0
        assert sum(box[0].startswith("arch-") for box in drawn[0].boxes) == named
        assert shown.svg.count("stroke-linejoin") >= count

    def test_classes_are_named_and_their_arches_thin(self, drawn):  # noqa: F811
        members = {"thin": [answer_of(2.0 + 0.1 * i) for i in range(20)]}
        answers = {f"a{i}": a for i, a in enumerate(members["thin"])} | {"alone": answer_of(6.0)}
        curve_figures.all_curves(
            answers, {"thin": answer_of(3.0)}, members, results().scale, (0.8, None)
        )
        words = [box[0] for box in drawn[0].boxes]
        assert {"thin", "alone", "each arch"} <= set(words)
        assert "a3" not in words

    def test_one_arch_needs_no_comparison(self):
        scale = results().scale
        assert curve_figures.all_curves({"a": answer_of(1.0)}, {}, {}, scale, (1.0, None)) is None

    def test_a_fleet_has_one_file_of_curves(self, tmp_path):
        names = [f"a{i:02d}" for i in range(14)]
        study = synthetic.inputs(names, n_record=3, n_level=5)
        answers = {name: answer_of(2.0 + 0.1 * i) for i, name in enumerate(names)}
        kept = [study.arches[i] for i in shown([a.curve.theta for a in answers.values()])]
        write_report(replace(study, answers=answers, arches=kept), tmp_path / "report.html")
        page = lxml.html.document_fromstring((tmp_path / "report.html").read_text())
        heads = [text(head) for head in page.xpath('//section[@class="arch"]/h2')]
        assert heads == ["a00", "a07", "a13"]
        assert len(table(page, "Answer for each arch")[1]) == 14
        assert sorted(path.name for path in tmp_path.iterdir()) == [
            "curves.svg", "report.html", "summary.json",
        ]  # fmt: skip

    def test_classes_of_the_cube(self):
        data = synthetic.cube(("a", "b"))
        assert classes(data) == {"a": "a", "b": "b"}
        data["arch_class"] = ("arch", ["thin", "thin"])
        assert classes(data) == {"a": "thin", "b": "thin"}


def bisected(kind="ida"):
    """A study whose records have each been run beside their capacity only."""
    study = synthetic.inputs(n_record=8)
    data = study.cube.copy(deep=True)
    codes = data["verdict"].values[0]
    codes[:] = np.where(codes == Verdict.COLLAPSED, 1, 0)
    codes[:] = np.maximum.accumulate(codes, axis=1)
    first = np.where(codes.any(axis=1), codes.argmax(axis=1), codes.shape[1])
    away = np.abs(np.arange(codes.shape[1]) + 0.5 - first[:, None]) > 0.6
    codes[away] = NOT_SIMULATED
    for name in data.data_vars:  # as the cube stores what was not run
        if data[name].dims[:3] == ("arch", "record", "level") and name != "verdict":
            data[name].values[0][away] = np.nan if data[name].dtype.kind == "f" else -1
    note = {"runs": int((~away).sum()), "records": 8, "checked": 3, "contradictions": 1}
    data.attrs["archfrag_design_kind"] = kind
    data.attrs["archfrag_design"] = json.dumps({"kind": kind, "arches": {"ring": note}})
    return replace(study, cube=data, answers=synthetic.answers_of(data)), first


class TestDesigns:
    @pytest.mark.parametrize("kind", ["ida", "two_stage"])
    def test_bisected_levels_show_capacities(self, kind):
        study, first = bisected(kind)
        page = lxml.html.document_fromstring(render(study))
        heads, rows = table(page, "Verdicts and probabilities of ring by level")
        assert heads[6] == "records with capacity below"
        below = [(first <= level).mean() for level in range(len(rows))]
        assert [row[6] for row in rows] == [f"{fraction:.3f}" for fraction in below]
        (section,) = page.xpath('//section[@id="arch0"]')
        assert "Steps: distribution of the capacities of the records" in text(section)
        assert "8 of 8 records; 1 of 3 runs at random contradict" in text(section)
        assert "not simulated" in text(section)
        assert "nan" not in text(section)
        assert "-" not in dict(table(page, "Models and events of ring")[1])["impacts"]

    def test_steps_rise_at_the_capacities(self):
        study, first = bisected()
        found = arch_results(study.cube, "ring", reading_scale(study.cube, "PGA"))
        levels = found.levels
        expected = [
            np.inf if i == levels.size else np.sqrt(levels[i - 1] * levels[i]) if i else levels[0]
            for i in first
        ]
        assert curve_figures.capacities(found) == pytest.approx(expected)

    def test_cells_that_were_not_simulated_count_as_nothing(self):
        study = synthetic.inputs()
        data = study.cube.copy(deep=True)
        data["verdict"][0, :, ::2] = NOT_SIMULATED
        page = lxml.html.document_fromstring(render(replace(study, cube=data)))
        _, rows = table(page, "Verdicts and probabilities of ring by level")
        assert [row[1] for row in rows] == ["0" if i % 2 == 0 else "6" for i in range(len(rows))]
        found = arch_results(data, "ring", reading_scale(data, "PGA"))
        assert found.counts.runs.sum() == (data["verdict"] != NOT_SIMULATED).sum()

    @pytest.mark.parametrize("kind", ["scattered", "cloud"])
    def test_a_level_of_its_own_for_each_run(self, kind):
        """Grouped by intensity: every run is in one group, and groups rise."""
        study = synthetic.inputs(n_record=32, n_level=4)
        data = study.cube.isel(level=[2]).copy(deep=True)
        generator = np.random.default_rng(4)
        own = generator.uniform(1.0, 8.0, (1, 32, 1))
        own[0, 30:] = np.nan  # records that were not used
        data["intensity"] = (("arch", "record", "level"), own, data["intensity"].attrs)
        data["scale_factor"] = (("arch", "record", "level"), own / 3.0)
        data["verdict"][0, :, 0] = (own[0, :, 0] > 4.0).astype(int)
        data["verdict"][0, 30:, 0] = NOT_SIMULATED
        data.attrs["archfrag_design_kind"] = kind
        found = arch_results(data, "ring", reading_scale(data, "PGA"))
        assert found.simulated.sum(axis=1).tolist() == [1] * 30 + [0] * 2
        assert np.all(np.diff(found.levels) > 0)
        share = found.counts.collapsed / found.counts.n
        assert (share[0], share[-1]) == (0.0, 1.0)
        answers = synthetic.answers_of(data)
        page = lxml.html.document_fromstring(render(replace(study, cube=data, answers=answers)))
        assert "each point stands for a group" in text(page)
        assert any(label.startswith("30 runs of ring") for label in page.xpath("//@aria-label"))
