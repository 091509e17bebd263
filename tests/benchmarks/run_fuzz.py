"""Spoil record files for some minutes and count what comes of reading them.

``python tests/benchmarks/run_fuzz.py --minutes 10`` from the root of the repository. Files are
read in two processes; one that a file ends (crash, time, memory) is started anew after it.
Faults are printed with their seed: ``python -m tests.motions.fuzz SEED 1`` repeats one.
"""

import argparse
import collections
import concurrent.futures
import json
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).parents[2]
FILES = 2000  # a process


def batch(first, seconds):
    """Output of one process, and what ended it before its time."""
    command = [sys.executable, "-m", "tests.motions.fuzz", str(first), str(FILES), str(seconds)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    ended = ""
    if done.returncode != 0:
        ended = f"exit code {done.returncode} at {' '.join(done.stderr.splitlines()[-1:])}"
    return lines, ended


def work(number, until):
    """Batches one after the other until the time is up."""
    first = 1_000_000_000 * (number + 1) + int(time.time()) % 1_000_000 * 1000
    while time.monotonic() < until:
        yield batch(first, max(1.0, until - time.monotonic()))
        first += FILES


def main():
    """Print counts of outcomes, the slowest file and the most memory."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--processes", type=int, default=2)
    given = parser.parse_args()
    until = time.monotonic() + 60.0 * given.minutes
    counts: collections.Counter[str] = collections.Counter()
    slowest, memory, faults = 0.0, 0, 0
    with concurrent.futures.ThreadPoolExecutor(given.processes) as pool:
        tasks = [
            pool.submit(lambda n: list(work(n, until)), number)
            for number in range(given.processes)
        ]
        for task in tasks:
            for lines, ended in task.result():
                for line in lines:
                    if "fault" in line:
                        print(line["seed"], line["fault"], sep="\n")
                        faults += 1
                        continue
                    counts.update(line["counts"])
                    slowest = max(slowest, line["slowest"])
                    memory = max(memory, line["memory"])
                if ended:
                    print(ended)
                    faults += 1
    for key, count in sorted(counts.items()):
        print(f"{key:20s} {count:8d}")
    print(f"{sum(counts.values())} files in {given.minutes:g} min, {faults} faults, slowest "
          f"{slowest:.2f} s, {memory / 2**20:.0f} MiB at most")  # fmt: skip
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
