"""The page shows what the cube holds, needs nothing but itself, and is written or not."""

import json
import os
import re
from dataclasses import replace
from importlib.resources import files

import lxml.html
import numpy as np
import pytest

from archfrag.errors import InputError, OutputError
from archfrag.fragility.counts import Verdict
from archfrag.fragility.risk import HazardCurve
from archfrag.report.html import digits
from archfrag.report.inputs import Scale, arch_results
from archfrag.report.page import render, write_report
from archfrag.report.risk import risk_parts
from archfrag.study.answer.curves import arch_classes
from archfrag.study.answer.risk import risk_of
from archfrag.study.file.hazard import Hazard
from archfrag.study.file.members import shown
from tests.report import synthetic
from tests.report.test_figures import overlaps

GRAVITY = synthetic.GRAVITY


@pytest.fixture(scope="module")
def study():
    return synthetic.inputs()


@pytest.fixture(scope="module")
def html(study):
    return render(study)[0]


@pytest.fixture(scope="module")
def page(html):
    return lxml.html.document_fromstring(html)


@pytest.fixture(scope="module")
def full(tmp_path_factory):
    """A study of two arches at a level, with all that an answer may hold."""
    study = synthetic.inputs(
        ("thin", "thick"), at=0.35, classes={"both": synthetic.answer_of(4.1)}
    )
    study.cube["arch_class"] = ("arch", ["both", "both"])
    study.cube["arch_thickness"] = ("arch", [1.4, 1.5])
    free = {"isotonic": {"im": [1.0, 4.0, 8.0], "probability": [0.0, 0.5, 1.0]},
            "test_of_fit": {"p_value": 0.4, "message": "Nothing contradicts it."}}  # fmt: skip
    study.answers["thin"].more.update(limit_states=synthetic.STATES, free=free)
    study.answers["thick"].more["measures"] = synthetic.MEASURES
    study.classes["both"].more["dispersion"] = {"beta_record_to_record": 0.38, "beta_model": 0.12}
    out = write_report(study, tmp_path_factory.mktemp("answer") / "report.html")
    page = lxml.html.document_fromstring(out.read_text(encoding="utf-8"))
    return study, page, json.loads((out.parent / "summary.json").read_text(encoding="utf-8"))


def read(study):
    return lxml.html.document_fromstring(render(study)[0])


def text(element):
    return " ".join(element.text_content().split())


def table(page, label):
    (found,) = page.xpath(f'//table[@aria-label="{label}"]')
    heads = [text(cell) for cell in found.xpath("./thead//th")]
    rows = [[text(cell) for cell in row] for row in found.xpath("./tbody/tr")]
    return heads, rows


