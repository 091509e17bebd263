"""The runs of a batch: those that are stored are kept, workers make the others; resumable."""

import contextlib
import sys
import time
import uuid
from collections.abc import Iterator
from functools import partial
from itertools import count, islice
from typing import Any

import numpy as np
import pandas as pd
from tqdm import tqdm

from archfrag.files import make_folder
from archfrag.fragility.verdicts import Verdict
from archfrag.physics.methods.auto import goes_by_events
from archfrag.physics.methods.registry import AUTO, METHODS
from archfrag.simulation.warmup import every, is_shipped, kernels_are_compiled, warmup
from archfrag.study.designs import CASE, Cases, Verdicts, drive, order_of
from archfrag.study.file.members import check_standing
from archfrag.study.file.schema import StudyKeys
from archfrag.study.provenance import add_to_log, machine
from archfrag.study.runs import store
from archfrag.study.runs.store import Plan, Table, places
from archfrag.study.runs.workers import Cluster, Threads, workers_of

# A chunk is one call: four of its runs go side by side to near its end, so that chunks of 4 cost
# half as much again as those of 64. Many make the others wait less for the last one.
SMALLEST_CHUNK = 8
LARGEST_CHUNK = 64
CHUNKS_EACH = 8
# Of an adaptive design a worker that is free takes its share of what waits.
LARGEST_SHARE = 16


def run_batch(
    study: StudyKeys,
    batch: int = 0,
    workers: int | None = None,
    quiet: bool = False,
) -> tuple[dict[str, Any], "pd.DataFrame"]:
    """Make the runs of one batch that the design requests; those that are there are kept.

    Returned are the entry of the log (runs requested and of them kept, iterations, workers, wall
    time, of which compiling, time in the kernels summed over workers [s]) and a row for each run:
    arch, record, level, verdict, steps, wall time [s]. `workers` take the place of the study's.
    WorkerError if workers cannot be started or are lost.
    """
    started = time.perf_counter()
    known = store.make_plan(study)
    table = store.read_parts(make_folder(known.parts))
    requests = known.requests(batch, study.execution.batches)
    estimate = (
        len(requests) * study.design.size(len(known.records), len(known.levels))[0]
    )
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
    bar.estimate = estimate if study.design.adaptive and not quiet else 0
    with bar, contextlib.ExitStack() as stack:
        maker = _Maker(known, table, workers or study.execution.workers, bar, stack)
        cases = drive(requests, maker.answer)[0]
        bar.finish(maker.log["runs"])
        bar.leave = False  # the caller tells what was done
    if maker.made:
        table = store.joined([table, *maker.made])
    log = maker.log | {"wall_time": time.perf_counter() - started}
    add_to_log(study.work, {"step": "runs", "batch": batch, **log, **machine()})
    cases = cases[order_of(cases)]
    at = places(table, known.keys(cases))
    names = np.array([member.name.lower() for member in Verdict], object)
    return log, pd.DataFrame(
        {
            "arch": np.array([member.id for member in known.arches], object)[
                cases["arch"]
            ],
            "record": np.array([record.id for record in known.records], object)[
                cases["record"]
            ],
            "level": cases["level"],
            "verdict": names[table["verdict"][at]],
            "steps": table["steps"][at],
            "wall_time": table["wall_time"][at],
        }
    )


class _Bar(tqdm):
    """A bar that keeps its total; one that is only estimated is reached when all is done."""

    estimate = 0  # of the total, if it is only estimated

    def update(self, n: float | None = 1) -> bool | None:
        """Advance by some runs."""
        if self.estimate:
            n = max(0, min(n or 0, (self.total or 0) - 1 - self.n))
        shown: bool | None = super().update(n)
        return shown

    def finish(self, count: int) -> None:
        """Show the runs as all that there are, if anything was shown before."""
        if self.estimate and self.last_print_t > self.start_t + (self.delay or 0.0):
            self.n = self.total = count
            self.refresh()


