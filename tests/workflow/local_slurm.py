"""A SLURM of one node in a folder of its own: no service of the system is used or touched."""

import contextlib
import getpass
import os
import shutil
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

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
    missing = [name for name in (*DAEMONS, *CLIENTS) if shutil.which(name, path=_PATH) is None]
    return f"not installed: {', '.join(missing)}" if missing else ""


class Slurm(NamedTuple):
    """A cluster that is up."""

    folder: Path
    environment: dict[str, str]  # with which clients find it

    def ask(self, *command: str) -> str:
        """Standard output of a client."""
        given = {"capture_output": True, "text": True, "timeout": 30}
        return subprocess.run(command, env=self.environment, **given).stdout.strip()


@contextlib.contextmanager
def local_slurm() -> Iterator[Slurm]:
    """Start the daemons, and end them and all jobs with the block."""
    # Sockets' paths must be short: no temporary folder of pytest's.
    folder = Path(tempfile.mkdtemp(prefix="slurm-", dir="/tmp"))
    path = os.pathsep.join([str(folder), _PATH])
    slurm = Slurm(folder, {**os.environ, "PATH": path, "SLURM_CONF": f"{folder}/slurm.conf"})
    started: list[subprocess.Popen] = []
    try:
        _write_files(folder)
        for name, options in DAEMONS.items():
            command = [str(shutil.which(name, path=_PATH)), *options.format(folder).split()]
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
    configuration = Path(__file__).with_name("slurm.conf").read_text().format(
        folder=folder, host=socket.gethostname().split(".")[0], user=getpass.getuser(),
        controller=controller, node=node, cores=4, memory=8000,
    )  # fmt: skip
    (folder / "slurm.conf").write_text(configuration)
    # Snakemake's plugin starts `srun` without any SLURM_CONF.
    script, real = folder / "srun", shutil.which("srun")
    script.write_text(f'#!/bin/sh\nSLURM_CONF={folder}/slurm.conf exec {real} "$@"\n')
    script.chmod(0o755)


def _wait_until_ready(slurm: Slurm, process: subprocess.Popen, name: str) -> None:
    ready = {
        "munged": lambda: (slurm.folder / "munge.socket").exists(),
        "slurmctld": lambda: bool(slurm.ask("sinfo", "--noheader")),
        "slurmd": lambda: slurm.ask("sinfo", "--noheader", "--format=%t") == "idle",
    }[name]
    if not wait(lambda: process.poll() is not None or ready(), 20.0) or not ready():
        raise RuntimeError(f"{name} does not come up: see {slurm.folder / name}.log")


def wait(condition, seconds: float) -> bool:
    """Whether a condition came true in time."""
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(0.1)
    return True
