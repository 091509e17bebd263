"""What a worker process does: the runs of one chunk. Nothing heavy is imported here."""

import contextlib
import os
import resource
import sys
import time
from collections.abc import Sequence
from functools import lru_cache
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import TypeAdapter

from archfrag.study.arches import ArchEntry
from archfrag.study.case import simulate_cases
from archfrag.study.files import replacing
from archfrag.study.outcome import table_of
from archfrag.study.parts import write_part
from archfrag.study.plan import Plan
from archfrag.study.records import PreparedRecord, motion_of_record

if TYPE_CHECKING:
    from archfrag.arch import Arch
    from archfrag.motions.motion import Motion
    from archfrag.simulate import Response


# The modification time is only there to tell an edited file from the one in memory.
@lru_cache(maxsize=2)
def _plan(path: str, modified: int) -> Plan:
    return Plan.load(Path(path))


@lru_cache(maxsize=64)
def _arch(path: str, modified: int, number: int) -> "Arch":
    entry = TypeAdapter(ArchEntry).validate_python(_plan(path, modified).arches[number])
    return entry.build()


@lru_cache(maxsize=4)
def _motion(folder: str, record: PreparedRecord) -> "Motion":
    return motion_of_record(Path(folder), record)


def _modified(path: Path) -> int:
    return path.stat().st_mtime_ns


def peak_memory() -> float:
    """Largest resident memory of this process so far [MB]."""
    with contextlib.suppress(OSError):
        # getrusage would tell of the process that started this one, where that was larger.
        for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024 / 1e6
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6


def run_cases(plan: Plan, runs: Sequence[int]) -> list["Response"]:
    """Some runs of a plan, those of one arch together."""
    responses: list[Response] = []
    place = plan.path
    for a, group in groupby(map(plan.case, runs), key=itemgetter(0)):
        cases = list(group)
        records = {r: plan.records[r] for _, r, _ in cases}
        motions = {r: _motion(plan.folder, record) for r, record in records.items()}
        responses += simulate_cases(
            plan.method,
            _arch(str(place), _modified(place), a),
            [motions[r] for _, r, _ in cases],
            [records[r].factors[level] for _, r, level in cases],
        )
    return responses


def run_chunks(plan_path: str, chunks: Sequence[int]) -> list[dict[str, float]]:
    """Run several chunks one after the other; see `run_chunk`."""
    return [run_chunk(plan_path, chunk) for chunk in chunks]


def run_chunk(plan_path: str, chunk: int) -> dict[str, float]:
    """Run a chunk, write its part and then its wall times.

    Parameters
    ----------
    plan_path : str
        Stored plan.
    chunk : int

    Returns
    -------
    dict
        chunk, runs, kernel_time [s], wall_time [s] with all that is done beside the runs,
        peak_memory [MB] and pid of this process.

    Raises
    ------
    OutputError
        If the part cannot be written.
    """
    started = time.perf_counter()
    plan = _plan(plan_path, _modified(Path(plan_path)))
    responses = run_cases(plan, plan.rows(chunk))
    write_part(plan, chunk, table_of(responses))
    lines = [
        f"{run},{response.steps},{response.wall_time:.6f}\n"
        for run, response in zip(plan.rows(chunk), responses)
    ]
    with replacing(plan.timing(chunk), lasting=False) as temporary:
        temporary.write_text("".join(lines), encoding="utf-8")
    return {
        "chunk": chunk,
        "runs": len(responses),
        "kernel_time": sum(response.wall_time for response in responses),
        "wall_time": time.perf_counter() - started,
        "peak_memory": peak_memory(),
        "pid": os.getpid(),
    }
