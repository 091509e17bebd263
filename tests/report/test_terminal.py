"""What `archfrag run` says at its end."""

import re

import pytest

from archfrag.study.answer.fits import gathered
from tests.report import synthetic
from tests.study.small import TEXT, command, small_study

HAZARD = "PGA [g],return period\n0.05,30\n0.2,475\n0.8,15000\n"
MANY = """  - id: many
    profile: block
    width: 0.5
    height: 2.0
    friction: 0.9
    vary: {samples: 2, of: {height: {distribution: uniform, start: 1.9, stop: 2.1}}}
"""


@pytest.fixture(scope="module")
def summary(tmp_path_factory):
    """What is printed after a study of a class of blocks and a block, with a hazard."""
    folder = tmp_path_factory.mktemp("terminal")
    (folder / "hazard.csv").write_text(HAZARD)
    text = (
        TEXT[: TEXT.index("  - {id: ring")] + MANY + TEXT[TEXT.index("  - {id: slab") :]
    )
    text += "risk: {hazard: hazard.csv}\n"
    done = command("run", small_study(folder, text), "--cores", 1)
    assert done.exit_code == 0, done.output
    return done.stdout


def test_cautions_of_members_are_one():
    cube = synthetic.cube(("b1", "b2", "a1", "alone"))
    cube["arch_class"] = ("arch", ["before", "before", "after", "alone"])
    words = "of 24 checks contradict"
    given = [
        f"b1: 3 {words}",
        f"b2: 12 {words}",
        f"a1: 1 {words}",
        f"alone: 2 {words}",
        "records",
    ]
    assert gathered(given, cube, ["alone"]) == [
        f"2 arches of before, such as b1: 3 {words}",
        f"a1: 1 {words}",
        f"alone: 2 {words}",
        "records",
    ]
    assert gathered(given[-2:], cube, []) == given[-2:]


def test_the_summary_has_the_rate_of_collapse(summary):
    rates = re.findall(
        r"^(\w+) +(?:rate (?:at least )?[\d.e-]+ a year|no rate)", summary, re.M
    )
    assert sorted(rates) == ["many", "slab"]


def test_the_summary_says_cautions_of_a_class_once(summary):
    assert not re.findall(r"^! many-0002: ", summary, re.M)
    assert summary.count("arches of many, such as many-000") >= 1
