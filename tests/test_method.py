"""METHOD.md: every equation has a function and a test, and both exist."""

import importlib
import inspect
import re
from pathlib import Path

import pytest

TESTS = Path(__file__).parent
TEXT = (TESTS.parent / "pipeline" / "METHOD.md").read_text(encoding="utf-8")
ROW = re.compile(r"^\| (\d+) \| [^|]+ \| `([\w.]+):(\w+)` \| `([\w/.]+)(?:::(\w+))?` \|$", re.M)
ROWS = ROW.findall(TEXT)


def equations_named(text):
    """Numbers that follow Eq or Eqs, with lists and ranges."""
    found = set()
    for group in re.findall(r"Eqs? ([\d ,ab]+(?:(?:-| to | and )[\d ,ab]+)*)", text):
        spread = re.sub(r" to ", "-", group).replace(" and ", ",")
        for part in re.split(r"[ ,]+", spread):
            first, _, last = re.sub("[ab]", "", part).partition("-")
            if first.isdigit():
                found |= set(range(int(first), int(last or first) + 1))
    return found


def test_every_equation_has_a_row():
    assert [int(row[0]) for row in ROWS] == list(range(1, 36))


@pytest.mark.parametrize(("number", "module", "name", "file", "test"), ROWS)
def test_function_and_test_exist_and_the_code_names_the_equation(number, module, name, file, test):
    home = importlib.import_module(f"archfrag.{module}")
    assert callable(getattr(home, name))
    assert int(number) in equations_named(inspect.getsource(home))
    text = (TESTS / file).read_text(encoding="utf-8")
    assert not test or re.search(rf"^(class|def) {test}\b", text, re.M)


def test_every_other_name_in_it_exists():
    named = re.findall(r"`([a-z_]+(?:\.[a-z_]+)+)(?::(\w+))?`", TEXT)
    assert len(named) > 40
    for module, name in named:
        if module.endswith((".py", ".md")):
            continue
        home = importlib.import_module(f"archfrag.{module}")
        assert not name or hasattr(home, name), f"{module}:{name}"
