"""Stop a study at random moments of every step, and resume it: what is left, and is it the same?

    python tests/benchmarks/run_stops.py --stops 20

Each run of a small study is stopped several times, in later and later steps, by SIGTERM, SIGINT or
SIGKILL of the parent, its group or the whole tree, and then resumed to its end. Said are how long
the last process took to end, and whether the cube is the undisturbed run's to the last bit (which
names the state of the checkout: leave that alone meanwhile).
"""

import argparse
import contextlib
import hashlib
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import psutil

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.study.small import TEXT, small_study

STUDY = TEXT.replace("chunk: 2", "chunk: 1").replace("dt: 2.0e-3", "dt: 1.0e-4")
# A step is at work once the file that the step before leaves is there.
AT_WORK = {
    "start": "lock", "motions": "study.yaml", "batch": "steps/motions.json",
    "cube": "steps/batch-0of1.json", "fit": "steps/cube.json", "report": "steps/fit.json",
}  # fmt: skip
KINDS = (
    (signal.SIGTERM, "parent"), (signal.SIGINT, "group"), (signal.SIGKILL, "tree"),
    (signal.SIGINT, "parent"), (signal.SIGTERM, "tree"), (signal.SIGKILL, "parent"),
)  # fmt: skip
LIMIT = 5.0  # for the last process to end [s]


@dataclass
class Stop:
    """One stop, and what came of it."""

    step: str
    number: signal.Signals
    whom: str
    processes: int = 0
    took: float = 0.0
    left: int = 0
    said: int = 0
    code: int | None = None

    @property
    def good(self) -> bool:
        """Whether nothing was left, and what is to be said was said once."""
        if self.number == signal.SIGKILL:
            return self.whom == "parent" or self.left == 0
        return (
            self.left == 0
            and self.took < LIMIT
            and self.said == 1
            and self.code == 128 + self.number
        )


def start(path: Path, *options: str) -> subprocess.Popen:
    """`archfrag run` in a group of its own, that hears SIGINT though this runs behind a script."""
    return subprocess.Popen(
        [sys.executable, "-m", "archfrag.cli", "run", str(path), "--quiet", *options],
        stderr=subprocess.PIPE, text=True, start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip


def stop_in(stop: Stop, path: Path, options: list[str], dice: random.Random) -> bool:
    """Start a run, and stop it in a step; False if it was done before."""
    work = path.parent / "out" / ".archfrag"
    process = start(path, *options)
    while not (work / AT_WORK[stop.step]).exists() and process.poll() is None:
        time.sleep(0.02)
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(dice.uniform(0.0, 3.0))
    if process.poll() is not None:
        if process.returncode != 0:
            raise SystemExit(process.communicate()[1])
        return False
    children = psutil.Process(process.pid).children(recursive=True)
    stop.processes = 1 + len(children)
    began = time.monotonic()
    if stop.whom == "group":
        os.killpg(process.pid, stop.number)
    else:
        process.send_signal(stop.number)
    for child in children if stop.whom == "tree" else ():
        with contextlib.suppress(psutil.NoSuchProcess):
            child.send_signal(stop.number)
    try:
        said = process.communicate(timeout=60)[1]
    except subprocess.TimeoutExpired:
        raise SystemExit(f"{stop}: of {children} there are still {_alive(children)}") from None
    _, alive = psutil.wait_procs(children, timeout=max(0.0, LIMIT - time.monotonic() + began))
    stop.took, stop.left = time.monotonic() - began, len(alive)
    psutil.wait_procs(alive, timeout=30.0)
    stop.said, stop.code = said.count("--resume"), process.returncode
    return True


def _alive(processes: list[psutil.Process]) -> list[psutil.Process]:
    return [process for process in processes if process.is_running()]


def sha256(path: Path) -> str:
    """Of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def finish(path: Path, *options: str) -> str:
    """Run a study to its end; SHA-256 of its cube."""
    process = start(path, *options)
    said = process.communicate(timeout=900)[1]
    if process.returncode != 0:
        raise SystemExit(f"a resumed run failed: {said}")
    return sha256(path.parent / "out" / "cube.nc")


def main() -> int:
    """Do all stops; 1 if one was not as it should be."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--stops", type=int, default=20)
    parser.add_argument("--seed", type=int, default=12)
    given = parser.parse_args()
    dice = random.Random(given.seed)
    steps = list(AT_WORK)
    done: list[Stop] = []
    with tempfile.TemporaryDirectory() as folder:
        reference = finish(small_study(Path(folder) / "undisturbed", STUDY))
        bad = 0
        while len(done) < given.stops:
            path = small_study(Path(folder) / f"stopped{len(done)}", STUDY)
            options: list[str] = []
            for step in sorted(dice.sample(steps, 4), key=steps.index):
                if len(done) == given.stops:
                    break
                stop = Stop(step, *KINDS[len(done) % len(KINDS)])
                if not stop_in(stop, path, options, dice):
                    break
                options = ["--resume"]
                done.append(stop)
                bad += not stop.good
                print(
                    f"{len(done):3d} {step:8s} {stop.number.name:8s} {stop.whom:7s} "
                    f"{stop.processes:2d} processes, {stop.left} left after {stop.took:4.2f} s, "
                    f"exit code {stop.code}, --resume said {stop.said} times"
                    f"{'' if stop.good else '   BAD'}",
                    flush=True,
                )
            same = finish(path, "--resume") == reference
            bad += not same
            print(f"    resumed: cube {'the same' if same else 'ANOTHER'}", flush=True)
    longest = max((s.took for s in done if s.number != signal.SIGKILL), default=0.0)
    print(f"{len(done)} stops, {bad} not as they should be, longest {longest:.2f} s")
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