class TestAnswer:
    def test_curve_and_counts_stand_first(self, study, page):
        answer, verdict = study.answers["ring"], study.cube["verdict"].values
        (card,) = page.xpath('//section[@id="arch0"]/div[@class="answer"]')
        large = [text(cell) for cell in card.xpath('./dl[@class="figures"]//dd[@class="large"]')]
        fit = answer.curve
        assert large == [f"{fit.theta / GRAVITY:#.3g} g", f"{fit.beta:#.3g}", "0.370 g"]
        for (low, high), unit in ((np.array(answer.theta) / GRAVITY, " g"), (answer.beta, "")):
            assert f"90 %: {low:#.3g} to {high:#.3g}{unit}" in text(card)
        (counts,) = page.xpath('//dl[@class="figures counts"]')
        heads, values = (map(text, counts.xpath(f".//{tag}")) for tag in ("dt", "dd"))
        # Counts of 0 are left out.
        assert dict(zip(heads, map(int, values), strict=True)) == {
            "runs": verdict.size,
            "collapsed": (verdict == Verdict.COLLAPSED).sum(),
            "standing": (verdict == Verdict.STANDING).sum(),
            "unfinished": 1,
            "solver failures": 1,
            "effective number": 6,
        }
        assert answer.n_non_monotone == 0
        assert not page.xpath('//*[@class="caution"]')

    def test_levels(self, study, page):
        _, rows = table(page, "Verdicts and probabilities of ring by level")
        verdict = study.cube["verdict"].values[0]
        for i, (row, level) in enumerate(zip(rows, study.cube["intensity"].values, strict=True)):
            fell, stood = (verdict[:, i] == 1).sum(), (verdict[:, i] == 0).sum()
            assert row[0] == f"{level / GRAVITY:#.3g}"
            assert [int(cell) for cell in row[1:4]] == [len(verdict), fell, stood]
            assert row[6] == f"{fell / (fell + stood):.3f}"
            assert row[8] == f"{study.answers['ring'].curve.probability(level):.3f}"
        # Of six runs at this level one failed: the fraction is of five.
        assert int(rows[-2][5]) == 1
        assert int(rows[-2][2]) + int(rows[-2][3]) == 5

    def test_without_curve_or_onset(self, study):
        arch, onset = synthetic.arch_and_onset()
        quiet = study.cube.copy(deep=True)
        quiet["verdict"][:] = Verdict.STANDING
        given = replace(study, cube=quiet, answers={"ring": synthetic.none("no run collapsed")})
        page = read(given)
        (card,) = page.xpath('//section[@id="arch0"]/div[@class="answer"]')
        assert "No fragility curve: no run collapsed." in text(card)
        large = card.xpath('./dl[@class="figures"]//dd[@class="large"]')
        assert [text(cell) for cell in large] == ["0.370 g"]
        rows = table(page, "Verdicts and probabilities of ring by level")[1]
        assert all(row[8] == "–" for row in rows)
        for changes, part in (
            ({"stands": False, "plus": np.nan, "minus": np.nan}, "does not stand"),
            ({"plus": np.inf, "hinges": [], "thrust_plus": None}, "no limit"),
        ):
            page, _ = render(replace(given, arches=[("ring", arch, replace(onset, **changes))]))
            assert part in page
            assert not re.search(r"\b(nan|inf) g", page)

    def test_band_limit_states_measures_and_class(self, full):
        given, page, _ = full
        chance = given.classes["both"].curve.probability(0.35 * GRAVITY)
        heads, rows = table(page, "Answer for each arch")
        assert heads[:2] == ["arch", "P(collapse) at 0.350 g"]
        assert [row[0] for row in rows] == ["both, 2 arches", "thin", "thick"]
        assert rows[0][1].startswith(f"{chance:.2f} (")
        answer = given.answers["thin"]
        fit = answer.likelihood
        assert rows[1][-1] == f"{fit.theta / GRAVITY:#.3g}, {fit.beta:.2f}"
        first, second = page.xpath('//section[@class="arch"]')
        assert f"pointwise band, {answer.method}. {answer.assumptions}" in text(first)
        assert "Nothing contradicts it." in text(first)
        assert "PGV is best." in text(second)
        assert table(page, "Limit states of thin")[1] == [
            ["motion", "a joint opens", "0.102", "0.400"],
            ["impact", "a joint closes (no curve: all collapse)", "–", "–"],
        ]
        assert not page.xpath('//table[@aria-label="Limit states of thick"]')
        rows = table(page, "Intensity measures for thick")[1]
        assert rows[0] == ["PGV (best)", "0.300", "–", "0.500", "0.300", "m/s"]
        assert rows[2] == ["Arias", "–", "–", "0.500", "–", "m/s"]
        (section,) = page.xpath('//section[@id="class0"]')
        assert "0.380 from record to record and 0.120 between its arches" in text(section)
        labels = " ".join(section.xpath(".//@aria-label"))
        assert "Median capacities of 2 arches of both against thickness" in labels

    def test_summary_for_programs(self, full, tmp_path):
        given, _, data = full
        assert [data[k] for k in ("format", "unit", "level")] == ["archfrag-summary/2", "g", 0.35]
        for arch, verdict in zip(data["arches"], given.cube["verdict"].values, strict=True):
            answer = given.answers[arch["id"]]
            _, *band = answer.probability(0.35 * GRAVITY)
            assert arch["curve"]["theta"] == pytest.approx(answer.curve.theta / GRAVITY)
            assert arch["curve"]["maximum_likelihood"]["beta"] == answer.likelihood.beta
            assert arch["counts"]["collapsed"] == (verdict == Verdict.COLLAPSED).sum()
            assert sum(arch["mechanisms"]["mode"].values()) == pytest.approx(1.0, abs=1e-5)
            assert arch["onset"] == pytest.approx({"plus": 0.37001, "minus": 0.37001}, abs=1e-5)
            assert arch["probability"]["interval"] == pytest.approx(band)
        (both,) = data["classes"]
        assert (both["arches"], both["dispersion"]["beta_model"]) == (2, 0.12)
        none = synthetic.inputs(answers={"ring": synthetic.none("no run collapsed")})
        out = write_report(none, tmp_path / "report.html")
        (arch,) = json.loads((out.parent / "summary.json").read_text())["arches"]
        assert (arch["curve"], arch["reason"]) == (None, "no run collapsed")
        assert arch_classes(synthetic.cube(("a", "b"))) == {"a": "a", "b": "b"}

    def test_a_fleet_has_one_file_of_curves(self, tmp_path):
        names = [f"a{i:02d}" for i in range(14)]
        study = synthetic.inputs(names, n_record=3, n_level=5)
        answers = {name: synthetic.answer_of(2.0 + 0.1 * i) for i, name in enumerate(names)}
        kept = [study.arches[i] for i in shown([a.curve.theta for a in answers.values()])]
        write_report(replace(study, answers=answers, arches=kept), tmp_path / "report.html")
        page = lxml.html.document_fromstring((tmp_path / "report.html").read_text())
        heads = [text(head) for head in page.xpath('//section[@class="arch"]/h2')]
        assert heads == ["a00", "a07", "a13"]
        assert len(table(page, "Answer for each arch")[1]) == 14
        files = sorted(path.name for path in tmp_path.iterdir())
        assert files == ["curves.svg", "report.html", "summary.json"]


