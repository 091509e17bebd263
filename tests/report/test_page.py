"""The page says what the cube holds, needs nothing but itself, and is written whole."""

import json
import os
import re
import subprocess
import sys
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import lxml.html
import numpy as np
import pytest

from archfrag.errors import InputError, OutputError
from archfrag.fragility.counts import Verdict, count_verdicts
from archfrag.fragility.fit import fit_stripes
from archfrag.report.page import render, write_report
from archfrag.report.summary import arch_results, reading_scale
from tests.report import synthetic


@pytest.fixture(scope="module")
def study():
    return synthetic.inputs()


@pytest.fixture(scope="module")
def html(study):
    return render(study)


@pytest.fixture(scope="module")
def page(html):
    return lxml.html.document_fromstring(html)


def text(element):
    return " ".join(element.text_content().split())


def table(page, label):
    (found,) = page.xpath(f'//table[@aria-label="{label}"]')
    heads = [text(cell) for cell in found.xpath("./thead//th")]
    rows = [[text(cell) for cell in row] for row in found.xpath("./tbody/tr")]
    return heads, rows


class TestAnswer:
    def test_curve_stands_first(self, study, page):
        answer = study.answers["ring"]
        fit = answer.curve
        (card,) = page.xpath('//section[@id="arch0"]/div[@id="arch0-answer"]')
        large = [text(cell) for cell in card.xpath('.//dd[@class="large"]')]
        assert large == [f"{fit.theta / 9.80665:#.3g} g", f"{fit.beta:#.3g}", "0.3700 g"]
        low, high = np.array(answer.theta) / 9.80665
        assert f"90 %: {low:#.3g} to {high:#.3g} g" in text(card)
        low, high = answer.beta
        assert f"90 %: {low:#.3g} to {high:#.3g}" in text(card)

    def test_maximum_likelihood_stands_beside_it(self, study, page):
        counts = count_verdicts(study.cube["verdict"].values[0])
        fit = fit_stripes(study.cube["intensity"].values, counts.collapsed, counts.n)
        (card,) = page.xpath('//section[@id="arch0"]/div[@id="arch0-answer"]')
        assert f"maximum likelihood: {fit.theta / 9.80665:#.3g} g" in text(card)
        assert f"maximum likelihood: {fit.beta:#.3g}" in text(card)

    def test_every_run_is_counted_once(self, study, page):
        verdict = study.cube["verdict"].values
        (counts,) = page.xpath('//dl[@class="figures counts"]')
        shown = dict(
            zip(
                [text(head) for head in counts.xpath(".//dt")],
                [int(text(value)) for value in counts.xpath(".//dd")],
                strict=True,
            )
        )
        assert shown == {
            "runs": verdict.size,
            "collapsed": (verdict == Verdict.COLLAPSED).sum(),
            "standing": (verdict == Verdict.STANDING).sum(),
            "unfinished": 1,
            "solver failures": 1,
            "independent data": 6,
            "island runs": study.answers["ring"].n_islands,
        }

    def test_levels(self, study, page):
        _, rows = table(page, "Verdicts and probabilities of ring by level")
        verdict = study.cube["verdict"].values[0]
        intensity = study.cube["intensity"].values
        assert len(rows) == intensity.size
        for i, row in enumerate(rows):
            fell = (verdict[:, i] == 1).sum()
            stood = (verdict[:, i] == 0).sum()
            assert row[0] == f"{intensity[i] / 9.80665:#.3g}"
            assert [int(cell) for cell in row[1:4]] == [len(verdict), fell, stood]
            assert row[6] == f"{fell / (fell + stood):.3f}"
            assert row[8] == f"{study.answers['ring'].curve.probability(intensity[i]):.3f}"
        # Of six runs at this level one failed: the fraction is of five.
        assert int(rows[-2][5]) == 1
        assert int(rows[-2][2]) + int(rows[-2][3]) == 5

    def test_sentence_where_there_is_no_curve(self, study):
        sentence = "no run collapsed at any level: theta lies above 0.816 (levels in g)"
        calm = study.cube.copy(deep=True)
        calm["verdict"][:] = Verdict.STANDING
        page = lxml.html.document_fromstring(
            render(replace(study, cube=calm, answers={"ring": synthetic.none(sentence)}))
        )
        (card,) = page.xpath('//div[@id="arch0-answer"]')
        assert f"No fragility curve: {sentence}." in text(card)
        # What the arch bears is known without a curve.
        assert [text(cell) for cell in card.xpath('.//dd[@class="large"]')] == ["0.3700 g"]
        assert "No run collapsed." in text(page)
        assert all(
            row[8] == "–" for row in table(page, "Verdicts and probabilities of ring by level")[1]
        )

    def test_one_section_for_each_arch(self):
        page = lxml.html.document_fromstring(render(synthetic.inputs(("thin", "thick"))))
        assert [text(s.xpath("./h2")[0]) for s in page.xpath('//section[@class="arch"]')] == [
            "thin",
            "thick",
        ]
        assert len(page.xpath('//div[@class="answer"]')) == 2

    def test_arch_that_does_not_stand(self, study):
        arch, onset = synthetic.arch_and_onset()
        fallen = replace(
            onset, stands=False, plus=np.nan, minus=np.nan, hinges=[], hinges_minus=[],
            thrust=None, thrust_plus=None, thrust_minus=None,
        )  # fmt: skip
        page = render(replace(study, arches=[("ring", arch, fallen)]))
        assert "does not stand under its own weight" in page
        assert "nan g" not in page

    def test_arch_that_nothing_moves(self, study):
        arch, onset = synthetic.arch_and_onset()
        firm = replace(onset, plus=np.inf, hinges=[], thrust_plus=None)
        page = lxml.html.document_fromstring(render(replace(study, arches=[("ring", arch, firm)])))
        (card,) = page.xpath('//div[@id="arch0-answer"]')
        assert "no limit" in text(card)
        assert "inf g" not in text(card)


