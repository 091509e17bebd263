"""What `import archfrag` offers, and what it does not cost."""

import subprocess
import sys

import pytest

import archfrag as af


def ask(code):
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.strip()


@pytest.mark.parametrize("name", af.__all__)
def test_every_name_is_there(name):
    assert getattr(af, name) is not None
    assert name in dir(af)


def test_an_unknown_name_is_refused():
    with pytest.raises(AttributeError, match="no attribute 'simulat'"):
        _ = af.simulat


def test_importing_loads_nothing_heavy():
    heavy = ("numpy", "numba", "scipy", "obspy", "xarray", "matplotlib", "dask")
    code = f"import sys, archfrag; print([m for m in {heavy} if m in sys.modules])"
    assert ask(code) == "[]"


def test_simulate_is_the_function_though_its_module_has_the_same_name():
    code = (
        "import archfrag, archfrag.simulate; from archfrag.simulate import simulate;"
        "print(callable(archfrag.simulate), archfrag.simulate is simulate)"
    )
    assert ask(code) == "True True"


def test_a_worker_that_simulates_loads_neither_obspy_nor_matplotlib():
    code = (
        "import sys, numpy as np, archfrag as af;"
        "af.simulate(af.Block(1.0, 2.0, 0.6), af.Motion(np.zeros(5), 0.01));"
        "print([m for m in ('obspy', 'matplotlib', 'dask', 'xarray') if m in sys.modules])"
    )
    assert ask(code) == "[]"
