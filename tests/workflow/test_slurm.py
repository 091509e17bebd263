"""A study whose simulations are jobs of a real SLURM, started here: no system service is used."""

import contextlib
import getpass
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import pytest
import xarray as xr

from archfrag.study.answer.cube import write_cube
from archfrag.study.file.prepared import prepare_motions
from archfrag.study.file.schema import load_study
from archfrag.study.runs.execute import run_batch
from archfrag.study.validate import shipped_folder
from tests.study.small import ROOT, TEXT, cube_of, small_study

CLIENTS = ("sbatch", "sinfo", "squeue", "scancel", "srun")
DAEMONS = {  # in the order in which they need each other, each with its options
    # Its folder in /tmp is one that others may write beside: hence by force.
    "munged": "--foreground --force --socket={0}/munge.socket --key-file={0}/munge.key "
    "--pid-file={0}/munged.pid --log-file={0}/munged.log --seed-file={0}/munged.seed "
    "--num-threads=2",
    "slurmctld": "-D -c",
    "slurmd": "-D -c",
}
_PATH = os.pathsep.join([os.environ.get("PATH", ""), "/usr/sbin", "/sbin"])


def why_not() -> str:
    """Why there can be no SLURM here; empty if there can."""
    missing = [
        name for name in (*DAEMONS, *CLIENTS) if shutil.which(name, path=_PATH) is None
    ]
    return f"not installed: {', '.join(missing)}" if missing else ""


class Slurm(NamedTuple):
    folder: Path
    environment: dict[str, str]  # with which clients find it

    def ask(self, *command: str) -> str:
        given = {"capture_output": True, "text": True, "timeout": 30}
        return subprocess.run(command, env=self.environment, **given).stdout.strip()


@pytest.fixture(scope="module")
def slurm() -> Iterator[Slurm]:
    """Start the daemons, and end them and all jobs with the block."""
    # Sockets' paths must be short: no temporary folder of pytest's.
    folder = Path(tempfile.mkdtemp(prefix="slurm-", dir="/tmp"))
    path = os.pathsep.join([str(folder), _PATH])
    slurm = Slurm(
        folder, {**os.environ, "PATH": path, "SLURM_CONF": f"{folder}/slurm.conf"}
    )
    started: list[subprocess.Popen] = []
    try:
        _write_files(folder)
        for name, options in DAEMONS.items():
            command = [
                str(shutil.which(name, path=_PATH)),
                *options.format(folder).split(),
            ]
            none = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.DEVNULL)
            started.append(subprocess.Popen(command, env=slurm.environment, **none))
            _wait_until_ready(slurm, started[-1], name)
        yield slurm
    finally:
        if len(started) == len(DAEMONS):
            slurm.ask("scancel", f"--user={getpass.getuser()}")
            slurm.ask("scancel", "--signal=KILL", f"--user={getpass.getuser()}")
            wait(lambda: not slurm.ask("squeue", "--noheader"), 10.0)
        for process in reversed(started):
            process.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(10.0)
            process.kill()
            process.wait()
        shutil.rmtree(folder, ignore_errors=True)


def _write_files(folder: Path) -> None:
    folder.chmod(0o755)
    for name in ("state", "spool"):
        (folder / name).mkdir()
    (folder / "munge.key").write_bytes(os.urandom(128))
    (folder / "munge.key").chmod(0o600)
    with socket.socket() as one, socket.socket() as two:
        for each in (one, two):
            each.bind(("127.0.0.1", 0))
        controller, node = (each.getsockname()[1] for each in (one, two))
    configuration = (
        Path(__file__)
        .with_name("slurm.conf")
        .read_text()
        .format(
            folder=folder,
            host=socket.gethostname().split(".")[0],
            user=getpass.getuser(),
            controller=controller,
            node=node,
            cores=4,
            memory=8000,
        )
    )
    (folder / "slurm.conf").write_text(configuration)
    # Snakemake's plugin starts `srun` without any SLURM_CONF.
    script = folder / "srun"
    real = shutil.which("srun")
    script.write_text(f'#!/bin/sh\nSLURM_CONF={folder}/slurm.conf exec {real} "$@"\n')
    script.chmod(0o755)


def _wait_until_ready(slurm: Slurm, process: subprocess.Popen, name: str) -> None:
    ready = {
        "munged": lambda: (slurm.folder / "munge.socket").exists(),
        "slurmctld": lambda: bool(slurm.ask("sinfo", "--noheader")),
        "slurmd": lambda: slurm.ask("sinfo", "--noheader", "--format=%t") == "idle",
    }[name]
    if not wait(lambda: process.poll() is not None or ready(), 20.0) or not ready():
        log = slurm.folder / f"{name}.log"
        output = log.read_text(errors="replace")[-3000:] if log.is_file() else "nothing"
        raise RuntimeError(f"{name} does not come up; its output: {output}")


def wait(condition, seconds: float) -> bool:
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(0.1)
    return True


pytestmark = [
    pytest.mark.skipif(bool(why_not()), reason=f"SLURM is {why_not()}"),
    pytest.mark.xdist_group("slurm"),
]
SNAKEFILE = shipped_folder() / "Snakefile"
BATCHES = TEXT.replace(
    "execution: {chunk: 2, workers: 2}", "execution: {batches: 2, workers: 1}"
)
# A cluster without accounting, and a test that has no time to wait.
QUICK = "slurm-status-command: squeue\nslurm-init-seconds-before-status-checks: 1\n"


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
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
        [
            sys.executable,
            "-m",
            "snakemake",
            "--snakefile",
            SNAKEFILE,
            "--profile",
            profile,
            "--config",
            f"study={path}",
        ],
        env=slurm.environment,
        capture_output=True,
        text=True,
        timeout=300,
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    results = tmp_path / "results" / "small"
    xr.testing.assert_identical(xr.load_dataset(results / "cube.nc"), alone)
    jobs = slurm.ask(
        "squeue", "--states=all", "--noheader", "--format=%T %C"
    ).splitlines()
    assert jobs == ["COMPLETED 1"] * 2
    log = json.loads((results / ".archfrag" / "run_log.json").read_text())
    assert sorted((each["batch"], each["runs"]) for each in log) == [(0, 6), (1, 6)]


def test_workers_of_a_scheduler_are_jobs(slurm, alone, tmp_path):
    """`execution.scheduler` by address; `dask worker` is what dask-jobqueue starts too."""
    file = tmp_path / "scheduler.json"
    scheduler = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "distributed.cli.dask_scheduler",
            "--host",
            "127.0.0.1",
            "--port",
            "0",
            "--no-dashboard",
            "--scheduler-file",
            file,
        ],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        cwd=tmp_path,
    )
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
            slurm.ask(
                "sbatch", "--ntasks=1", f"--output={tmp_path}/%j.log", str(script)
            )
        study = load_study(
            small_study(tmp_path, BATCHES), [f"execution.scheduler={address}"]
        )
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