class TestCautions:
    def test_a_study_in_order_has_none(self, study):
        calm = study.cube.copy(deep=True)
        calm["verdict"] = calm["verdict"].where(calm["verdict"] < Verdict.UNFINISHED, 0)
        page = lxml.html.document_fromstring(render(replace(study, cube=calm)))
        assert not page.xpath('//*[@class="caution"]')

    def test_what_concerns_an_arch_is_said_beside_its_curve(self, study):
        said = ["ring: runs are unfinished", "motions are scaled by more than 10"]
        page = lxml.html.document_fromstring(render(replace(study, cautions=said)))
        (card,) = page.xpath('//div[@id="arch0-answer"]/p[@class="caution"]')
        assert text(card) == "Caution: runs are unfinished."
        (head,) = page.xpath('//header/p[@class="caution"]')
        assert text(head) == "Caution: motions are scaled by more than 10."

    def test_runs_that_lost_contact_and_stand_are_counted(self, study):
        data = study.cube.copy(deep=True)
        lost = np.where(data["verdict"] == Verdict.COLLAPSED, 3.0, np.nan)
        stood = np.argwhere(data["verdict"].values == Verdict.STANDING)[:4]
        lost[tuple(stood.T)] = 2.0
        data["lost_contact_time"] = (("arch", "record", "level"), lost)
        data.attrs["loss_limit"] = 0.5
        page = lxml.html.document_fromstring(render(replace(study, cube=data)))
        (counts,) = page.xpath('//dl[@class="figures counts"]')
        assert "lost contact and stand 4" in " ".join(text(d) for d in counts.xpath("./div/*"))
        shown = dict(table(page, "Speed and energy figures of ring")[1])
        assert shown["runs that lost all contact at a joint and stand"] == "4"
        assert "passed 50 % of the joint's length" in text(page)

    def test_cubes_that_do_not_say_who_lost_contact_are_shown_without(self, page):
        assert "lost contact and stand" not in text(page)
        assert "of the joint's length" not in text(page)

    def test_records_accepted_against_a_doubt_are_named(self, study):
        doubts = ["", "PGA 7 g", "", "", "dt 0.2 s", ""]
        data = study.cube.assign(accepted=("record", doubts))
        first, second = (study.motions[i].id for i in (1, 4))
        page = lxml.html.document_fromstring(render(replace(study, cube=data)))
        (said,) = page.xpath('//section[@id="motions"]/p[@class="caution"]')
        assert text(said).endswith(f": {first} (PGA 7 g), {second} (dt 0.2 s).")


