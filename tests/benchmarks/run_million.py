"""A million short runs: memory of each process, time beside the kernels, size of the cube.

    python tests/benchmarks/run_million.py FOLDER                  # 10^6 runs, about 20 minutes
    python tests/benchmarks/run_million.py FOLDER --arches 10      # 10^5
    python tests/benchmarks/run_million.py FOLDER --arches 10 --kills 12   # and kill processes

The study is of pulses of 0.2 to 0.4 s, made here and stored as AT2 files, on arches of 7 voussoirs
of 100 thicknesses at 100 levels. Each step is a command of its own, whose time and largest memory
are said; its processes are those that `archfrag run` would start. With --kills, workers, their
scheduler's process or both are killed with SIGKILL at random moments of the simulations, which are
resumed; the cube must then be that of an undisturbed run to the last bit.
"""

import argparse
import contextlib
import hashlib
import json
import os
import random
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import psutil

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.study.small import write_at2

DT = 0.01  # [s]
KINDS = ("worker", "parent", "both")  # the parent is the scheduler too


def write_study(folder: Path, arches: int, records: int, levels: int) -> Path:
    """The study file, with its records beside it."""
    (folder / "records").mkdir(parents=True, exist_ok=True)
    dice = np.random.default_rng(15)
    for number in range(records):
        time_ = np.arange(int(dice.integers(20, 40)) + 1) * DT
        part = time_ / time_[-1]
        wave = np.sin(np.pi * part) * np.sin(2 * np.pi * part * dice.uniform(0.3, 1.5) + 0.3)
        write_at2(folder / "records" / f"pulse{number:03d}.AT2", 0.5 * wave, DT)
    study = {
        "id": "million",
        "title": "A million short runs",
        "output": "out",
        "arches": [
            {"id": f"arch{k:03d}", "profile": "circular", "radius": 0.5, "embrace": 157.5,
             "thickness": round(0.065 + 0.0002 * k, 6), "voussoirs": 7, "friction": 0.7}
            for k in range(arches)
        ],
        "motions": {"files": ["records/*.AT2"]},
        "intensity": {
            "measure": "PGA", "unit": "g",
            "levels": np.round(np.geomspace(0.2, 8.0, levels), 5).tolist(),
        },
        "method": {"name": "time_stepping", "dt": 2e-3, "follow": 1.0},
        "execution": {"workers": 2},
    }  # fmt: skip
    path = folder / "million.yaml"
    path.write_text(json.dumps(study, indent=1), encoding="utf-8")  # JSON is YAML
    return path


class Memory(threading.Thread):
    """Largest resident memory of every process below this one [MB], by what it does."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.largest: dict[str, float] = {}
        self.over = threading.Event()

    def run(self) -> None:
        """Look twice a second; the largest since its start is what the system says of each."""
        while not self.over.wait(0.5):
            for process in psutil.Process().children(recursive=True):
                with contextlib.suppress(OSError, psutil.Error, StopIteration):
                    lines = Path(f"/proc/{process.pid}/status").read_text().splitlines()
                    peak = next(line for line in lines if line.startswith("VmHWM:"))
                    kind = "worker" if "spawn_main" in " ".join(process.cmdline()) else "parent"
                    megabytes = int(peak.split()[1]) * 1024 / 1e6
                    self.largest[kind] = max(self.largest.get(kind, 0.0), megabytes)


def step(name: str, path: Path, *options: str) -> None:
    """Do a step and say what it took."""
    memory = Memory()
    memory.start()
    began, before = time.perf_counter(), os.times()
    command = [sys.executable, "-m", "archfrag.cli", name, str(path), *options]
    done = subprocess.run(command, stderr=subprocess.PIPE, text=True)
    after, wall = os.times(), time.perf_counter() - began
    memory.over.set()
    if done.returncode != 0:
        raise SystemExit(f"{name}: {done.stderr[-2000:]}")
    processor = after[2] + after[3] - before[2] - before[3]
    largest = ", ".join(f"{kind} {size:.0f} MB" for kind, size in memory.largest.items())
    print(f"{name}: {wall:.1f} s, {processor:.1f} s of CPU; {largest}", flush=True)


def say_batch(path: Path) -> None:
    """Kernels and what is beside them, by the study's log."""
    work = path.parent / "out" / ".archfrag"
    log = json.loads((work / "run_log.json").read_text())[-1]
    made = max(log["runs"] - log["kept"], 1)
    workers, kernels = log["workers"] * log["wall_time"], log["kernel_time"]
    print(
        f"  {made} runs made, {log['kept']} kept; kernels {kernels:.1f} s, "
        f"{1e6 * kernels / made:.0f} us a run; {workers:.1f} s of workers' time: "
        f"{100 * (workers / max(kernels, 1e-9) - 1):.1f} % beside the kernels"
    )
    parts = [entry.stat().st_size for entry in (work / "parts").iterdir()]
    print(f"  {len(parts)} parts, {sum(parts) / 1e6:.0f} MB", flush=True)


