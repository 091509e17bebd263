"""What a worker process does: the runs of one chunk. Nothing heavy is imported here."""

import contextlib
import os
import resource
import sys
import time
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray
from pydantic import TypeAdapter

from archfrag.study.arches import ArchEntry
from archfrag.study.outcome import tabulate_cases
from archfrag.study.plan import Plan
from archfrag.study.records import PreparedRecord, load_record
from archfrag.study.rounds import Cases
from archfrag.study.store import new_table, write_part, write_timing

if TYPE_CHECKING:
    from archfrag.arch import Arch
    from archfrag.motions.motion import Motion


# A plan's name follows from its content.
@lru_cache(maxsize=2)
def _plan(path: str) -> Plan:
    return Plan.load(Path(path))


@lru_cache(maxsize=64)
def _arch(path: str, number: int) -> "Arch":
    return TypeAdapter(ArchEntry).validate_python(_plan(path).arches[number]).build()


# A record of a minute with its vertical component takes 0.2 MB.
@lru_cache(maxsize=64)
def _motion(folder: str, record: PreparedRecord) -> "Motion":
    return load_record(Path(folder), record)


def peak_memory() -> float:
    """Largest resident memory of this process so far [MB]."""
    with contextlib.suppress(OSError):
        # getrusage would be of the process that started this one, where that was larger.
        for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024 / 1e6
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6


def run_chunks(plan_path: str, chunks: Sequence[tuple[Cases, NDArray]]) -> list[dict[str, Any]]:
    """Run several chunks one after the other; see `run_chunk`."""
    return [run_chunk(plan_path, *chunk) for chunk in chunks]


def run_chunk(plan_path: str, cases: Cases, factors: NDArray) -> dict[str, Any]:
    """Run some cases of one arch and stage, write their part and then their wall times."""
    started = time.perf_counter()
    plan, numbers = _plan(plan_path), cases["record"].tolist()
    motions = {r: _motion(plan.folder, plan.records[r]) for r in dict.fromkeys(numbers)}
    columns, wall_time = tabulate_cases(
        plan.methods[cases["stage"][0]],
        _arch(plan_path, int(cases["arch"][0])),
        [motions[r] for r in numbers],
        factors.tolist(),
    )
    table = new_table(plan.keys(cases, factors), columns)
    part = write_part(plan.parts, table)
    write_timing(part, wall_time)
    return {
        "part": str(part),
        "runs": len(table),
        "kernel_time": float(wall_time.sum()),
        "wall_time": time.perf_counter() - started,
        "peak_memory": peak_memory(),
        "pid": os.getpid(),
    }