class TestUnits:
    @pytest.mark.parametrize(
        ("measure", "units", "unit", "shown"),
        [
            ("PGV", "m s-1", "cm/s", "800 cm/s"),
            ("PGV", "m s-1", "m/s", "8.00 m/s"),
            ("PGA", "m s-2", "gal", "800 gal"),
            ("PGA", "m s-2", "g", "0.816 g"),
            ("PGA", "m s-2", None, "0.816 g"),
        ],
    )
    def test_levels_are_in_the_unit_of_the_study(self, measure, units, unit, shown):
        data = synthetic.cube()
        data["intensity"].attrs["units"] = units
        intensity = {"measure": measure, "unit": unit}
        data.attrs["archfrag_config"] = json.dumps({"intensity": intensity} if unit else {})
        scale = reading_scale(data, measure)
        assert arch_results(data, "ring", scale).level_texts[-1] == shown
        assert scale.text(8.0) == shown


class TestOffline:
    def test_nothing_is_fetched(self, html, page):
        assert "http:" not in html
        assert "https:" not in html
        assert not page.xpath("//script | //link | //img | //iframe | //object | //embed")
        assert not re.search(r"@import|url\((?!#)", html)
        assert not [name for name in page.xpath("//@*") if str(name).startswith("javascript")]
        (policy,) = page.xpath('//meta[@http-equiv="Content-Security-Policy"]/@content')
        assert policy.startswith("default-src 'none'")

    def test_identifiers_are_unique_and_resolved(self, html):
        identifiers = re.findall(r'\bid="([^"]+)"', html)
        assert len(identifiers) == len(set(identifiers))
        used = set(re.findall(r'href="#([^"]+)"', html)) | set(
            re.findall(r"url\(#([^)]+)\)", html)
        )
        assert used
        assert used <= set(identifiers)

    def test_figures_have_a_text_alternative(self, page):
        pictures = page.xpath('//svg[not(@aria-hidden="true")]')
        assert len(pictures) == 2 * 8  # each drawn twice
        assert len(page.xpath('//*[@class="thumbnails"]/@aria-label')) == 1
        for picture in pictures:
            assert picture.get("role") == "img"
            assert len(picture.get("aria-label")) > 20
        assert all(t.get("aria-label") for t in page.xpath("//table"))
        assert page.get("lang") == "en"

    def test_names_are_text_not_markup(self):
        name = "<script>alert(1)</script> & $x_1$"
        html = render(synthetic.inputs((name,)))
        assert "<script" not in html
        page = lxml.html.document_fromstring(html)
        assert name in [text(h) for h in page.xpath("//h2")]


class TestSameBytes:
    def test_same_inputs_same_page(self, html):
        assert render(synthetic.inputs()) == html

    def test_in_another_process(self, html):
        code = (
            "from hashlib import sha256; from tests.report import synthetic;"
            "from archfrag.report.page import render;"
            "print(sha256(render(synthetic.inputs()).encode()).hexdigest())"
        )
        found = subprocess.run(
            [sys.executable, "-c", code],
            env={**os.environ, "PYTHONHASHSEED": "12345"},
            cwd=Path(__file__).parents[2],
            capture_output=True,
            text=True,
            check=True,
        )
        assert found.stdout.strip() == sha256(html.encode()).hexdigest()

    def test_from_a_file_as_from_memory(self, study, html, tmp_path):
        study.cube.to_netcdf(tmp_path / "cube.nc")
        assert render(replace(study, cube=tmp_path / "cube.nc")) == html


