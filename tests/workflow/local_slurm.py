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
from dataclasses import dataclass
from pathlib import Path

DAEMONS = ("munged", "slurmctld", "slurmd")
CLIENTS = ("sbatch", "sinfo", "squeue", "scancel", "srun")
# No cgroups and no accounting: neither need be there where tests run.
CONFIGURATION = """\
ClusterName=test
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={controller}
SlurmdPort={node}
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
CredType=cred/munge
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
DefMemPerCPU=1000
SchedulerParameters=batch_sched_delay=0,sched_interval=1,bf_interval=1
SchedulerType=sched/backfill
ReturnToService=2
NodeName={host} NodeAddr=127.0.0.1 CPUs={cores} RealMemory={memory} State=UNKNOWN
PartitionName=all Nodes={host} Default=YES MaxTime=INFINITE State=UP
"""


def why_not() -> str:
    """Why there can be no SLURM here; empty if there can."""
    path = os.pathsep.join([os.environ.get("PATH", ""), "/usr/sbin", "/sbin"])
    missing = [name for name in (*DAEMONS, *CLIENTS) if shutil.which(name, path=path) is None]
    return f"not installed: {', '.join(missing)}" if missing else ""


@dataclass(frozen=True)
class Slurm:
    """A cluster that is up."""

    folder: Path
    environment: dict[str, str]  # with which clients find it

    def ask(self, *command: str) -> str:
        """Standard output of a client."""
        done = subprocess.run(
            command, env=self.environment, capture_output=True, text=True, timeout=30
        )
        return done.stdout.strip()


@contextlib.contextmanager
def local_slurm(cores: int = 4, memory: int = 8000) -> Iterator[Slurm]:
    """Start the daemons, and end them and all jobs with the block."""
    # Sockets' paths must be short: no temporary folder of pytest's.
    folder = Path(tempfile.mkdtemp(prefix="slurm-", dir="/tmp"))
    path = os.pathsep.join([str(folder), os.environ.get("PATH", ""), "/usr/sbin", "/sbin"])
    environment = {**os.environ, "PATH": path, "SLURM_CONF": str(folder / "slurm.conf")}
    slurm = Slurm(folder, environment)
    started: list[subprocess.Popen] = []
    try:
        _write_files(folder, cores, memory)
        _write_srun(folder)
        for command in _commands(folder, path):
            started.append(
                subprocess.Popen(
                    command, env=environment, stdin=subprocess.DEVNULL,
                    stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                )
            )  # fmt: skip
            _wait_until_ready(slurm, started, Path(command[0]).name)
        yield slurm
    finally:
        if len(started) == len(DAEMONS):
            slurm.ask("scancel", f"--user={getpass.getuser()}")
            slurm.ask("scancel", "--signal=KILL", f"--user={getpass.getuser()}")
            wait(lambda: not slurm.ask("squeue", "--noheader"), 10.0)
        for process in reversed(started):
            process.terminate()
            try:
                process.wait(10.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        shutil.rmtree(folder, ignore_errors=True)


def _write_files(folder: Path, cores: int, memory: int) -> None:
    folder.chmod(0o755)
    for name in ("state", "spool"):
        (folder / name).mkdir()
    key = folder / "munge.key"
    key.write_bytes(os.urandom(128))
    key.chmod(0o600)
    controller, node = _free_ports(2)
    (folder / "slurm.conf").write_text(
        CONFIGURATION.format(
            folder=folder, host=socket.gethostname().split(".")[0], user=getpass.getuser(),
            controller=controller, node=node, cores=cores, memory=memory,
        )
    )  # fmt: skip


def _write_srun(folder: Path) -> None:
    """Let `srun` find its cluster: Snakemake's plugin starts it without any SLURM_CONF."""
    script = folder / "srun"
    real = shutil.which("srun")
    script.write_text(f'#!/bin/sh\nSLURM_CONF={folder}/slurm.conf exec {real} "$@"\n')
    script.chmod(0o755)


def _free_ports(count: int) -> list[int]:
    with contextlib.ExitStack() as stack:
        sockets = [stack.enter_context(socket.socket()) for _ in range(count)]
        for each in sockets:
            each.bind(("127.0.0.1", 0))
        return [each.getsockname()[1] for each in sockets]


def _commands(folder: Path, path: str) -> list[list[str]]:
    """Daemons in the foreground, in the order in which they need each other."""
    munged, slurmctld, slurmd = (str(shutil.which(name, path=path)) for name in DAEMONS)
    return [
        # Its folder in /tmp is one that others may write beside: hence by force.
        [munged, "--foreground", "--force", f"--socket={folder}/munge.socket",
         f"--key-file={folder}/munge.key", f"--pid-file={folder}/munged.pid",
         f"--log-file={folder}/munged.log", f"--seed-file={folder}/munged.seed",
         "--num-threads=2"],
        [slurmctld, "-D", "-c"],
        [slurmd, "-D", "-c"],
    ]  # fmt: skip


def _wait_until_ready(slurm: Slurm, started: list[subprocess.Popen], name: str) -> None:
    ready = {
        "munged": lambda: (slurm.folder / "munge.socket").exists(),
        "slurmctld": lambda: bool(slurm.ask("sinfo", "--noheader")),
        "slurmd": lambda: slurm.ask("sinfo", "--noheader", "--format=%t") == "idle",
    }[name]
    if not wait(lambda: started[-1].poll() is not None or ready(), 20.0) or not ready():
        log = slurm.folder / f"{name}.log"
        output = log.read_text(errors="replace")[-3000:] if log.is_file() else "nothing"
        raise RuntimeError(f"{name} does not come up; its output: {output}")


def wait(condition, seconds: float) -> bool:
    """Whether a condition came true in time."""
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(0.1)
    return True
