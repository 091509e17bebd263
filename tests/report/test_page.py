"""The page shows what the cube holds, needs nothing but itself, and is written or not."""

import base64
import hashlib
import json
import re
from dataclasses import replace
from importlib.resources import files

import lxml.html
import numpy as np
import pytest

from archfrag.fragility.risk import HazardCurve
from archfrag.fragility.verdicts import Verdict
from archfrag.motions.measures import spectral_acceleration
from archfrag.report import curve_figures, first_page, inputs
from archfrag.report.first_page import leading, leading_arch, site_levels
from archfrag.report.html import digits, percentages, rounded
from archfrag.report.page import render, spectra, write_report
from archfrag.report.sections import card
from archfrag.study.answer import fits
from archfrag.study.answer.curves import Fitted
from archfrag.study.answer.rates import risk_of
from archfrag.study.file.schema import load_study
from archfrag.study.hazard import Hazard
from tests.report import synthetic
from tests.study.small import small_study

GRAVITY = synthetic.GRAVITY
LEVELS_OF_RING = "Verdicts and probabilities of ring by level"


@pytest.fixture(scope="module")
def study():
    return synthetic.inputs()


@pytest.fixture(scope="module")
def page(study):
    return read(study)


@pytest.fixture(scope="module")
def full(tmp_path_factory):
    """A study of two arches at a level, with all that an answer may hold; page and summary."""
    study = synthetic.inputs(
        ("thin", "thick"), at=0.35, classes={"both": synthetic.answer_of(4.1)}
    )
    study.cube["arch_class"] = ("arch", ["both", "both"])
    study.answers["thin"] = replace(
        study.answers["thin"], states=synthetic.STATES, crossings="All are ordered."
    )
    study.answers["thick"] = replace(
        study.answers["thick"], measures=synthetic.MEASURES
    )
    out = write_report(study, tmp_path_factory.mktemp("answer") / "report.html")
    page = lxml.html.document_fromstring(out.read_text(encoding="utf-8"))
    return (
        study,
        page,
        json.loads((out.parent / "summary.json").read_text(encoding="utf-8")),
    )


def read(study):
    return lxml.html.document_fromstring(render(study)[0])


def text(element):
    return " ".join(element.text_content().split())


def section(page, name):
    (found,) = page.xpath(f'//section[@id="{name}"]')
    return found


def large(card):
    """Figures that an answer shows first."""
    return [
        text(cell) for cell in card.xpath('./dl[@class="figures"]//dd[@class="large"]')
    ]


def table(page, label):
    (found,) = page.xpath(f'//table[@aria-label="{label}"]')
    heads = [text(cell) for cell in found.xpath("./thead//th")]
    return heads, [[text(cell) for cell in row] for row in found.xpath("./tbody/tr")]