IM = np.geomspace(0.2, 20.0, 8)
HAZARD = Hazard(
    "PGA", "a.csv", {"mean": HazardCurve(IM, 2e-3 * IM**-2.0), "0.84": HazardCurve(IM, 1e-2 / IM)}
)


def test_risk(drawn):
    data = synthetic.cube(names=("ring", "slab"), items=synthetic.motions(12))
    fits = {"ring": synthetic.answers_of(data)["ring"].curve, "slab": "no curve"}
    risk = risk_of(data, fits, HAZARD)
    list(risk_parts(risk, synthetic.SCALE, "90 %"))
    assert [overlaps(sheet) for sheet in drawn] == 4 * [[]]
    page = read(synthetic.inputs(("ring", "slab"), 12, cube=data, risk=risk))
    assert "No rate: no curve." in text(page)
    heads, rows = table(page, "Rates of collapse")
    contributions = table(page, "Contributions to the rate of collapse of ring")
    assert [row[0] for row in rows] == ["ring", "slab"]
    assert rows[0][1] == f"{risk.arches['ring'].rate.rate:.2g}"
    short = Hazard("PGA", "a.csv", {"mean": HazardCurve(IM[:4], 2e-3 * IM[:4] ** -2.0)})
    bound = synthetic.inputs(("ring", "slab"), 12, cube=data, risk=risk_of(data, fits, short))
    row = table(read(bound), "Rates of collapse")[1][0]
    assert (row[1][:9], row[2], row[3], row[4][:8]) == ("at least ", "–", "–", "at most ")
    for names, given in ((heads, rows), contributions):
        assert all(len(row) == len(names) for row in given)
    of_mechanisms = [float(row[2]) for row in contributions[1] if row[0] == "mechanism"]
    assert sum(of_mechanisms) == pytest.approx(1.0, abs=0.02)


