"""The commands and the script of docs/howto/cluster.md do what the page says."""

import contextlib
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import xarray as xr

from archfrag.study.answer.cube import write_cube
from tests.study.small import ROOT, TEXT, small_study

PAGE = (ROOT / "docs" / "howto" / "cluster.md").read_text()
BLOCKS = re.findall(r"^```(bash|python)\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)


def block(language, words):
    """The one block of the page with these words."""
    (found,) = (text for kind, text in BLOCKS if kind == language and words in text)
    return found


@pytest.fixture(scope="module")
def cube(done):
    return xr.load_dataset(write_cube(done.study))


@pytest.mark.parametrize(
    ("language", "words", "said"),
    [
        ("bash", "archfrag run study.yaml --cores 2", "12 new"),
        (
            "bash",
            "dask scheduler",
            "cluster .*scheduler.json: (2 threads|no worker yet)",
        ),
        (
            "python",
            "LocalCluster",
            "cluster tcp://.*: (2 threads|1 thread|no worker yet)",
        ),
    ],
    ids=["threads", "scheduler", "notebook"],
)
def test_the_page_runs_as_it_stands(cube, tmp_path, language, words, said):
    text = block(language, words)
    small_study(tmp_path, TEXT.replace(", workers: 2", ""), "study.yaml")
    here = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    script = tmp_path / f"block.{language}"
    script.write_text(text)
    process = subprocess.Popen(
        ["bash" if language == "bash" else sys.executable, str(script)],
        cwd=tmp_path,
        env={**os.environ, "PATH": here},
        stdout=subprocess.DEVNULL,
        stderr=(tmp_path / "said").open("w"),
        start_new_session=True,
    )
    try:
        code = process.wait(90)
    finally:
        with contextlib.suppress(
            ProcessLookupError
        ):  # nothing is left in the background
            os.killpg(process.pid, signal.SIGKILL)
    told = (tmp_path / "said").read_text()
    assert (code, bool(re.search(said, told))) == (0, True), told
    made = xr.load_dataset(tmp_path / "out" / "cube.nc")
    assert set(made) == set(cube)
    for name in set(cube) - {"wall_time"}:
        xr.testing.assert_equal(made[name], cube[name])


def test_what_cannot_run_here_is_at_least_python():
    compile(block("python", "SLURMCluster"), "page", "exec")