class TestAnswer:
    def test_curve_and_counts_stand_first(self, study, page):
        answer = study.answers["ring"]
        verdict = study.cube["verdict"].values
        (card,) = section(page, "arch0").xpath('./div[@class="answer"]')
        fit = answer
        assert large(card) == [
            f"{fit.theta / GRAVITY:#.3g} g",
            f"{fit.beta:#.3g}",
            "0.370 g",
        ]
        theta = np.array(answer.theta_interval) / GRAVITY
        for (low, high), unit in ((theta, " g"), (answer.beta_interval, "")):
            assert f"90 %: {low:#.3g} to {high:#.3g}{unit}" in text(card)
        (counts,) = page.xpath('//dl[@class="figures counts"]')
        heads, values = (map(text, counts.xpath(f".//{tag}")) for tag in ("dt", "dd"))
        # Counts of 0 are left out.
        assert dict(zip(heads, map(int, values), strict=True)) == {
            "runs": verdict.size,
            "collapsed": (verdict == Verdict.COLLAPSED).sum(),
            "survived": (verdict == Verdict.SURVIVED).sum(),
            "unfinished": 1,
            "failed": 1,
            "effective number": 6,
        }
        assert not page.xpath('//*[@class="caution"]')

    def test_levels(self, study, page):
        _, rows = table(page, LEVELS_OF_RING)
        verdict = study.cube["verdict"].values[0]
        for i, (row, level) in enumerate(
            zip(rows, study.cube["intensity"].values, strict=True)
        ):
            fell = (verdict[:, i] == 1).sum()
            stood = (verdict[:, i] == 0).sum()
            assert row[0] == f"{level / GRAVITY:#.3g}"
            assert [int(cell) for cell in row[1:4]] == [len(verdict), fell, stood]
            # Of six runs at the level before the last one failed: the fraction is of five.
            assert row[6] == f"{fell / (fell + stood):.3f}"
            assert row[8] == f"{study.answers['ring'].probability(level):.3f}"

    def test_without_curve_or_onset(self, study):
        _, onset = synthetic.arch_and_onset()
        quiet = study.cube.assign(verdict=0 * study.cube["verdict"])
        given = replace(
            study, cube=quiet, answers={"ring": synthetic.none("no run collapsed")}
        )
        page = read(given)
        (card,) = section(page, "arch0").xpath('./div[@class="answer"]')
        assert "No fragility curve: no run collapsed." in text(card)
        assert large(card) == ["0.370 g"]
        assert all(row[8] == "–" for row in table(page, LEVELS_OF_RING)[1])
        for changes in (
            {"stands": False, "plus": np.nan, "minus": np.nan},
            {"plus": np.inf, "hinges": [], "thrust_plus": None},
        ):
            page, _ = render(replace(given, arches={"ring": replace(onset, **changes)}))
            assert not re.search(r"\b(nan|inf) g", page)

    def test_limit_states_measures_and_class(self, full):
        given, page, _ = full
        chance = given.classes["both"].probability(0.35 * GRAVITY)
        heads, rows = table(page, "Answer for each arch")
        assert heads[:2] == ["arch", "P(collapse) at 0.350 g"]
        assert [row[0] for row in rows] == ["thin", "thick"]
        answer = given.answers["thin"]
        of_thin = percentages([answer.at(0.35 * GRAVITY)[0]])
        assert rows[0][1].startswith(f"{of_thin} (")
        assert f"with probability {percentages([chance])} (" in text(
            section(page, "first")
        )
        fit = answer.likelihood
        ending = f"Dashed: θ {fit.theta / GRAVITY:#.3g} g, β {fit.beta:.3f}."
        assert ending in text(section(page, "members"))
        assert f"pointwise band, {answer.method}. {answer.assumptions}" in text(page)
        assert table(page, "Limit states of thin")[1] == [
            [
                "motion",
                "a joint opens",
                "0.102",
                "0.0865 to 0.120",
                "0.400",
                "0.30 to 0.53",
            ],
            ["impact", "a joint closes (no curve: all collapse)", "–", "–", "–", "–"],
        ]
        rows = table(page, "Intensity measures for thick")[1]
        assert rows[0] == ["PGV (best)", "0.300", "–", "0.500", "0.300", "m/s"]
        assert rows[1] == ["PGA (of the study)", "0.420", "–", "0.500", "0.408", "g"]
        assert rows[2] == ["Arias", "–", "–", "0.500", "–", "m/s"]

    def test_summary_for_programs(self, full):
        given, _, data = full
        assert [data[k] for k in ("format", "unit", "level")] == [
            "archfrag-summary/2",
            "g",
            0.35,
        ]
        for arch, verdict in zip(
            data["arches"], given.cube["verdict"].values, strict=True
        ):
            answer = given.answers[arch["id"]]
            _, *band = answer.at(0.35 * GRAVITY)
            assert arch["curve"]["theta"] == pytest.approx(answer.theta / GRAVITY)
            assert arch["curve"]["maximum_likelihood"]["beta"] == answer.likelihood.beta
            assert arch["counts"]["collapsed"] == (verdict == Verdict.COLLAPSED).sum()
            assert sum(arch["mechanisms"]["mode"].values()) == pytest.approx(
                1.0, abs=1e-5
            )
            assert arch["onset"] == pytest.approx(
                {"plus": 0.37001, "minus": 0.37001}, abs=1e-5
            )
            assert arch["probability"]["interval"] == pytest.approx(band)
        (both,) = data["classes"]
        assert both["arches"] == 2