class TestCautions:
    def test_what_concerns_an_arch_is_shown_beside_its_curve(self, study):
        doubts = ["", "PGA 7 g", "", "", "dt 0.2 s", ""]
        data = study.cube.assign(accepted=("record", doubts))
        given = ["ring: runs are unfinished", "motions are scaled by more than 10"]
        page = read(replace(study, cube=data, cautions=given))
        (card,) = page.xpath('//section[@id="arch0"]/div[@class="answer"]/p')
        assert text(card) == "Caution: runs are unfinished."
        (head,) = page.xpath('//header/p[@class="caution"]')
        assert text(head) == "Caution: motions are scaled by more than 10."
        first, second = (study.motions[i].id for i in (1, 4))
        (records,) = page.xpath('//section[@id="motions"]/p[@class="caution"]')
        assert text(records).endswith(f": {first} (PGA 7 g), {second} (dt 0.2 s).")


@pytest.mark.parametrize(
    ("measure", "unit", "factor", "shown"),
    [("PGV", "cm/s", 100.0, "800 cm/s"), ("PGA", "g", 1.0 / GRAVITY, "0.816 g")],
)
def test_levels_are_in_the_unit_of_the_study(measure, unit, factor, shown):
    scale = Scale(measure, unit, factor)
    highest = arch_results(synthetic.cube(), "ring", scale).levels[-1]
    assert f"{digits(highest)} {scale.unit}" == scale.text(8.0) == shown


class TestOffline:
    def test_nothing_is_fetched(self, html, page):
        assert not re.search(r"https?:|@import|url\((?!#)", html)
        assert not page.xpath("//script | //link | //img | //iframe | //object | //embed")
        assert not [name for name in page.xpath("//@*") if str(name).startswith("javascript")]
        (policy,) = page.xpath('//meta[@http-equiv="Content-Security-Policy"]/@content')
        assert policy.startswith("default-src 'none'")
        identifiers = re.findall(r'\bid="([^"]+)"', html)
        assert len(identifiers) == len(set(identifiers))
        used = set(re.findall(r'href="#([^"]+)"', html) + re.findall(r"url\(#([^)]+)\)", html))
        assert used
        assert used <= set(identifiers)

    def test_figures_and_tables_have_a_text_alternative(self, page):
        pictures = page.xpath('//svg[not(@aria-hidden="true")]')
        assert len(pictures) == 2 * 5  # each drawn twice
        assert all(p.get("role") == "img" and len(p.get("aria-label")) > 20 for p in pictures)
        assert len(page.xpath('//*[@class="thumbnails"]/@aria-label')) == 1
        assert all(t.get("aria-label") for t in page.xpath("//table"))
        assert page.get("lang") == "en"

    def test_names_are_text_not_markup(self):
        name = "<script>alert(1)</script> & $x_1$"
        html, _ = render(synthetic.inputs((name,)))
        assert "<script" not in html
        assert name in map(text, lxml.html.document_fromstring(html).xpath("//h2"))


def test_dark_mode_changes_colours_that_figures_have():
    folder = files("archfrag.report")
    css = (folder / "templates" / "report.css").read_text()
    changed = set(re.findall(r'figure \[(?:fill|stroke)="(#\w+)"\]', css))
    sources = [path.read_text() for path in folder.iterdir() if path.name.endswith(".py")]
    assert len(changed) > 8
    assert [colour for colour in changed if f'"{colour}"' not in "".join(sources)] == []


