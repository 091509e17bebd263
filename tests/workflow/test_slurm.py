"""A study whose simulations are jobs of a real SLURM, of one node, started here."""

import json
import signal
import subprocess
import sys
from importlib.util import find_spec

import pytest
import xarray as xr

from archfrag.study.answer.cube import write_cube
from archfrag.study.checks import shipped_folder
from archfrag.study.file.records import prepare_motions
from archfrag.study.file.schema import load_study
from archfrag.study.runs.execute import run_batch
from tests.study.small import ROOT, TEXT, cube_of, small_study
from tests.workflow.local_slurm import local_slurm, wait, why_not

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(bool(why_not()), reason=f"SLURM is {why_not()}"),
    pytest.mark.xdist_group("slurm"),
]
SNAKEFILE = shipped_folder() / "Snakefile"
BATCHES = TEXT.replace("execution: {chunk: 2, workers: 2}", "execution: {batches: 2, workers: 1}")
# A cluster without accounting, and a test that has no time to wait.
QUICK = "slurm-status-command: squeue\nslurm-init-seconds-before-status-checks: 1\n"


@pytest.fixture(scope="module")
def slurm():
    with local_slurm() as found:
        yield found


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """The cube made without SLURM."""
    return cube_of(load_study(small_study(tmp_path_factory.mktemp("alone"))))[1]


@pytest.mark.skipif(
    find_spec("snakemake_executor_plugin_slurm") is None,
    reason="snakemake-executor-plugin-slurm is not installed",
)
def test_batches_are_jobs_by_the_profile(slurm, alone, tmp_path):
    path = small_study(tmp_path, BATCHES)
    profile = tmp_path / "profile"
    profile.mkdir()
    shipped = (ROOT / "configs" / "profiles" / "slurm" / "config.yaml").read_text()
    (profile / "config.yaml").write_text(shipped + QUICK)
    done = subprocess.run(
        [sys.executable, "-m", "snakemake", "--snakefile", SNAKEFILE, "--profile", profile,
         "--config", f"study={path}"],
        env=slurm.environment, capture_output=True, text=True, timeout=300, cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    results = tmp_path / "results" / "small"
    xr.testing.assert_identical(xr.load_dataset(results / "cube.nc"), alone)
    jobs = slurm.ask("squeue", "--states=all", "--noheader", "--format=%T %C").splitlines()
    assert jobs == ["COMPLETED 1"] * 2
    log = json.loads((results / ".archfrag" / "run_log.json").read_text())
    assert sorted((each["batch"], each["runs"]) for each in log) == [(0, 6), (1, 6)]


def test_workers_of_a_scheduler_are_jobs(slurm, alone, tmp_path):
    """`execution.scheduler` by address; `dask worker` is what dask-jobqueue starts too."""
    file = tmp_path / "scheduler.json"
    scheduler = subprocess.Popen(
        [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1",
         "--port", "0", "--no-dashboard", "--scheduler-file", file],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd=tmp_path,
    )  # fmt: skip
    try:
        assert wait(lambda: file.is_file() or scheduler.poll() is not None, 60.0)
        assert scheduler.poll() is None
        address = json.loads(file.read_text())["address"]
        script = tmp_path / "worker.sh"
        script.write_text(
            f"#!/bin/sh\nexec {sys.executable} -m distributed.cli.dask_worker {address} "
            "--nthreads 1 --memory-limit 800MB --no-dashboard --death-timeout 60 "
            f"--local-directory {tmp_path}\n"
        )
        for _ in range(2):
            slurm.ask("sbatch", "--ntasks=1", f"--output={tmp_path}/%j.log", str(script))
        study = load_study(small_study(tmp_path, BATCHES), [f"execution.scheduler={address}"])
        prepare_motions(study)
        logs = [run_batch(study, batch, quiet=True)[0] for batch in range(2)]
        running = slurm.ask("squeue", "--states=running", "--noheader", "--format=%T")
        assert running.split() == ["RUNNING"] * 2
    finally:
        slurm.ask("scancel", "--full", "--state=RUNNING")
        scheduler.send_signal(signal.SIGTERM)
        scheduler.wait(20)
    assert [log["runs"] for log in logs] == [6, 6]
    xr.testing.assert_identical(xr.load_dataset(write_cube(study)), alone)
