"""The answer on top, all arches together, what others add, and the numbers for programs."""

import json
from dataclasses import replace

import lxml.html
import numpy as np
import pytest

from archfrag.fragility.counts import Verdict
from archfrag.fragility.fit import Fragility
from archfrag.report import curve_figures, measure_figures
from archfrag.report.answer import arch_answer, classes, headline
from archfrag.report.measure_figures import MeasureRow
from archfrag.report.page import render, write_report
from archfrag.report.summary import NOT_SIMULATED, arch_results, reading_scale
from archfrag.report.tables import Table
from tests.report import synthetic
from tests.report.test_figures import drawn, overlaps, results  # noqa: F401
from tests.report.test_page import table, text

GRAVITY = 9.80665


def curve_of(theta, beta=0.4):
    return Fragility(theta, beta, np.diag([0.01, 0.005]), -10.0, 9, 54, "stripes")


@pytest.fixture(scope="module")
def quick():
    """Fewer resamples: what is tested does not depend on their number."""
    patch = pytest.MonkeyPatch()
    patch.setattr(curve_figures, "_RESAMPLES", 100)
    yield
    patch.undo()


@pytest.fixture(scope="module")
def written(tmp_path_factory, quick):
    """A study of two arches at a level, with all that others may add."""
    study = synthetic.inputs(
        ("thin", "thick"), at=0.35,
        limit_states={"thin": [("motion", curve_of(1.0)), ("collapse", curve_of(4.0))]},
        measures={"thick": [MeasureRow("PGA", "g", 0.4, 0.42), MeasureRow("PGV", "cm/s", 30, 0.3),
                            MeasureRow("Arias", "m/s")]},
        risk={"sentence": "Collapse rate 1.2e-5 a year.", "note": "From a made-up hazard.",
              "tables": [("Rates", Table(["arch", "rate"], [["thin", "1.2e-5"]]))]},
    )  # fmt: skip
    out = write_report(study, tmp_path_factory.mktemp("answer") / "report.html")
    page = lxml.html.document_fromstring(out.read_text(encoding="utf-8"))
    return study, page, json.loads((out.parent / "summary.json").read_text(encoding="utf-8"))


class TestAnswer:
    def test_probability_at_the_level_stands_first(self, written):
        study, page, _ = written
        (said,) = page.xpath('//header/p[@class="answer"]')
        chance = study.fits["thin"].probability(0.35 * GRAVITY)
        assert text(said).startswith("Probability of collapse at PGA = 0.350 g: ")
        assert f"thin {chance:.2f} (90 %: " in text(said)
        heads, rows = table(page, "Answer for each arch")
        assert heads[:2] == ["arch", "P(collapse) at 0.350 g"]
        assert [row[0] for row in rows] == ["thin", "thick"]
        assert rows[0][1].startswith(f"{chance:.2f} (")

    def test_band_at_the_level_is_that_of_the_curve(self, written):
        study, _, data = written
        found = arch_results(study.cube, "thin", reading_scale(study.cube, "PGA"))
        band = curve_figures.resample(found, 0.9, 0.35).band
        place = np.searchsorted(curve_figures.resample(found, 0.9, 0.35).levels, 0.35)
        assert data["arches"][0]["probability"]["interval"] == [
            band.lower[place],
            band.upper[place],
        ]

    def test_median_where_no_level_is_asked_for(self):
        found, fit = results(), synthetic.inputs().fits["ring"]
        said = headline([arch_answer(found, fit, None, 0.9, None)], found.scale, 0.9)
        assert said.startswith("PGA at which half of the motions bring the arch down (median θ): ")
        assert f"ring {fit.theta / GRAVITY:#.3g} g (90 %: " in said

    def test_no_curve(self):
        found = results()
        answers = [arch_answer(found, "no run collapsed", None, 0.9, 0.3)]
        assert headline(answers, found.scale, 0.9) == (
            "ring: no fragility curve, for no run collapsed"
        )

    def test_many_arches_are_named_by_their_range(self):
        found = results()
        answers = [
            arch_answer(replace(found, arch=f"a{i}"), curve_of(3.0 + i), None, 0.9, None)
            for i in range(6)
        ]
        said = headline(answers, found.scale, 0.9)
        assert "from a0 " in said
        assert " to a5 " in said
        assert "a3" not in said


class TestSummaryFile:
    def test_numbers_are_those_of_the_cube(self, written):
        study, _, data = written
        assert (data["format"], data["measure"], data["unit"]) == (
            "archfrag-summary/1",
            "PGA",
            "g",
        )
        assert data["level"] == 0.35
        assert data["unit_in_si"] == pytest.approx(GRAVITY)
        for arch, verdict in zip(data["arches"], study.cube["verdict"].values, strict=True):
            fit = study.fits[arch["id"]]
            assert arch["curve"]["theta"] == pytest.approx(fit.theta / GRAVITY)
            assert arch["curve"]["theta_interval"][0] < arch["curve"]["theta"]
            assert arch["curve"]["band"] == "records resampled"
            assert arch["counts"]["collapsed"] == (verdict == Verdict.COLLAPSED).sum()
            assert arch["counts"]["standing"] == (verdict == Verdict.STANDING).sum()
            assert sum(arch["mechanisms"]["mode"].values()) == pytest.approx(1.0, abs=1e-5)
            assert arch["onset"] == {"plus": 0.37, "minus": 0.37}
            value = arch["probability"]["value"]
            assert value == pytest.approx(fit.probability(0.35 * GRAVITY))

    def test_reason_where_there_is_no_curve(self, tmp_path, quick):
        out = write_report(
            synthetic.inputs(fits={"ring": "no run collapsed"}), tmp_path / "report.html"
        )
        (arch,) = json.loads((out.parent / "summary.json").read_text())["arches"]
        assert arch["curve"] is None
        assert arch["probability"] is None
        assert arch["reason"] == "no run collapsed"


