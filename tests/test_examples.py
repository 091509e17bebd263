"""Examples and references in docstrings; pytest runs the examples (--doctest-modules)."""

import importlib.util
import inspect
import re
from pathlib import Path

import pytest

import archfrag as af

FUNCTIONS = ("Block", "Motion", "fit_ida", "fit_stripes", "onset", "read_motion", "simulate")


@pytest.mark.parametrize("name", FUNCTIONS)
def test_public_function_has_an_example(name):
    assert ">>>" in inspect.getdoc(getattr(af, name))


def exists(name):
    """Whether a dotted name is that of a module or of something in one."""
    module, _, last = name.rpartition(".")
    if importlib.util.find_spec(module) is None:
        return False
    if hasattr(importlib.import_module(module), last):
        return True
    try:
        return importlib.util.find_spec(name) is not None
    except ModuleNotFoundError:
        return False


def test_what_docstrings_refer_to_exists():
    texts = [path.read_text("utf-8") for path in Path(af.__file__).parent.rglob("*.py")]
    names = set(re.findall(r"`(archfrag\.[\w.]+\w)`", " ".join(texts)))
    assert len(names) > 20
    assert [name for name in sorted(names) if not exists(name)] == []