class TestNumbers:
    def test_wall_time_for_a_simulated_second(self, study, page):
        _, rows = table(page, "Speed and energy figures of ring")
        shown = dict(rows)
        simulated = float(study.cube["end_time"].sum())
        per_second = 1e3 * 0.05 * study.cube["verdict"].size / simulated
        assert shown["wall time for one simulated second"] == f"{per_second:#.3g} ms"
        assert shown["wall time of a run, median and 95 %"] == "0.0500 s, 0.0500 s"
        kept = study.cube["verdict"] != Verdict.SOLVER_FAILURE
        largest = float(study.cube["energy_error"].where(kept).max())
        assert shown["energy error, median and largest"].endswith(f", {largest:.1e}")

    def test_residuals_of_failures_are_told_apart(self, study):
        data = study.cube.copy(deep=True)
        failed = data["verdict"] == Verdict.SOLVER_FAILURE
        data["contact_residual"] = data["contact_residual"].where(~failed, 0.7)
        page = lxml.html.document_fromstring(render(replace(study, cube=data)))
        shown = dict(table(page, "Speed and energy figures of ring")[1])
        kept = float(data["contact_residual"].where(~failed).max())
        assert shown["contact residual, median and largest"].endswith(f", {kept:.1e}")
        told = shown["contact residual of solver failures, median and largest"]
        assert told == "7.0e-01, 7.0e-01"

    def test_no_timings_no_wall_time(self, study):
        page = lxml.html.document_fromstring(render(replace(study, timings=None)))
        _, rows = table(page, "Speed and energy figures of ring")
        assert not [row for row in rows if row[0].startswith("wall time")]

    def test_wall_time_of_other_arches_is_not_mixed_in(self, study):
        page = render(replace(study, timings={**study.timings, "other": [1e6] * 5}))
        assert page == render(study)

    def test_motions(self, study, page):
        heads, rows = table(page, "Ground motions as recorded, and their scale factors")
        assert [row[0] for row in rows] == [motion.id for motion in study.motions]
        peak = np.abs(study.motions[2].acceleration).max()
        assert rows[2][heads.index("PGA [g]")] == f"{peak / 9.80665:.4f}"
        factors = study.cube["scale_factor"].values[2]
        assert rows[2][-1] == f"{factors.min():.2f} – {factors.max():.2f}"

    def test_spectra_are_shown_at_the_level_nearest_the_median(self, study, page):
        intensity = study.cube["intensity"].values
        near = intensity[np.abs(np.log(intensity / study.answers["ring"].curve.theta)).argmin()]
        assert f"scaled to PGA = {near / 9.80665:#.3g} g." in text(page)

    def test_given_spectra_are_used(self, study, html):
        flat = {m.id: (np.array([0.1, 1.0]), np.array([1.0, 1.0])) for m in study.motions}
        assert render(replace(study, spectra=flat)) != html

    def test_provenance(self, study, page):
        (section,) = page.xpath('//section[@id="provenance"]')
        assert "0123abcd" in text(section)
        assert '"measure": "PGA"' in text(section)
        bare = lxml.html.document_fromstring(render(replace(study, provenance={})))
        assert "CF-1.11" in text(bare.xpath('//section[@id="provenance"]')[0])


class TestWrittenWhole:
    def test_written_and_readable(self, study, html, tmp_path):
        out = write_report(study, tmp_path / "report.html")
        assert out.read_text(encoding="utf-8") == html
        assert sorted(os.listdir(tmp_path)) == ["curve-ring.svg", "report.html", "summary.json"]
        assert out.stat().st_mode & 0o777 == 0o644

    def test_a_failed_write_keeps_the_old_page(self, study, tmp_path, monkeypatch):
        out = tmp_path / "report.html"
        out.write_text("old")

        def full(*_):
            raise OSError(28, "No space left on device")

        monkeypatch.setattr(os, "replace", full)
        with pytest.raises(OutputError, match=r"ring\.svg: No space left on device; choose"):
            write_report(study, out)
        assert out.read_text() == "old"
        assert os.listdir(tmp_path) == ["report.html"]

    def test_missing_folder(self, study, tmp_path):
        with pytest.raises(OutputError, match="No such file or directory"):
            write_report(study, tmp_path / "nowhere" / "report.html")


class TestPartsThatDoNotBelongTogether:
    def test_motion_missing(self, study):
        with pytest.raises(InputError, match=f"together: {study.motions[0].id}"):
            render(replace(study, motions=study.motions[1:]))

    def test_fit_missing(self, study):
        with pytest.raises(InputError, match="answers holds none for arch 'ring'"):
            render(replace(study, answers={}))

    def test_arch_missing(self, study):
        arch, onset = synthetic.arch_and_onset()
        with pytest.raises(InputError, match="holds no arch 'wall'; it holds ring"):
            render(
                replace(
                    study,
                    arches=[("wall", arch, onset)],
                    answers={**study.answers, "wall": study.answers["ring"]},
                )
            )

    def test_variable_missing(self, study):
        with pytest.raises(InputError, match="the cube lacks fallbacks"):
            render(replace(study, cube=study.cube.drop_vars("fallbacks")))

    def test_no_cube(self, study, tmp_path):
        (tmp_path / "cube.nc").write_bytes(b"nothing")
        with pytest.raises(InputError, match=r"cube\.nc cannot be read"):
            render(replace(study, cube=tmp_path / "cube.nc"))
