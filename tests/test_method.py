"""METHOD.md and the pages of the method: what they name exists, figures are right."""

import importlib
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.transforms import IdentityTransform

from archbench.paper.block import Mechanism, uniform_block
from archbench.paper.regions import starting_region

TESTS = Path(__file__).parent
TEXT = (TESTS.parent / "pipeline" / "METHOD.md").read_text(encoding="utf-8")
PLACE = r" \| `([\w.]+):(\w+)`"
ROW = re.compile(
    r"^\| (\d+) \| [^|]+" + 2 * PLACE + r" \| `([\w/.]+)::(\w+)` \|$", re.M
)
ROWS = ROW.findall(TEXT)
PAGES = TESTS.parent / "docs" / "method"
sys.path[:0] = [str(PAGES), str(PAGES.parent / "extensions")]

from figures import block, equations  # noqa: E402


def equations_named(text):
    """Numbers that follow Eq or Eqs, with lists and ranges."""
    found = set()
    for group in re.findall(
        r"Eqs? (\d+[ab]*(?:(?:-|, ?| to | and |, and )\d+[ab]*)*)", text
    ):
        for first, last in re.findall(r"(\d+)[ab]*(?:(?:-| to )(\d+))?", group):
            found |= set(range(int(first), int(last or first) + 1))
    return found


def test_every_equation_has_a_row_and_lists_are_read():
    assert [int(row[0]) for row in ROWS] == list(range(1, 36))
    assert equations_named("Eqs 2, 5a-7b and 9 to 11; Eq 20") == {
        2,
        5,
        6,
        7,
        9,
        10,
        11,
        20,
    }


@pytest.mark.parametrize("row", ROWS)
def test_twin_kernel_and_test_exist_and_the_twin_names_the_equation(row):
    number, formulas, twin, module, kernel, file, test = row
    assert callable(getattr(importlib.import_module(f"archfrag.{module}"), kernel))
    formula = getattr(importlib.import_module(formulas), twin)
    assert int(number) in equations_named(formula.__doc__)
    text = (TESTS / file).read_text(encoding="utf-8")
    assert re.search(rf"^(class|def) {test}\b", text, re.M)


def test_every_other_name_in_it_exists():
    named = re.findall(r"`([a-z_]+(?:\.[a-z_]+)+)(?::(\w+))?`", TEXT)
    assert len(named) > 40
    for module, name in named:
        if module.endswith((".py", ".md")):
            continue
        own = module.startswith("archbench")
        home = importlib.import_module(module if own else f"archfrag.{module}")
        assert not name or hasattr(home, name), f"{module}:{name}"


class TestPages:
    def test_show_every_equation_with_its_function(self):
        text = "".join(path.read_text(encoding="utf-8") for path in PAGES.glob("*.md"))
        tags = re.findall(r"\\tag\{(\d+)[ab]?\}", text)
        assert sorted(map(int, tags)) == sorted([*range(1, 36), 23])
        calls = ", ".join(re.findall(r"holds\(([\d, ]+)\)", text))
        assert list(map(int, calls.split(","))) == list(range(1, 36))

    def test_rows_are_those_of_the_table(self):
        assert {number: found[1:] for number, found in equations.rows().items()} == {
            int(number): (f"{a}:{b}", f"{c}:{d}", f"{e}::{f}")
            for number, a, b, c, d, e, f in ROWS
        }
        assert "four_hinges" in equations.holds(29).data


@pytest.mark.parametrize("slenderness", [0.2, 1.0])
def test_the_shade_of_a_point_in_a_figure_is_that_of_its_motion(
    slenderness, monkeypatch
):
    monkeypatch.setattr(block, "shown", lambda figure, *_: figure)
    first, second, third, _ = block.starting_regions(slenderness).axes
    body = uniform_block(slenderness, 1.0, 1.0)
    rng = np.random.default_rng(1)
    seen = set()
    for x, y in rng.uniform(
        [-2.5 * slenderness, 0.0], [2.5 * slenderness, 2.5], (300, 2)
    ):
        mu = slenderness * y
        level = 0.7 * y - 1.0
        for axes, place, at in (
            (first, mu, (0.0, mu)),
            (second, mu, (-0.4, mu)),
            (third, level, (level, 1.5 * slenderness)),
        ):
            shades = set()
            for shape in [*axes.collections, *axes.patches]:
                of_one = not hasattr(shape, "get_paths")
                paths = [shape.get_path()] if of_one else shape.get_paths()
                to_data = shape.get_patch_transform() if of_one else IdentityTransform()
                if any(
                    path.transformed(to_data).contains_point((x, place))
                    for path in paths
                ):
                    shades.add(to_hex(np.ravel(shape.get_facecolor())))
            mechanism = starting_region(body, x, *at)
            assert block._SHADE[mechanism] in shades
            seen.add(mechanism)
    assert seen >= set(Mechanism) - {Mechanism.LIFT_OFF}