class TestWhatOthersAdd:
    def test_limit_states(self, written):
        _, page, _ = written
        heads, rows = table(page, "Limit states of thin")
        assert heads == ["limit state", "θ [g]", "β"]
        assert rows == [["motion", "0.102", "0.400"], ["collapse", "0.408", "0.400"]]
        assert not page.xpath('//table[@aria-label="Limit states of thick"]')

    def test_measures(self, written):
        _, page, _ = written
        _, rows = table(page, "Intensity measures for thick")
        assert rows[1][:4] == ["PGV", "30.0", "cm/s", "0.300"]
        assert rows[2] == ["Arias", "–", "m/s", *6 * ["–"]]
        (section,) = page.xpath('//section[@id="arch1"]')
        assert "Smallest dispersion: PGV." in text(section)

    def test_figure_of_measures(self, drawn):  # noqa: F811
        rows = [MeasureRow(f"Sa({i / 10:g})", "g", 1.0, 0.2 + 0.01 * i) for i in range(25)]
        measure_figures.measures_figure(rows, "ring")
        assert [overlaps(sheet) for sheet in drawn] == [[], []]
        assert measure_figures.measures_figure(rows[:1], "ring") is None

    def test_risk(self, written):
        _, page, _ = written
        (section,) = page.xpath('//section[@id="risk"]')
        assert "Collapse rate 1.2e-5 a year." in text(section)
        assert table(page, "Rates")[1] == [["thin", "1.2e-5"]]

    def test_nothing_added_nothing_shown(self, quick):
        page = lxml.html.document_fromstring(render(synthetic.inputs()))
        heads = {text(head) for head in page.xpath("//h2 | //h3")}
        assert not heads & {"Risk", "Limit states", "Intensity measures compared", "All arches"}


class TestAllCurves:
    @pytest.mark.parametrize("count", [2, 12, 40])
    def test_legible(self, count, drawn):  # noqa: F811
        fits = {f"arch-number-{i}": curve_of(2.0 + 0.2 * i) for i in range(count)}
        kinds = {name: "thin" if i % 2 else "thick" for i, name in enumerate(fits)}
        shown = curve_figures.all_curves(fits, {}, kinds, results().scale, 0.8, 0.3)
        assert [overlaps(sheet) for sheet in drawn] == [[], []]
        named = count if count <= curve_figures.MOST_NAMED else 2
        assert sum(box[0].startswith(("arch-", "thi")) for box in drawn[0].boxes) == named
        assert shown.svg.count("stroke-linejoin") >= count

    def test_one_arch_needs_no_comparison(self):
        scale = results().scale
        assert curve_figures.all_curves({"a": curve_of(1.0)}, {}, {}, scale, 1.0) is None

    def test_sections_of_a_fleet_are_at_even_ranks(self, quick):
        names = [f"a{i:02d}" for i in range(14)]
        study = synthetic.inputs(names, n_record=2, n_level=5)
        fits = {name: curve_of(2.0 + 0.1 * i) for i, name in enumerate(names)}
        page = lxml.html.document_fromstring(render(replace(study, fits=fits)))
        shown = [text(head) for head in page.xpath('//section[@class="arch"]/h2')]
        assert len(shown) == 12
        assert (shown[0], shown[-1]) == ("a00", "a13")
        assert len(table(page, "Answer for each arch")[1]) == 14

    def test_classes_of_the_cube(self):
        data = synthetic.cube(("a", "b"))
        assert classes(data) == {"a": "a", "b": "b"}
        data["arch_class"] = ("arch", ["thin", "thin"])
        assert classes(data) == {"a": "thin", "b": "thin"}


class TestDesigns:
    def test_cells_that_were_not_simulated_count_as_nothing(self, quick):
        study = synthetic.inputs()
        data = study.cube.copy(deep=True)
        data["verdict"][0, :, ::2] = NOT_SIMULATED
        page = lxml.html.document_fromstring(render(replace(study, cube=data)))
        _, rows = table(page, "Verdicts and probabilities of ring by level")
        assert [row[1] for row in rows] == ["0" if i % 2 == 0 else "6" for i in range(len(rows))]
        found = arch_results(data, "ring", reading_scale(data, "PGA"))
        assert found.counts.runs.sum() == (data["verdict"] != NOT_SIMULATED).sum()

    def test_a_level_of_its_own_for_each_run(self, quick):
        """Grouped by intensity: every run is in one group, and groups rise."""
        study = synthetic.inputs(n_record=30, n_level=4)
        data = study.cube.isel(level=[2]).copy(deep=True)
        generator = np.random.default_rng(4)
        own = generator.uniform(1.0, 8.0, (1, 30, 1))
        data["intensity"] = (("arch", "record", "level"), own, data["intensity"].attrs)
        data["scale_factor"] = (("arch", "record", "level"), own / 3.0)
        data["verdict"][0, :, 0] = (own[0, :, 0] > 4.0).astype(int)
        found = arch_results(data, "ring", reading_scale(data, "PGA"))
        assert found.simulated.sum(axis=1).tolist() == [1] * 30
        assert np.all(np.diff(found.levels) > 0)
        share = found.counts.collapsed / found.counts.n
        assert (share[0], share[-1]) == (0.0, 1.0)
        page = lxml.html.document_fromstring(render(replace(study, cube=data)))
        assert "each point stands for a group" in text(page)