class TestFirstPage:
    def lead(self, given):
        (found,) = read(given).xpath('//section[@id="first"]/p[@class="lead"]')
        return text(found)

    def test_says_the_median_or_the_probability_that_is_asked_for(self, study):
        answer = study.answers["ring"]
        scale = study.scale
        low, high = (digits(end / GRAVITY) for end in answer.theta_interval)
        start = "Half of the ground motions make the arch collapse at PGA"
        start += f" {scale.text(answer.theta / GRAVITY)}"
        assert self.lead(study) == f"{start} (90 %: {low} to {high} g)."
        value, *band = answer.at(0.35 * GRAVITY)
        start = f"Under PGA 0.350 g, the arch collapses with probability {percentages([value])}"
        assert (
            self.lead(replace(study, at=0.35))
            == f"{start} (90 %: {percentages(band)})."
        )
        value, low, high = answer.at(1.2 * GRAVITY)  # beyond the levels
        assert answer.upper[-1] < high
        assert low < value < high
        assert (
            f"{percentages([value])} (90 %: {percentages([low, high])})."
            in self.lead(replace(study, at=1.2))
        )
        assert percentages([0.02, 0.2149]) == "2.0 to 21 %"
        assert [percentages(2 * [p]) for p in (1e-4, 0.9999)] == ["< 0.1 %", "> 99.9 %"]

    def test_says_what_the_475_year_motion_of_the_site_does(self, study):
        fit = study.answers["ring"]
        curve = hazard(8)
        given = replace(study, risk=risk_of(study.cube, {"ring": fit}, curve))
        # The first hazard curve is 2e-3 im^-2, so that 1/475 a year is at (0.95)^0.5 m/s2.
        at = (2e-3 * 475.0) ** 0.5
        assert site_levels(given)["475-year"] == pytest.approx(at / GRAVITY, rel=1e-9)
        words = self.lead(given)
        assert words.startswith(
            f"Under the 475-year motion of the site, PGA {at / GRAVITY:#.3g} g, "
        )
        assert percentages([fit.probability(at)]) in words
        years = given.risk.arches["ring"].rate.return_period
        assert f"return period of {float(f'{years:.2g}'):,.0f} years" in words

    def test_leads_with_the_weakest_arch_or_class(self, full):
        given, page, _ = full
        assert leading(given)[0] == "both"
        words = text(section(page, "first"))
        assert "an arch drawn from class both (2 arches) collapses with" in words
        assert "Drawn: th" in words
        assert "Line: lognormal curve of class both." in words
        alone = given.cube.assign(arch_class=("arch", ["both", "thick"]))
        weaker = replace(
            given,
            cube=alone,
            answers={
                "thin": synthetic.answer_of(9.0),
                "thick": synthetic.answer_of(4.0),
            },
        )
        assert "thick, the weakest of 2 arches or classes at this level," in self.lead(
            weaker
        )
        # The arch that is drawn is of the class that leads, though one of the other is nearer.
        other = given.cube.assign(arch_class=("arch", ["thick-ones", "both"]))
        two = {"both": synthetic.answer_of(4.1), "thick-ones": synthetic.answer_of(9.0)}
        answers = {"thin": synthetic.answer_of(4.1), "thick": synthetic.answer_of(9.0)}
        drawn = leading_arch(replace(given, cube=other, classes=two, answers=answers))
        assert drawn == "thick"
        several = replace(given, classes={})
        weakest = max(
            several.answers, key=lambda name: several.answers[name](0.35 * GRAVITY)
        )
        assert leading(several)[0] == weakest
        weakest = min(several.answers, key=lambda name: several.answers[name].theta)
        assert leading(replace(several, at=None))[0] == weakest


def hazard(points):
    """A hazard curve up to so many points, and a fractile of it."""
    im = np.geomspace(0.2, 20.0, 8)[:points]
    curves = {
        "mean": HazardCurve(im, 2e-3 * im**-2.0),
        "0.84": HazardCurve(im, 1e-2 / im),
    }
    return Hazard("PGA", "a.csv", curves)


def test_risk(drawn):
    data = synthetic.cube(names=("ring", "slab"), items=synthetic.motions(12))
    fits = {
        "ring": synthetic.answers_of(data)["ring"],
        "slab": synthetic.none("no curve"),
    }
    whole, short = (risk_of(data, fits, hazard(points)) for points in (8, 4))
    page, bound = (
        read(synthetic.inputs(("ring", "slab"), 12, cube=data, risk=risk))
        for risk in (whole, short)
    )
    assert "No rate: no curve." in text(page)
    _, rows = table(page, "Rates of collapse")
    assert [row[0] for row in rows] == ["ring", "slab"]
    assert rows[0][1] == f"{whole.arches['ring'].rate.rate:.2g}"
    assert "It is the higher one because weak motions" in text(section(page, "risk"))
    (figure,) = page.xpath(
        '//svg[starts-with(@aria-label, "Rate of collapse of ring by")]'
    )[-1:]
    parts = [float(part) for part in re.findall(r" (\d+) %", figure.text_content())]
    assert len(parts) > 1
    assert sum(parts) == pytest.approx(100.0, abs=3.0)
    row = table(bound, "Rates of collapse")[1][0]
    assert (row[1][:9], row[2], row[3], row[4][:8]) == (
        "at least ",
        "–",
        "–",
        "at most ",
    )


