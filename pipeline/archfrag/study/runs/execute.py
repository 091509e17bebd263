"""Making of the runs of a batch: stored runs are kept, and workers make the others.

A batch that was stopped goes on from the runs that are stored.
"""

import contextlib
import sys
import time
import uuid
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from itertools import count, islice, repeat
from typing import Any

import numpy as np
import pandas as pd
from tqdm import tqdm

from archfrag.files import Named, make_folder
from archfrag.fragility.verdicts import Verdict
from archfrag.physics.methods.auto import goes_by_events
from archfrag.physics.methods.registry import AUTO, METHODS
from archfrag.simulation.warmup import is_shipped, kernels_are_compiled, warmup
from archfrag.study.designs import CASE, Cases, Verdicts, drive, order_of
from archfrag.study.file.members import check_standing
from archfrag.study.file.schema import StudyKeys
from archfrag.study.provenance import add_to_log, machine
from archfrag.study.runs import store
from archfrag.study.runs.store import Plan, Table, places
from archfrag.study.runs.workers import Cluster, Threads, workers_of
from archfrag.system import every

# A chunk is one call of the kernels. They make four of its runs side by side until near its end,
# so that chunks of 4 cost half as much again as those of 64. If there are many chunks, workers
# wait less for the last one.
SMALLEST_CHUNK = 8
LARGEST_CHUNK = 64
CHUNKS_EACH = 8
# Most runs of an adaptive design in a chunk; a free worker gets its share of those that wait.
LARGEST_SHARE = 16


def run_batch(
    study: StudyKeys, batch: int = 0, workers: int | None = None, quiet: bool = False
) -> tuple[Named, "pd.DataFrame"]:
    """Make the runs that the design requests for a batch; those that are stored are kept.

    Returned are an entry of the log and a table. The entry has the numbers of runs requested, runs
    kept, iterations and workers, the wall time, the compile time in it, and the time in the
    kernels summed over workers [s]. The table has a row for each run: arch, record, level,
    verdict, steps, wall time [s]. `workers` replaces the study's number of them. WorkerError if
    workers cannot be started or are lost.
    """
    started = time.perf_counter()
    plan = store.make_plan(study)
    stored = store.read_parts(make_folder(plan.parts))
    requests = plan.requests(batch, study.execution.batches)
    seen = sys.stderr.isatty() or "ipykernel" in sys.modules
    pause = 0.2 if seen else 10.0  # a file gets few lines
    bar = _Bar(
        unit="run",
        desc="simulations",
        total=0,
        disable=quiet,
        file=sys.stderr,
        dynamic_ncols=True,
        mininterval=pause,
        delay=pause,
    )
    if study.design.adaptive and not quiet:
        size, _ = study.design.size(len(plan.records), len(plan.levels))
        bar.estimate = len(requests) * size
    with bar, contextlib.ExitStack() as stack:
        maker = _Maker(plan, stored, workers or study.execution.workers, bar, stack)
        cases, _ = drive(requests, maker.answer)
        bar.finish(maker.log["runs"])
        bar.leave = False  # the caller tells what was done
    log = maker.log | {"wall_time": time.perf_counter() - started}
    add_to_log(study.work, {"step": "runs", "batch": batch, **log, **machine()})
    cases = cases[order_of(cases)]
    table = store.joined([stored, *maker.made])
    made = table[places(table, plan.keys(cases))]
    rows = {
        "arch": [plan.arches[number].id for number in cases["arch"]],
        "record": [plan.records[number].id for number in cases["record"]],
        "level": cases["level"],
        "verdict": [Verdict(code).name.lower() for code in made["verdict"]],
        "steps": made["steps"],
        "wall_time": made["wall_time"],
    }
    return log, pd.DataFrame(rows)


class _Bar(tqdm):
    """A progress bar whose total may be an estimate, which it reaches only when all is done."""

    estimate = 0  # of the total, if it is only estimated

    def update(self, n: float | None = 1) -> bool | None:
        """Advance by `n` runs."""
        if self.estimate:
            n = max(0, min(n or 0, (self.total or 0) - 1 - self.n))
        shown: bool | None = super().update(n)
        return shown

    def finish(self, count: int) -> None:
        """End a bar with an estimated total at `count` runs, if it has been shown."""
        if self.estimate and self.last_print_t > self.start_t + (self.delay or 0.0):
            self.n = self.total = count
            self.refresh()