def kill_at_random(path: Path, kills: int, seed: int) -> None:
    """Simulations disturbed by SIGKILL to a worker, the parent of all or both, then resumed."""
    dice = random.Random(seed)
    command = [sys.executable, "-m", "archfrag.cli", "batch", str(path), "--quiet"]
    parts = path.parent / "out" / ".archfrag" / "parts"
    done, starts = 0, 0
    while True:
        process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        starts += 1
        while done < kills and _goes_on(process, parts, dice):
            whom = KINDS[done % len(KINDS)]
            below = psutil.Process(process.pid).children(recursive=True)
            workers = [each for each in below if not each.children()]
            if whom != "parent" and workers:
                with contextlib.suppress(psutil.Error):
                    dice.choice(workers).kill()
            if whom != "worker":
                process.kill()
            done += 1
            print(f"  killed: {whom}, at {len(list(parts.glob('*.npy')))} parts", flush=True)
        said = process.communicate()[1]
        if process.returncode == 0:
            print(f"  {done} kills, {starts} starts", flush=True)
            return
        if process.returncode > 0 and done >= kills:
            raise SystemExit(said[-2000:])


def _goes_on(process: subprocess.Popen, parts: Path, dice: random.Random) -> bool:
    """Wait until new parts are written, and some time more; False if the batch is over."""
    before = len(list(parts.glob("*.npy")))
    while process.poll() is None and len(list(parts.glob("*.npy"))) <= before:
        time.sleep(0.05)
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(dice.uniform(0.0, 3.0))
    return process.poll() is None


def sha256(path: Path) -> str:
    """Of a file."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def look(cube: Path) -> None:
    """Open lazily and read one arch, as fits and report do."""
    import xarray as xr

    began = time.perf_counter()
    with xr.open_dataset(cube, chunks={}) as opened:
        middle = opened.isel(arch=opened.sizes["arch"] // 2)
        verdict = middle["verdict"].values
        one = time.perf_counter() - began
        middle.load()
        said = f"verdicts of one arch {one:.2f} s, all of it {time.perf_counter() - began:.2f} s"
    share = ", ".join(f"{np.mean(verdict == code):.2f}" for code in range(4))
    print(f"cube: {cube.stat().st_size / 1e6:.0f} MB; {said}; verdicts {share}", flush=True)


def main() -> int:
    """Make the study; 1 if a disturbed one is another."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--arches", type=int, default=100)
    parser.add_argument("--records", type=int, default=100)
    parser.add_argument("--levels", type=int, default=100)
    parser.add_argument("--kills", type=int, default=0)
    parser.add_argument("--seed", type=int, default=15)
    given = parser.parse_args()
    size = (given.arches, given.records, given.levels)
    path = write_study(given.folder / "undisturbed", *size)
    step("motions", path)
    step("batch", path, "--quiet")
    say_batch(path)
    for name in ("cube",) if given.kills else ("cube", "fit", "report"):
        step(name, path)
    cube = path.parent / "out" / "cube.nc"
    look(cube)
    if not given.kills:
        step("run", path)
        return 0
    other = write_study(given.folder / "disturbed", *size)
    step("motions", other)
    kill_at_random(other, given.kills, given.seed)
    step("cube", other)
    same = sha256(other.parent / "out" / "cube.nc") == sha256(cube)
    print("the cubes are equal" if same else "THE CUBES DIFFER")
    return 0 if same else 1


if __name__ == "__main__":
    sys.exit(main())