def test_cautions_stand_where_they_belong(study):
    data = study.cube.assign(
        accepted=("record", ["", "PGA 7 g", "", "", "dt 0.2 s", ""])
    )
    given = ["ring: runs are unfinished", "motions are scaled by more than 10"]
    page = read(replace(study, cube=data, cautions=given))
    (card,) = section(page, "arch0").xpath('./div[@class="answer"]/p')
    assert text(card) == "Caution: runs are unfinished."
    (head,) = page.xpath('//header/p[@class="caution"]')
    assert text(head) == "Caution: motions are scaled by more than 10."
    (records,) = section(page, "motions").xpath('./p[@class="caution"]')
    first, second = (study.motions[i].id for i in (1, 4))
    assert text(records).endswith(f": {first} (PGA 7 g), {second} (dt 0.2 s).")


class TestClass:
    def test_one_chapter_and_members_folded_in_the_appendix(self, full):
        _, page, _ = full
        assert [text(h) for h in page.xpath("//h2")] == [
            "Class both",
            "Ground motions",
            "Provenance",
            "Appendix: arches of classes",
            "Terms and limits",
            "Errors and their costs",
        ]
        folded = section(page, "members").xpath("./details")
        assert [text(each.find("summary")) for each in folded] == [
            "Answers",
            "thin",
            "thick",
        ]
        assert all("open" not in each.attrib for each in folded)
        assert not page.xpath('//header//table[@aria-label="Answer for each arch"]')

    def test_figure_of_its_own(self, full):
        given, _, _ = full
        _, figures = render(given)
        assert set(figures) == {"curve-both.svg", "curve-thin.svg", "curve-thick.svg"}
        assert (
            "an arch drawn at random from class both" in figures["curve-both.svg"].file
        )


def test_target_of_the_records_stands_beside_their_spectra(study, drawn):
    """The target with 16 and 84 %, records with the factors that they were selected with."""
    factors = {motion.id: 2.0 + i for i, motion in enumerate(study.motions)}
    periods = np.array([0.01, 0.1, 1.0, 10.0])  # the outer ones are not in the figure
    target = np.array([periods, [0.2, 0.5, 0.3, 0.1], [0.5, 0.5, 0.4, 0.3]])
    reversed_too = [replace(m, id=f"{m.id}-rev") for m in study.motions[:1]]
    motions = [*reversed_too, *study.motions[1:]]
    given = replace(study, motions=motions, target=(target, factors))
    picture = spectra(given)
    assert "with which it was selected for the target" in picture.caption
    sheet = drawn[-1]
    (panel,) = sheet.panels
    lines = re.findall(
        r'<path d="M([^"]+)"[^>]*stroke="#D55E00"', "".join(sheet.parts)
    )[1:]
    for line, sa in zip(
        lines, target[1] * np.exp(np.outer([0.0, 1.0, -1.0], target[2]))
    ):
        points = np.array(re.findall(r"-?[\d.]+", line), dtype=float).reshape(-1, 2)
        ends = np.column_stack([panel.at_x(periods[1:3]), panel.at_y(sa[1:3])])
        np.testing.assert_allclose(points, ends, atol=0.11)
    assert len(lines) == 3
    grey = re.findall(
        r'<path d="M([\d.]+) ([\d.]+)[^"]*"[^>]*stroke="#7b8794"', "".join(sheet.parts)
    )[1:]
    first = [
        spectral_acceleration(m, [0.03])[0] * f / GRAVITY
        for m, f in zip(study.motions, factors.values())
    ]
    np.testing.assert_allclose(
        [float(y) for _, y in grey], panel.at_y(first), atol=0.11
    )


def test_ratios_of_an_arch_after_a_first_shock_are_to_the_same_arch_before():
    study = synthetic.inputs(("thin", "thick", "thick-after-0.9"))
    study.cube["first_shock"] = "arch", [0.0, 0.0, 8.8]
    assert study.references == {"thick": "thin", "thick-after-0.9": "thick"}
    ratio = study.ratios["thick-after-0.9"]["theta"]
    assert ratio["before"] == pytest.approx(study.answers["thick"].theta)
    _, rows = table(read(study), "Ratios of arches")
    assert [row[:2] for row in rows] == [
        ["thick", "thin"],
        ["thick-after-0.9", "thick"],
    ]


