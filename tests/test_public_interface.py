"""What `import archfrag` offers, what it does not cost, and what docstrings show."""

import doctest
import inspect
import pydoc
import re
import subprocess
import sys

import pytest

import archfrag as af


def test_names_are_there_and_an_unknown_one_is_refused():
    assert all(getattr(af, name) is not None for name in af.__all__)
    with pytest.raises(AttributeError, match=r"No archfrag attribute simulat$"):
        _ = af.simulat


@pytest.mark.parametrize(
    ("code", "printed"),
    [
        (
            "import archfrag; print([m for m in ('numpy', 'numba', 'scipy', 'obspy', 'xarray', "
            "'matplotlib', 'dask') if m in sys.modules])",
            "[]",
        ),
        (
            "import numpy as np, archfrag as af;"
            "af.simulate(af.Block(1.0, 2.0, 0.6), af.Motion(np.zeros(5), 0.01));"
            "print([m for m in ('obspy', 'matplotlib', 'dask', 'xarray') if m in sys.modules])",
            "[]",
        ),
        (
            "import archfrag.cli.study; print([m for m in ('scipy.signal', 'scipy.stats', "
            "'scipy.optimize', 'scipy.interpolate', 'archfrag.export.command', 'dask', "
            "'matplotlib') if m in sys.modules])",
            "[]",
        ),
        (
            "import archfrag.motions.formats; print([m for m in ('scipy.special', 'scipy.signal', "
            "'pandas', 'numba', 'pydantic') if m in sys.modules])",
            "[]",
        ),
    ],
    ids=[
        "importing loads nothing heavy",
        "a worker loads no reader",
        "a run loads parts of scipy when it uses them",
        "the process that reads records loads no scipy",
    ],
)
def test_a_new_process(code, printed):
    command = [sys.executable, "-c", f"import sys; {code}"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == printed


PUBLIC = [name for name in af.__all__ if not isinstance(getattr(af, name), str)]
SCREEN = (50, 100)  # lines, columns


def help_lines(thing):
    """Lines of a screen that `help` fills, of a class up to its methods."""
    text = pydoc.plain(pydoc.render_doc(thing)).rstrip()
    head = re.split(r" \|  (?:Class m|Static m|M)ethods defined here:", text)[0]
    # Since 3.13 each parameter of a long signature has a line of its own.
    if found := re.search(r"\(\n.*?\n[ |]*\)", head, re.S):
        head = head.replace(found[0], re.sub(r"\n[ |]*", " ", found[0]))
    return sum(
        max(1, -(-len(line) // SCREEN[1])) for line in head.rstrip(" |\n").split("\n")
    )


@pytest.mark.parametrize("name", PUBLIC)
def test_help_fits_a_screen_and_its_example_runs(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    thing = getattr(af, name)
    own = vars(thing) if inspect.isclass(thing) else {}
    methods = [getattr(thing, key) for key in own if not key.startswith("_")]
    for each in (thing, *filter(inspect.isroutine, methods)):
        assert help_lines(each) <= SCREEN[0], each
        assert "numpy._typing" not in str(inspect.signature(each))
    (test,) = doctest.DocTestFinder(recurse=False).find(thing, name)
    assert test.examples or thing in (
        af.Curve,
        af.Results,
    )  # what a run of a study returns
    assert doctest.DocTestRunner(verbose=False).run(test).failed == 0
