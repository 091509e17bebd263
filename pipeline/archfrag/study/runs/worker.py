"""What makes runs, here or in a worker process: nothing heavy is imported."""

import multiprocessing
import os
import signal
import threading
import time
from functools import lru_cache
from multiprocessing.connection import wait
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from archfrag.study.file.arches import ArchEntry
from archfrag.study.file.records import PreparedRecord, load_record
from archfrag.study.runs.design import Cases
from archfrag.study.runs.outcome import tabulate_cases
from archfrag.study.runs.plan import Plan
from archfrag.study.runs.store import new_table, write_part

if TYPE_CHECKING:
    from archfrag.arch import Arch
    from archfrag.motions.motion import Motion


# A plan's name follows from its content.
@lru_cache(maxsize=2)
def _plan(path: str) -> Plan:
    return Plan.load(Path(path))


@lru_cache(maxsize=64)
def _arch(path: str, number: int) -> "Arch":
    return ArchEntry.model_validate(_plan(path).arches[number]).build()


# A record of a minute with its vertical component takes 0.2 MB.
@lru_cache(maxsize=64)
def _motion(folder: str, record: PreparedRecord) -> "Motion":
    return load_record(Path(folder), record)


class Made(NamedTuple):
    """What a chunk of runs made and took."""

    part: Path
    runs: int
    kernel_time: float  # [s]
    cpu_time: float  # of all of it [s]


def run_chunk(plan_path: str, cases: Cases) -> Made:
    """Run some cases of one arch and write their part."""
    started = time.process_time()
    plan, numbers = _plan(plan_path), cases["record"].tolist()
    motions = {r: _motion(plan.folder, plan.records[r]) for r in dict.fromkeys(numbers)}
    columns = tabulate_cases(
        plan.method,
        _arch(plan_path, int(cases["arch"][0])),
        [motions[r] for r in numbers],
        plan.factors(cases).tolist(),
    )
    part = write_part(plan.parts, new_table(plan.keys(cases), columns))
    kernel_time = float(columns["wall_time"].sum())
    return Made(part, len(cases), kernel_time, time.process_time() - started)


def follow_parent() -> None:
    """Leave Ctrl-C to the process that started this one, and end when it is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