class _Maker:
    """Answers requests: with runs that are stored, then with those that workers make."""

    def __init__(
        self,
        plan: Plan,
        stored: Table,
        threads: int | None,
        bar: "_Bar",
        stack: contextlib.ExitStack,
    ) -> None:
        self.made: list[Table] = []
        self.log: dict[str, Any] = dict.fromkeys(
            ("runs", "kept", "iterations", "workers"), 0
        )
        self.log |= {"kernel_time": 0.0, "compile_time": 0.0}
        self._plan = plan
        self._stored = stored
        self._threads = threads
        self._bar = bar
        self._stack = stack
        self._workers: Threads | Cluster | None = None
        self._waiting = np.empty(0, CASE)
        self._alike = np.empty(0, CASE)  # runs that another is the same as
        self._chunks: dict[Any, Cases] = {}  # that workers have, by key
        self._number = count()  # others' keys may be there
        self._name = f"runs-{uuid.uuid4().hex}"

    def answer(self, cases: Cases) -> tuple[Cases, Verdicts]:
        """Take new requests; return some of those so far, and their verdicts."""
        at = places(self._stored, keys := self._plan.keys(cases))
        log = self.log
        bar = self._bar
        there = at >= 0
        new = np.flatnonzero(at < 0)
        log["iterations"] += bool(len(cases))
        log["runs"] += len(cases)
        log["kept"] += len(cases) - new.size
        if not bar.disable:  # runs that are stored are shown as done, at no time
            bar.total = bar.estimate or log["runs"]
            bar.initial += len(cases) - new.size
            bar.update(len(cases) - new.size)
        # Arches that differ in id only have runs in common.
        first = np.isin(np.arange(new.size), np.unique(keys[new], return_index=True)[1])
        self._waiting = np.concatenate([self._waiting, cases[new[first]]])
        self._alike = np.concatenate([self._alike, cases[new[~first]]])
        if there.any():
            return cases[there], self._stored["verdict"][at[there]]
        if self._workers is None:
            log["compile_time"] = _prepare(self._plan, bar)
            say = partial(bar.write, file=sys.stderr)
            self._workers = self._stack.enter_context(
                workers_of(
                    self._plan, self._threads, lambda text: bar.disable or say(text)
                )
            )
        self._send(self._workers)
        taken = self._take(self._workers.made())
        # An adaptive cluster has workers only now, or has let them go again.
        self.log["workers"] = max(self.log["workers"], self._workers.count, 1)
        return taken

    def _send(self, workers: Threads | Cluster) -> None:
        """Give workers chunks of what waits: all of it, or of an adaptive design to free ones."""
        waiting = self._waiting
        adaptive = self._plan.study.design.adaptive
        if not len(waiting):
            return
        threads = workers.count
        room = (
            max(threads + workers.spare - len(self._chunks), 0)
            if adaptive
            else len(waiting)
        )
        share = -(-len(waiting) // max(room if adaptive else threads, 1))
        if adaptive:
            size = min(share, LARGEST_SHARE)
        else:
            size = min(max(share // CHUNKS_EACH, SMALLEST_CHUNK), share, LARGEST_CHUNK)
        cut = chunks(waiting, self._plan.study.execution.chunk or size)
        new = {(self._name, next(self._number)): chunk for chunk in islice(cut, room)}
        if new:
            self._chunks |= new
            self._waiting = np.concatenate([np.empty(0, CASE), *cut])
            workers.send(new)

    def _take(self, made: list[tuple[Any, Table]]) -> tuple[Cases, Verdicts]:
        """Store rows, and return their runs and those that are the same."""
        cases = [self._chunks.pop(key) for key, _ in made]
        parts = [rows for _, rows in made]
        for rows in parts:
            store.write_part(self._plan.parts, rows)
            self.log["kernel_time"] += float(rows["wall_time"].sum())
            self._bar.update(len(rows))
        self.made += parts
        verdicts = [rows["verdict"] for rows in parts]
        if len(self._alike):
            table = store.joined(parts)
            at = places(table, self._plan.keys(self._alike))
            cases.append(self._alike[at >= 0])
            verdicts.append(table["verdict"][at[at >= 0]])
            self._alike = self._alike[at < 0]
        return np.concatenate(cases), np.concatenate(verdicts)


def chunks(cases: Cases, size: int) -> Iterator[Cases]:
    """Cut runs into chunks of one arch each, of at most so many runs."""
    cases = cases[np.argsort(cases["arch"], kind="stable")]
    for own in np.split(cases, np.flatnonzero(np.diff(cases["arch"])) + 1):
        yield from (own[start : start + size] for start in range(0, len(own), size))


def _prepare(plan: Plan, bar: tqdm) -> float:
    """Compile kernels that are not, and see that all arches stand; return the compile time [s]."""
    compile_time = 0.0
    with (
        contextlib.nullcontext() if bar.disable else every(bar.mininterval, bar.refresh)
    ):
        name = method_to_compile(plan)
        if not kernels_are_compiled():  # else each worker loads them for itself
            bar.bar_format = "{desc}"
            show = partial(bar.set_description_str, refresh=False)
            compile_time = warmup(name, progress=show)
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
    if method.name != AUTO:
        return method.name
    defaults = {
        parameter.name: parameter.default for parameter in METHODS[AUTO].parameters
    }
    rtol = defaults["rtol"] if method.rtol is None else method.rtol
    return "event_driven" if goes_by_events(rtol) else AUTO