@dataclass
class _Maker:
    """Answers requests: with runs that are stored, then with those that workers make."""

    plan: Plan
    stored: Table
    threads: int | None
    bar: _Bar
    stack: contextlib.ExitStack

    def __post_init__(self) -> None:
        self.made: list[Table] = []
        counts = dict.fromkeys(("runs", "kept", "iterations", "workers"), 0)
        self.log: Named = {**counts, "kernel_time": 0.0, "compile_time": 0.0}
        self._workers: Threads | Cluster | None = None
        self._waiting = np.empty(0, CASE)
        self._alike = np.empty(
            0, CASE
        )  # waiting runs with the key of a run that is sent
        self._chunks: dict[Any, Cases] = {}  # chunks that workers have, by key
        # Unique, since a scheduler may hold keys of others.
        self._keys = zip(repeat(f"runs-{uuid.uuid4().hex}"), count())

    def answer(self, cases: Cases) -> tuple[Cases, Verdicts]:
        """Take new requests; return some of the runs requested so far, and their verdicts.

        If some of the new runs are stored, these are returned. Else it waits for workers.
        """
        keys = self.plan.keys(cases)
        at = places(self.stored, keys)
        log = self.log
        bar = self.bar
        there = at >= 0
        kept = int(there.sum())
        log["iterations"] += bool(len(cases))
        log["runs"] += len(cases)
        log["kept"] += kept
        if not bar.disable:  # stored runs are shown as done without having taken time
            bar.total = bar.estimate or log["runs"]
            bar.initial += kept
            bar.update(kept)
        # Arches that differ in id only have runs in common.
        new = cases[~there]
        first = np.unique(keys[~there], return_index=True)[1]
        self._waiting = np.concatenate([self._waiting, new[np.sort(first)]])
        self._alike = np.concatenate([self._alike, np.delete(new, first)])
        if kept:
            return cases[there], self.stored["verdict"][at[there]]
        if self._workers is None:
            log["compile_time"] = _prepare(self.plan, bar)
            say = partial(bar.write, file=sys.stderr)
            self._workers = self.stack.enter_context(
                workers_of(
                    self.plan, self.threads, lambda text: bar.disable or say(text)
                )
            )
        if len(self._waiting):
            self._send(self._workers)
        taken = self._take(self._workers.made())
        # An adaptive cluster has workers only now, or has let them go again.
        log["workers"] = max(log["workers"], self._workers.count, 1)
        return taken

    def _send(self, workers: Threads | Cluster) -> None:
        """Send waiting runs to workers in chunks.

        All are sent; of an adaptive design only as many chunks as workers can take now.
        """
        waiting = len(self._waiting)
        if self.plan.study.design.adaptive:
            room = max(workers.count + workers.spare - len(self._chunks), 0)
            size = min(-(-waiting // max(room, 1)), LARGEST_SHARE)
        else:
            room = waiting
            share = -(-waiting // max(workers.count, 1))
            size = min(max(share // CHUNKS_EACH, SMALLEST_CHUNK), share, LARGEST_CHUNK)
        cut = chunks(self._waiting, self.plan.study.execution.chunk or size)
        new = dict(zip(self._keys, islice(cut, room)))
        if new:
            self._chunks |= new
            self._waiting = np.concatenate([np.empty(0, CASE), *cut])
            workers.send(new)

    def _take(self, made: list[tuple[Any, Table]]) -> tuple[Cases, Verdicts]:
        """Store the rows of some chunks; return the runs and their verdicts.

        Runs that wait with the same key are returned too. `made` has the key of each chunk and its
        rows.
        """
        cases = []
        parts = []
        for key, rows in made:
            cases.append(self._chunks.pop(key))
            parts.append(rows)
            store.write_part(self.plan.parts, rows)
            self.log["kernel_time"] += float(rows["wall_time"].sum())
            self.bar.update(len(rows))
        self.made += parts
        table = store.joined(parts)
        at = places(table, self.plan.keys(self._alike))
        cases.append(self._alike[at >= 0])
        verdicts = [*(rows["verdict"] for rows in parts), table["verdict"][at[at >= 0]]]
        self._alike = self._alike[at < 0]
        return np.concatenate(cases), np.concatenate(verdicts)


def chunks(cases: Cases, size: int) -> Iterator[Cases]:
    """Yield the runs in chunks of at most `size`, each of one arch."""
    cases = cases[np.argsort(cases["arch"], kind="stable")]
    for own in np.split(cases, np.flatnonzero(np.diff(cases["arch"])) + 1):
        yield from (own[start : start + size] for start in range(0, len(own), size))


def _prepare(plan: Plan, bar: tqdm) -> float:
    """Compile the kernels if needed, and check that all arches stand.

    Returned is the compile time [s].
    """
    compile_time = 0.0
    with (
        contextlib.nullcontext() if bar.disable else every(bar.mininterval, bar.refresh)
    ):
        name = method_to_compile(plan)
        if not kernels_are_compiled():  # else each worker loads them for itself
            bar.bar_format = "{desc}"
            compile_time = warmup(
                name, progress=partial(bar.set_description_str, refresh=False)
            )
        check_standing(plan.arches, plan.study.method)
    bar.bar_format = None
    bar.desc = "simulations"
    bar.unpause()  # its clock is that of the runs
    if compile_time and not bar.disable:
        bar.delay = 0.0
        what = "machine code made" if is_shipped() else "compiled"
        bar.write(f"archfrag: kernels: {what} in {compile_time:.1f} s", sys.stderr)
    return compile_time


def method_to_compile(plan: Plan) -> str:
    """Return the name of the method whose kernels a study needs."""
    method = plan.study.method
    rtol = method.rtol
    if rtol is None:
        (rtol,) = (e.default for e in METHODS[AUTO].parameters if e.name == "rtol")
    by_events = method.name == AUTO and goes_by_events(rtol)
    return "event_driven" if by_events else method.name