class TestNumbers:
    def test_models_time_and_accuracy(self, study):
        data = study.cube.copy(deep=True)
        failed = data["verdict"] == Verdict.SOLVER_FAILURE
        data["contact_residual"] = data["contact_residual"].where(~failed, 0.7)
        page = read(replace(study, cube=data))
        rows = dict(table(page, "Models, time and accuracy of ring")[1])
        per_second = 1e3 * 0.05 * failed.size / float(data["end_time"].sum())
        assert rows["wall time for one simulated second"] == f"{per_second:#.3g} ms"
        largest = float(data["contact_residual"].where(~failed).max())
        assert rows["contact residual, median and largest"].endswith(f", {largest:.1e}")
        found = rows["contact residual of solver failures, median and largest"]
        assert found == "7.0e-01, 7.0e-01"
        time = data["model_time"].values
        part = time[..., 2].sum()
        expected = f"{part:,.1f} s ({100 * part / time.sum():.1f} %)"
        assert rows["of this, mega-voussoirs"] == expected

    def test_motions_and_the_level_of_their_spectra(self, study):
        first, *others = study.motions
        motions = [replace(first, vertical=first.acceleration), *others]
        page = read(replace(study, motions=motions))
        heads, rows = table(page, "Ground motions as recorded, and their scale factors")
        assert [row[0] for row in rows] == [motion.id for motion in motions]
        peak, factors = np.abs(motions[2].acceleration).max(), study.cube["scale_factor"].values[2]
        assert rows[2][heads.index("PGA [g]")] == f"{peak / GRAVITY:.4f}"
        assert rows[2][-1] == f"{digits(factors.min())} – {digits(factors.max())}"
        assert [row[heads.index("vertical")] for row in rows][:2] == ["yes", "no"]
        intensity = study.cube["intensity"].values
        near = intensity[np.abs(np.log(intensity / study.answers["ring"].curve.theta)).argmin()]
        assert f"scaled to PGA = {near / GRAVITY:#.3g} g, the level nearest to" in text(page)

    def test_provenance(self, study):
        data = study.cube.assign_attrs(
            made="0123abcd", config='{"levels": [0.1]}', note="{no JSON"
        )
        (section,) = read(replace(study, cube=data)).xpath('//section[@id="provenance"]')
        assert {"0123abcd", "CF-1.11", "{no JSON"} <= {text(e) for e in section.xpath(".//td")}
        assert '"levels": [ 0.1 ]' in text(section)


