"""What `import archfrag` offers, what it does not cost, and what docstrings show."""

import inspect
import subprocess
import sys

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