def test_a_curve_of_the_records_after_which_an_arch_stands_says_so_in_the_table_of_answers():
    study = synthetic.inputs(("ring", "ring-after-0.9"))
    study.cube["first_shock"] = "arch", [0.0, 8.8]
    verdict = study.cube["verdict"].transpose("arch", "record", "level").values.copy()
    verdict[1, :3] = Verdict.COLLAPSED_BEFORE
    study.cube["verdict"] = ("arch", "record", "level"), verdict
    count = study.cube.sizes["record"]
    words = f"ring-after-0.9, if it stands, as in {count - 3} of {count}"
    assert words in read(study).text_content()


def test_medians_of_runs_without_a_verdict_are_in_the_unit_of_the_report():
    ends = synthetic.curve_of(0.5 * GRAVITY), synthetic.curve_of(1.5 * GRAVITY)
    known = synthetic.inputs().answers["ring"]
    answer = replace(known, n_undecided=2, extremes=ends)
    text = str(card(synthetic.inputs(answers={"ring": answer}), "ring"))
    assert (
        "2 runs have no verdict: the median is 0.500 g if all collapse, 1.50 g" in text
    )


def test_the_page_prints_what_is_folded_and_forces_no_page():
    css = (files("archfrag.report") / "templates" / "report.css").read_text()
    printed = css.partition("@media print {")[2]
    assert "details { display: none" not in printed
    assert "details::details-content { content-visibility: visible" in printed
    assert "break-before: page" not in printed


class TestOffline:
    def test_nothing_is_fetched_and_links_lead_somewhere(self, study, page):
        html, _ = render(study)
        assert not re.search(r"https?:|@import|url\((?!#)", html)
        assert not page.xpath("//link | //img | //iframe | //object | //embed")
        assert not [
            name for name in page.xpath("//@*") if str(name).startswith("javascript")
        ]
        (policy,) = page.xpath('//meta[@http-equiv="Content-Security-Policy"]/@content')
        assert policy.startswith("default-src 'none'")
        (script,) = page.xpath("//script/text()")  # no other one may run
        digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
        assert policy.endswith(f"script-src 'sha256-{digest}'")
        identifiers = re.findall(r'\bid="([^"]+)"', html)
        assert len(identifiers) == len(set(identifiers))
        used = set(
            re.findall(r'href="#([^"]+)"', html) + re.findall(r"url\(#([^)]+)\)", html)
        )
        assert used
        assert used <= set(identifiers)

    def test_figures_and_tables_have_a_text_alternative(self, page):
        pictures = page.xpath('//svg[not(@aria-hidden="true")]')
        assert len(pictures) == 9 + 1
        assert all(
            p.get("role") == "img" and len(p.get("aria-label")) > 20 for p in pictures
        )
        assert len(page.xpath('//*[@class="thumbnails"]/@aria-label')) == 1
        assert all(t.get("aria-label") for t in page.xpath("//table"))
        assert page.get("lang") == "en"

    def test_names_are_text_not_markup(self):
        name = "<script>alert(1)</script> & $x_1$"
        html, _ = render(synthetic.inputs((name,)))
        assert html.count("<script") == 1
        assert "alert(1)</script>" not in html
        assert name in map(text, lxml.html.document_fromstring(html).xpath("//h2"))


class TestNumbers:
    def test_time_and_accuracy(self, study):
        data = study.cube.copy(deep=True)
        failed = data["verdict"] == Verdict.FAILED
        data["contact_residual"] = data["contact_residual"].where(~failed, 0.7)
        rows = dict(
            table(read(replace(study, cube=data)), "Models, time and accuracy of ring")[
                1
            ]
        )
        per_second = 1e3 * 0.05 * failed.size / float(data["end_time"].sum())
        assert rows["wall time for one simulated second"] == f"{per_second:#.3g} ms"
        largest = float(data["contact_residual"].where(~failed).max())
        assert rows["contact residual, median and largest"].endswith(f", {largest:.1e}")
        time = data["model_time"].values
        part = time[..., 2].sum()
        expected = f"{part:,.1f} s ({100 * part / time.sum():.1f} %)"
        assert rows["of this, mega-voussoirs"] == expected

    def test_motions_and_provenance(self, study):
        data = study.cube.assign_attrs(made="0123abcd", config='{"levels": [0.1]}')
        page = read(replace(study, cube=data))
        heads, rows = table(page, "Ground motions as recorded, and their scale factors")
        assert [row[0] for row in rows] == [motion.id for motion in study.motions]
        peak = np.abs(study.motions[2].acceleration).max()
        factors = data["scale_factor"].values[2]
        assert rows[2][heads.index("PGA [g]")] == f"{peak / GRAVITY:.4f}"
        assert rows[2][-1] == f"{digits(factors.min())} – {digits(factors.max())}"
        origin = section(page, "provenance")
        assert {"0123abcd", "CF-1.11"} <= {text(cell) for cell in origin.xpath(".//td")}
        assert '"levels": [ 0.1 ]' in text(origin)


