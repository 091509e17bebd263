"""A study of an arch before and after: ties, springings that moved, strength, delay."""

import html
import math
import re

import pytest

import archfrag as af
from archfrag.report import make_report
from archfrag.study.file.schema import load_study
from archfrag.study.steps import run_study
from tests.study.small import ROOT

TEXT = f"""
id: strengthened
title: An arch before and after
output: results
arches:
  - &arch {{id: before, profile: circular, radius: 10, thickness: 1.5, embrace: 157.5,
    voussoirs: 7, friction: 0.7}}
  - {{<<: *arch, id: same}}
  - {{<<: *arch, id: after, ties: [{{level: 6, area: 5.0e-4, strength: 1.0e+5}}]}}
  - {{<<: *arch, id: spread, springings: {{spread: 0.2}}, strength: 4.0e+6}}
motions: {{index: {ROOT / "records/near_source/index.csv"}}}
intensity: {{measure: PGA, unit: g, levels: [0.5, 1.0, 1.5, 2.0, 2.8, 4.0]}}
risk: {{hazard: {ROOT / "configs/hazard.csv"}}}
"""


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    path = tmp_path_factory.mktemp("strengthened") / "study.yaml"
    path.write_text(TEXT)
    run_study(load_study(path), path, lambda: None, make_report, 1, quiet=True)
    return af.open(path)


def test_equal_arches_have_a_ratio_of_one_without_a_band(results):
    table = results.compare("before", "same")
    assert table.loc["theta", ["ratio", "lower", "upper"]].tolist() == [1.0, 1.0, 1.0]
    assert table.loc["rate", ["ratio", "lower", "upper"]].tolist() == [1.0, 1.0, 1.0]


def test_a_tie_and_a_spread_change_the_curve_and_common_motions_narrow_the_band(
    results,
):
    runs = results.runs
    verdicts = {
        name: runs["verdict"].sel(arch=name).values for name in ("before", "after")
    }
    assert (verdicts["before"] != verdicts["after"]).any()
    table = results.compare("before", "spread")
    low, ratio, high = table.loc["theta", ["lower", "ratio", "upper"]]
    assert low < ratio < high
    capacity = results.capacities.set_index("arch").capacity.dropna()
    apart = capacity.loc["before"].apply(math.log).std() * math.sqrt(2.0 / 24.0)
    assert math.log(high / low) < 2.0 * 1.645 * apart * 1.5


def test_the_report_tells_the_ratios_with_their_intervals(results):
    page = html.unescape(re.sub(r"<[^>]+>", " ", results.report().read_text("utf-8")))
    page = re.sub(r"\s+", " ", page)
    for what, row in (("median capacity θ [g]", "theta"), ("collapses a year", "rate")):
        ratio, low, high = results.compare("before", "after").loc[
            row, ["ratio", "lower", "upper"]
        ]
        words = f"{ratio:.2f} {low:.2f} to {high:.2f}"
        assert re.search(
            rf"after before {re.escape(what)} \S+ \S+ {re.escape(words)}", page
        )


def test_the_same_arch_of_another_study_on_the_same_motions(results):
    again = af.open(results.folder)
    table = results.compare("before", "after", other=again)
    assert table.equals(results.compare("before", "after"))


def test_messages(results, tmp_path):
    for write in (results.to_pelicun, results.to_csv, results.to_incore):
        with pytest.raises(
            af.errors.InputError, match="is written into a folder; give the folder"
        ):
            write(tmp_path / "curves.csv")
    assert not list(tmp_path.iterdir())
    with pytest.raises(
        af.errors.InputError, match="no arch or class 'nobody'; the study"
    ):
        results.compare("before", "nobody")


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ("springings: {spread: 9}", "falls at spread .* m of its right springing"),
        (
            "ties: [{level: 6, area: 0.001, prestress: 2.0e+6}]",
            r"prestress of its ties \(tie 1 \(level 6 m\): 2e\+06 N, at most",
        ),
        (
            "springings: {spread: 0.1}, ties: [{level: 6, area: 0.001, prestress: 2.0e+6}]",
            r"falls when its tie 1 \(level 6 m\) gets a prestress of 2e\+06 N; it stands with",
        ),
        (
            "ties: [{level: 6, area: 0.001, prestress: 2.0e+4, rupture: 0.001}]",
            "rupture = 0.001 m is impossible; the tie is 0.00178. m longer at rest",
        ),
        (
            "ends: {height: 4, width: 2}, depth: [1, 1, 1, .6, 1, 1, 1], strength: 1000",
            "does not stand with a strength of 1000 N/m2",
        ),
        ("strength: 1000", "does not stand with a strength of 1000 N/m2"),
        ("ties: [{level: 60, area: 0.001}]", "level = 60 m is impossible for a tie"),
        ("ties: [{area: 0.001}]", r"arches\[3\].ties\[0\].level must be given"),
    ],
)
def test_what_cannot_be_built_is_refused_with_the_key(tmp_path, keys, message):
    path = tmp_path / "study.yaml"
    path.write_text(TEXT.replace("springings: {spread: 0.2}, strength: 4.0e+6", keys))
    with pytest.raises(af.errors.ArchfragError, match=message):
        run_study(
            load_study(path), path, lambda: None, lambda *given: None, 1, quiet=True
        )


def test_motions_of_bases_are_keys_of_the_method(tmp_path):
    path = tmp_path / "study.yaml"
    path.write_text(TEXT + "method: {bases: {right: 0.05}}\n")
    assert load_study(path).method.bases == {"right": 0.05}
    path.write_text(TEXT + "method: {wave_speed: -400}\n")
    assert load_study(path).method.wave_speed == -400.0