def test_a_failed_write_keeps_the_old_page(study, tmp_path, monkeypatch):
    out = write_report(study, tmp_path / "report.html")
    assert sorted(os.listdir(tmp_path)) == ["curve-ring.svg", "report.html", "summary.json"]
    before = out.read_bytes()

    def no_space(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", no_space)
    with pytest.raises(OutputError, match=r"summary\.json: .*No space left on device"):
        write_report(replace(study, title="another"), out)
    assert out.read_bytes() == before
    assert len(os.listdir(tmp_path)) == 3


def bisected():
    """A study whose records have each been run beside their capacity only."""
    study = synthetic.inputs(n_record=8)
    data = study.cube.copy(deep=True)
    codes = data["verdict"].values[0]
    codes[:] = np.maximum.accumulate(codes == Verdict.COLLAPSED, axis=1)
    first = np.where(codes.any(axis=1), codes.argmax(axis=1), codes.shape[1])
    away = np.abs(np.arange(codes.shape[1]) + 0.5 - first[:, None]) > 0.6
    codes[away] = Verdict.NOT_SIMULATED
    for name in data.data_vars:  # as the cube stores what was not run
        if data[name].dims[:3] == ("arch", "record", "level") and name != "verdict":
            data[name].values[0][away] = np.nan if data[name].dtype.kind == "f" else -1
    note = {"runs": int((~away).sum()), "records": 8, "checked": 3, "contradictions": 1}
    data.attrs["archfrag_design"] = json.dumps({"kind": "ida", "arches": {"ring": note}})
    return replace(study, cube=data, answers=synthetic.answers_of(data)), first


class TestDesigns:
    def test_bisected_levels_show_capacities(self):
        study, first = bisected()
        page = read(study)
        heads, rows = table(page, "Verdicts and probabilities of ring by level")
        assert heads[6] == "records with capacity below"
        below = [(first <= level).mean() for level in range(len(rows))]
        assert [row[6] for row in rows] == [f"{fraction:.3f}" for fraction in below]
        (section,) = page.xpath('//section[@id="arch0"]')
        assert "Design ida: the levels bisected for each record." in text(section)
        assert "Steps: distribution of the capacities of the records" in text(section)
        assert "not simulated" in text(section)
        assert "Each column is all collapses at a level" in text(section)
        assert "nan" not in text(section)
        assert "-" not in dict(table(page, "Models, time and accuracy of ring")[1])["impacts"]
        found = arch_results(study.cube, "ring", synthetic.SCALE)
        levels = np.concatenate([found.levels[:1] ** 2 / found.levels[0], found.levels, [np.inf]])
        middle = np.sqrt(levels[first] * levels[first + 1])
        assert found.capacities == pytest.approx(middle)

    def test_a_level_of_its_own_for_each_run(self):
        """Grouped by intensity: every run is in one group, and groups rise."""
        study = synthetic.inputs(n_record=32, n_level=4)
        data = study.cube.isel(level=[2]).copy(deep=True)
        own = np.random.default_rng(4).uniform(1.0, 8.0, (1, 32, 1))
        own[0, 30:] = np.nan  # records that were not used
        data["intensity"] = (("arch", "record", "level"), own, data["intensity"].attrs)
        data["scale_factor"] = (("arch", "record", "level"), own / 3.0)
        data["verdict"][0, :, 0] = (own[0, :, 0] > 4.0).astype(int)
        data["verdict"][0, 30:, 0] = Verdict.NOT_SIMULATED
        data.attrs["archfrag_design"] = json.dumps({"kind": "cloud"})
        found = arch_results(data, "ring", synthetic.SCALE)
        assert found.simulated.sum(axis=1).tolist() == [1] * 30 + [0] * 2
        assert np.all(np.diff(found.levels) > 0)
        fraction = found.counts.collapsed / found.counts.n
        assert (fraction[0], fraction[-1]) == (0.0, 1.0)
        page = read(replace(study, cube=data, answers=synthetic.answers_of(data)))
        assert "Each point is a group of neighbouring runs" in text(page)
        assert any(label.startswith("30 runs of ring") for label in page.xpath("//@aria-label"))


def study_of(name, vertical, theta=4.0, arches=("ring",), thickness=1.5):
    """Cube of a made-up study with losses of contact in the runs that collapsed."""
    cube = synthetic.cube(arches, theta=theta)
    entries = [{"id": arch, "thickness": thickness} for arch in arches]
    config = {"arches": entries, "motions": {"vertical": vertical}}
    cube.attrs |= {"archfrag_study": name, "archfrag_config": json.dumps(config)}
    cube["intensity"].attrs["measure"] = "PGA"
    return cube


def compared(one, other):
    names = [str(arch) for arch in one["arch"].values]
    return synthetic.inputs(names, cube=one, compared=(other, synthetic.answers_of(other)))


class TestCompare:
    def test_figures_of_both_studies(self):
        one, other = study_of("up", True), study_of("flat", False, 5.0, thickness=1.2)
        given = compared(one, other)
        page = read(given)
        (section,) = page.xpath('//section[@id="compared"]')
        fits = [given.answers["ring"].curve, given.compared[1]["ring"].curve]
        change = 100 * (fits[1].theta / fits[0].theta - 1)
        assert change > 5
        assert f"Change of θ from up to flat: +{change:.1f} %." in text(section)
        for fit, cube, card in zip(
            fits, (one, other), section.xpath('.//div[@class="answer"]'), strict=True
        ):
            large = [text(cell) for cell in card.xpath('./dl//dd[@class="large"]')]
            collapsed = int((cube["verdict"] == Verdict.COLLAPSED).sum())
            assert large[:2] == [f"{fit.theta / GRAVITY:#.3g} g", f"{fit.beta:#.3g}"]
            assert large[2:4] == ["54", str(collapsed)]
        differing = table(page, "Settings in which the studies differ")
        assert differing == (["key", "up", "flat"], [
            ["arches.ring.thickness", "1.5", "1.2"], ["motions.vertical", "True", "False"],
        ])  # fmt: skip

    def test_refused(self):
        one = study_of("up", True)
        given = compared(one, study_of("flat", False, arches=("wall",)))
        with pytest.raises(InputError, match="with 'up': it has no arch ring, but wall"):
            render(given)
        given.compared[0]["intensity"].attrs["measure"] = "Sa(0.5)"
        with pytest.raises(InputError, match=r"with 'up': its levels are of Sa\(0.5\)"):
            render(given)