def bisected():
    """A study whose records have each been run beside their capacity only."""
    study = synthetic.inputs(n_record=8)
    data = study.cube.copy(deep=True)
    codes = data["verdict"].values[0]
    codes[:] = np.maximum.accumulate(codes == Verdict.COLLAPSED, axis=1)
    first = np.where(codes.any(axis=1), codes.argmax(axis=1), codes.shape[1])
    away = np.abs(np.arange(codes.shape[1]) + 0.5 - first[:, None]) > 0.6
    codes[away] = Verdict.NOT_RUN
    for name in data.data_vars:  # as the cube stores what was not run
        if data[name].dims[:3] == ("arch", "record", "level") and name != "verdict":
            data[name].values[0][away] = np.nan if data[name].dtype.kind == "f" else -1
    facts = {
        "runs": int((~away).sum()),
        "records": 8,
        "checked": 3,
        "contradictions": 1,
    }
    data.attrs["archfrag_design"] = json.dumps(
        {"kind": "ida", "arches": {"ring": facts}}
    )
    return replace(study, cube=data, answers=synthetic.answers_of(data)), first


class TestWords:
    def test_significant_digits_are_kept(self):
        shown = {
            0.0002: "0.00020",
            0.010000001: "0.010",
            5.93e-5: "5.9·10⁻⁵",
            1396.0: "1,400",
            0.34: "0.34",
            12.3: "12",
            99.6: "100",
            1.0: "1.0",
            np.nan: "–",
        }
        assert {value: rounded(value) for value in shown} == shown

    @pytest.mark.parametrize(
        ("keys", "expected"),
        [({"title": "small"}, "Fragility of masonry arches"), ({}, "A small study")],
    )
    def test_a_study_without_a_title_has_one(self, tmp_path, keys, expected):
        study = load_study(small_study(tmp_path)).model_copy(update=keys)
        assert inputs._title(study) == expected

    def test_classes_are_named(self, full):
        given, _, _ = full
        shown = curve_figures.all_curves(given, given.answers, ["both"]).caption
        assert "Bold: an arch drawn at random from class both." in shown
        two = {"both": given.classes["both"], "thick": given.classes["both"]}
        several = replace(given, classes=two)
        shown = curve_figures.all_curves(several, given.answers, list(two)).caption
        assert shown.count("Shaded") == 1
        assert not shown.startswith("Lognormal")
        words = first_page._whose(several, "both")
        assert words.endswith(", the weakest of 2 arches or classes at this level,")

    def test_the_curve_table_has_seven_digits(self, full, tmp_path):
        given, _, _ = full
        study = load_study(small_study(tmp_path))
        study.folder.mkdir()
        fits.store_fits(study, Fitted(dict(given.answers), {}, given.cube))
        lines = (study.folder / "curve.csv").read_text().splitlines()[1:]
        cells = [cell for line in lines for cell in line.split(",")[1:]]
        digits_of = [len(re.sub(r"e.*|[.-]", "", cell).lstrip("0")) for cell in cells]
        assert max(digits_of) <= 7
        assert min(float(cell) for cell in cells if float(cell)) >= 1e-9


class TestDesigns:
    def test_bisected_levels_show_capacities(self):
        study, first = bisected()
        page = read(study)
        heads, rows = table(page, LEVELS_OF_RING)
        assert heads[6] == "records with capacity below"
        below = [(first <= level).mean() for level in range(len(rows))]
        assert [row[6] for row in rows] == [f"{fraction:.3f}" for fraction in below]
        assert "nan" not in text(section(page, "arch0"))
        assert (
            "-"
            not in dict(table(page, "Models, time and accuracy of ring")[1])["impacts"]
        )
        found = study.results("ring")
        levels = np.concatenate(
            [found.levels[:1] ** 2 / found.levels[0], found.levels, [np.inf]]
        )
        middle = np.sqrt(levels[first] * levels[first + 1])
        assert found.capacities == pytest.approx(middle)
