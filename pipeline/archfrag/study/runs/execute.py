"""Making of the runs of a batch: stored runs are kept, and workers make the others.

A batch that was stopped goes on from the runs that are stored.
"""

import contextlib
import sys
import time
from dataclasses import dataclass
from functools import partial

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
from archfrag.study.runs.workers import Cluster, Made, Threads, workers_of
from archfrag.system import every

# Unless a study says how many, rows are stored when there are so many, or after so long [s].
PART = 64
STORED_EACH = 1.0


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
        stack.callback(maker.store, whole=True)
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
        self._unstored: list[Table] = []
        self._stored_at = time.monotonic()

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
            self._workers.send(self._waiting)
            self._waiting = np.empty(0, CASE)
        taken = self._take(self._workers.made())
        # An adaptive cluster has workers only now, or has let them go again.
        log["workers"] = max(log["workers"], self._workers.count, 1)
        return taken

    def store(self, whole: bool = False) -> None:
        """Store rows, if there are enough for a part or it was long ago; all if `whole`."""
        given = self.plan.study.execution.chunk
        size = given or PART
        now = time.monotonic()
        whole |= not given and now > self._stored_at + STORED_EACH
        if not self._unstored or (sum(map(len, self._unstored)) < size and not whole):
            return
        rows = np.concatenate(self._unstored)
        end = len(rows) if whole else len(rows) // size * size
        for start in range(0, end, size):
            store.write_part(self.plan.parts, rows[start : min(start + size, end)])
        self._unstored = [rows[end:]] if end < len(rows) else []
        self._stored_at = now

    def _take(self, made: list[Made]) -> tuple[Cases, Verdicts]:
        """Keep the rows of some runs; return the runs and their verdicts.

        Runs that wait with the same key are returned too.
        """
        cases = [own for own, _ in made]
        parts = [rows for _, rows in made]
        self._unstored += parts
        self.store()
        self.log["kernel_time"] += sum(float(rows["wall_time"].sum()) for rows in parts)
        self.bar.update(sum(map(len, parts)))
        self.made += parts
        table = store.joined(parts)
        at = places(table, self.plan.keys(self._alike))
        cases.append(self._alike[at >= 0])
        verdicts = [*(rows["verdict"] for rows in parts), table["verdict"][at[at >= 0]]]
        self._alike = self._alike[at < 0]
        return np.concatenate(cases), np.concatenate(verdicts)


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
