"""What `import archfrag` offers, what it does not cost, and what docstrings show and refer to."""

import importlib
import inspect
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

import archfrag as af


def test_names_are_there_and_an_unknown_one_is_refused():
    assert all(getattr(af, name) is not None for name in af.__all__)
    with pytest.raises(AttributeError, match="no attribute 'simulat'"):
        _ = af.simulat


@pytest.mark.parametrize(
    ("code", "printed"),
    [
        ("import archfrag; print([m for m in ('numpy', 'numba', 'scipy', 'obspy', 'xarray', "
         "'matplotlib', 'dask') if m in sys.modules])", "[]"),
        ("import archfrag, archfrag.simulate; from archfrag.simulate import simulate;"
         "print(callable(archfrag.simulate), archfrag.simulate is simulate)", "True True"),
        ("import numpy as np, archfrag as af;"
         "af.simulate(af.Block(1.0, 2.0, 0.6), af.Motion(np.zeros(5), 0.01));"
         "print([m for m in ('obspy', 'matplotlib', 'dask', 'xarray') if m in sys.modules])",
         "[]"),
    ],
    ids=["importing loads nothing heavy", "simulate is a function", "a worker loads no reader"],
)  # fmt: skip
def test_a_new_process(code, printed):
    command = [sys.executable, "-c", f"import sys; {code}"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == printed


@pytest.mark.parametrize(
    "name", sorted({*af.__all__} - {"Arch", "Fragility", "Onset", "Response", "__version__"})
)
def test_public_function_has_an_example(name):
    assert ">>>" in inspect.getdoc(getattr(af, name))


def exists(name):
    """Whether a dotted name is that of a module or of something in one."""
    module, _, last = name.rpartition(".")
    try:
        return hasattr(importlib.import_module(module), last) or bool(find_spec(name))
    except ModuleNotFoundError:
        return False


def test_what_docstrings_refer_to_exists():
    texts = [path.read_text("utf-8") for path in Path(af.__file__).parent.rglob("*.py")]
    names = set(re.findall(r"`(archfrag\.[\w.]+\w)`", " ".join(texts)))
    assert len(names) > 20
    assert [name for name in sorted(names) if not exists(name)] == []
