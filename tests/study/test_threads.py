"""A cube is read from many threads, though netCDF's library is not safe in them."""

import subprocess
import sys
from importlib.util import find_spec

import pytest

from archfrag.study.answer.cube import write_cube

# What 16 threads do 200 times.
READINGS = {
    "by archfrag": "float(stored_cube(study)['peak_rotation'].sum()), str(_facts(path))",
    "by h5netcdf": "float(user('h5netcdf')['peak_rotation'].sum())",
    # One thread opens the file, dask's threads read it.
    "by dask": "float(user('netcdf4')['peak_rotation'].sum())",
}
PROGRAM = """import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
import xarray as xr
from archfrag.cli.answers import _facts
from archfrag.study.answer.cube import stored_cube
from archfrag.study.file.schema import load_study

def user(engine):
    with xr.open_dataset(path, chunks={}, engine=engine) as cube:
        return cube.compute(scheduler="threads", num_workers=16)

study = load_study(sys.argv[1])
path = Path(sys.argv[2])
read = lambda _: (READING,)
with ThreadPoolExecutor(THREADS) as threads:
    print(len(set(threads.map(read, range(200)))))
"""


@pytest.mark.parametrize("reading", READINGS)
def test_a_cube_is_opened_200_times_from_16_threads(copied, reading):
    """In a process of its own, since a fault ends it without a word."""
    if reading == "by h5netcdf" and not find_spec("h5netcdf"):
        pytest.skip("h5netcdf is not installed")
    code = PROGRAM.replace("READING", READINGS[reading])
    code = code.replace("THREADS", "1" if reading == "by dask" else "16")
    done = subprocess.run(
        [
            sys.executable,
            "-c",
            code,
            copied.study.folder.parent / "small.yaml",
            write_cube(copied.study),
        ],
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stdout) == (0, "1\n"), done.stderr[-2000:]
