"""The runs of a batch: made here for the first seconds, then by workers; resumable."""

import contextlib
import multiprocessing
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from tqdm import tqdm

from archfrag.errors import WorkerError
from archfrag.files import make_folder
from archfrag.fragility.counts import Verdict
from archfrag.study.file.members import check_standing
from archfrag.study.file.schema import Study
from archfrag.study.provenance import add_to_log, available_cores, machine
from archfrag.study.runs.design import NO_CASES, Cases
from archfrag.study.runs.plan import Plan, make_plan
from archfrag.study.runs.store import Store
from archfrag.study.runs.worker import Made, follow_parent, run_chunk

if TYPE_CHECKING:
    import pandas as pd

IN_PROCESS = 5.0  # CPU time of runs that this process makes before workers are started [s]
IN_FLIGHT = 2  # chunks for each worker
# A chunk is one call: four of its runs go side by side to near its end. It takes about a second,
# which is what a lost worker loses, and what the others wait for at the end.
LANES, FIRST_CHUNK, LARGEST_CHUNK, CHUNK_TIME = 4, 16, 200, 1.0
LOSSES_ALLOWED = 3
PATIENCE = 60.0  # with a scheduler that has no workers [s]
ANSWER_WITHIN = 10.0  # [s]
_GO_ON = "finished parts are kept, the same command goes on"


@dataclass
class BatchLog:
    """What a batch took; for the log beside the cube, never for the cube."""

    batch: int
    runs: int = 0  # that the design requested
    kept: int = 0  # of them not made now
    iterations: int = 0
    workers: int = 0
    wall_time: float = 0.0  # [s]
    kernel_time: float = 0.0  # summed over workers [s]


def run_batch(
    study: Study, batch: int = 0, workers: int | None = None, quiet: bool = False,
    plan: Plan | None = None,
) -> tuple[BatchLog, "pd.DataFrame"]:  # fmt: skip
    """Make the runs of one batch that the design requests; those that are there are kept.

    Parameters
    ----------
    study : Study
        Its motions are prepared.
    batch : int
        Which of the study's batches.
    workers : int, optional
        Processes, in the place of the study's.
    quiet : bool
        Show no progress.
    plan : Plan, optional
        Of the study, where it is known.

    Returns
    -------
    (BatchLog, pandas.DataFrame)
        And a row for each run of the batch: arch, record, level, verdict, steps, wall time [s].

    Raises
    ------
    WorkerError
        If workers cannot be started or are lost; finished parts are kept.
    """
    started, log = time.perf_counter(), BatchLog(batch)
    plan = plan or make_plan(study)
    make_folder(plan.parts)
    iterations, store = plan.iterations(batch, study.execution.batches), Store(plan.parts)
    count = workers or study.execution.workers or available_cores()
    asked: list[Cases] = []
    bar = tqdm(
        unit="run", desc="simulations", disable=quiet, file=sys.stderr, dynamic_ncols=True,
        mininterval=0.2 if sys.stderr.isatty() else 10.0,
    )  # fmt: skip
    with bar, _Makers(study, plan, count, bar) as makers:
        while len(iterations.requested):
            keys = plan.keys(iterations.requested)
            missing = np.flatnonzero(store.places(keys) < 0)
            # Arches that differ in id only have runs in common.
            missing = missing[np.sort(np.unique(keys[missing], return_index=True)[1])]
            log.runs += len(keys)
            log.kept += len(keys) - missing.size
            _count(bar, log.runs, missing.size, known=not plan.asks.adaptive)
            for made in makers.make(iterations.requested[missing]) if missing.size else ():
                if not store.add(made.part):
                    raise WorkerError(f"{made.part}: cannot be read back; {_GO_ON}")
                bar.update(made.runs)
                log.kernel_time += made.kernel_time
            asked.append(iterations.requested)
            iterations.answer(store.verdicts(keys))
    log.iterations, log.workers = iterations.count, makers.used
    log.wall_time = time.perf_counter() - started
    add_to_log(study.work, {"step": "runs", **asdict(log), **machine()})
    return log, _table(plan, store, np.concatenate([NO_CASES, *asked]))


def _table(plan: Plan, store: Store, cases: Cases) -> "pd.DataFrame":
    import pandas as pd

    rows = store.rows(plan.keys(cases))
    verdict = np.array([member.name.lower() for member in Verdict], object)
    return pd.DataFrame({
        "arch": np.array([arch["id"] for arch in plan.arches], object)[cases["arch"]],
        "record": np.array([record.id for record in plan.records], object)[cases["record"]],
        "level": cases["level"], "verdict": verdict[rows["verdict"]],
        "steps": rows["steps"], "wall_time": rows["wall_time"],
    })  # fmt: skip


def _count(bar: tqdm, asked: int, missing: int, known: bool) -> None:
    """Show all runs that are not missing as done; how many there will be if that is known."""
    if not bar.disable:
        bar.initial += asked - missing - bar.n
        bar.total, bar.n = asked if known else None, asked - missing
        bar.refresh()


def chunks(cases: Cases, size: Callable[[], int]) -> Iterator[Cases]:
    """Runs cut into chunks of one arch each, of as many runs as `size` then gives."""
    for own in np.split(cases, np.flatnonzero(np.diff(cases["arch"])) + 1):
        start = 0
        while start < len(own):
            end = start + size()
            yield own[start:end]
            start = end


class _Makers:
    """Makes runs: in this process while that is cheaper than to start workers, then on these."""

    def __init__(self, study: Study, plan: Plan, count: int, bar: tqdm) -> None:
        self.used = 0  # processes
        self._study, self._plan, self._count, self._bar = study, plan, count, bar
        self._runs, self._cpu, self._losses = 0, 0.0, 0
        self._pool: Executor | None = None
        self._client: Any = None

    def __enter__(self) -> "_Makers":
        return self

    def __exit__(self, *error: object) -> None:
        if self._pool is not None:
            self._pool.shutdown(wait=False, cancel_futures=True)
            for child in multiprocessing.active_children():
                child.kill()
        if self._client is not None:
            self._client.close()

    def make(self, cases: Cases) -> Iterator[Made]:
        """Run cases, chunk by chunk."""
        if not self.used:
            self._start()
        work = chunks(cases, self._size)
        while self._here():
            chunk = next(work, None)
            if chunk is None:
                return
            yield self._learn(run_chunk(str(self._plan.path), chunk))
        yield from self._by_workers(work)

    def _start(self) -> None:
        from archfrag.simulate import kernels_are_compiled, warmup
        from archfrag.simulation.warm import every

        self._plan.save()
        bar, self.used = self._bar, 1
        ticking = contextlib.nullcontext() if bar.disable else every(bar.mininterval, bar.refresh)
        with ticking:
            for name in kernels_needed(self._study, self._plan):
                if not kernels_are_compiled(name):  # else each worker loads them for itself
                    warmup(name, progress=bar.set_description)
            bar.set_description("simulations", refresh=False)
            check_standing(self._study.members(len(self._plan.records)))

    def _here(self) -> bool:
        alone = self._count == 1 or self._cpu < IN_PROCESS
        return alone and self._study.execution.scheduler is None and self._pool is None

    def _size(self) -> int:
        """Runs of the next chunk, by how long the runs so far took."""
        if self._study.execution.chunk is not None:
            return self._study.execution.chunk
        if not self._runs:
            return FIRST_CHUNK
        lanes = CHUNK_TIME * self._runs / max(self._cpu, 1e-9) / LANES
        return LANES * int(np.clip(lanes, 1, LARGEST_CHUNK // LANES))

    def _learn(self, made: Made) -> Made:
        self._runs += made.runs
        self._cpu += made.cpu_time
        return made

    def _by_workers(self, work: Iterator[Cases]) -> Iterator[Made]:
        """Results from workers, of so many chunks in flight that memory stays bounded."""
        waiting: dict[Future, Cases] = {}
        again: list[Cases] = []
        idle_since = time.monotonic()
        while True:
            while len(waiting) < IN_FLIGHT * self._count:
                chunk = again.pop() if again else next(work, None)
                if chunk is None:
                    break
                waiting[self._submit(chunk)] = chunk
            if not waiting:
                return
            done, _ = wait(waiting, timeout=1.0, return_when=FIRST_COMPLETED)
            if done or self._client is None or self._client.scheduler_info()["workers"]:
                idle_since = time.monotonic()
            elif time.monotonic() - idle_since > PATIENCE:
                raise WorkerError(f"the scheduler has no workers any more; {_GO_ON}")
            for future in done:
                chunk = waiting.pop(future)
                try:
                    made = self._learn(future.result())
                except BrokenProcessPool:
                    again += [chunk, *waiting.values()]
                    waiting.clear()
                    self._lose()
                    break
                except CancelledError as error:
                    raise WorkerError(f"the scheduler is gone; {_GO_ON}") from error
                yield made

    def _submit(self, chunk: Cases) -> Future:
        if self._pool is None:
            self._pool = self._scheduler() or ProcessPoolExecutor(
                self._count, multiprocessing.get_context("spawn"), follow_parent
            )
            self.used = self._count
        try:
            found: Future = self._pool.submit(run_chunk, str(self._plan.path), chunk)
        except BrokenProcessPool:
            self._lose()
            return self._submit(chunk)
        return found

    def _lose(self) -> None:
        """Start anew after a worker was killed or ran out of memory, a few times."""
        self._losses += 1
        if self._losses > LOSSES_ALLOWED:
            lost = f"workers were killed or ran out of memory {self._losses} times"
            raise WorkerError(f"{lost}; {_GO_ON}")
        assert self._pool is not None
        self._pool.shutdown(wait=False, cancel_futures=True)
        self._pool = None

    def _scheduler(self) -> Executor | None:
        """Executor of the study's dask scheduler, if it names one."""
        address = self._study.execution.scheduler
        if address is None:
            return None
        from distributed import Client

        try:
            self._client = Client(address, timeout=ANSWER_WITHIN, set_as_default=False)
            self._client.wait_for_workers(1, timeout=PATIENCE)
        except (OSError, TimeoutError, ValueError, RuntimeError) as error:
            why = error or type(error).__name__
            what = f"execution.scheduler: {address} cannot be used: {why}"
            raise WorkerError(f"{what}; {_GO_ON}") from error
        self._count = max(1, len(self._client.scheduler_info()["workers"]))
        found: Executor = self._client.get_executor(pure=False)
        return found


def kernels_needed(study: Study, plan: Plan) -> list[str]:
    """Names of the methods whose kernels a study's method uses: `auto` may go by events."""
    from archfrag.methods.auto import goes_by_events
    from archfrag.methods.registry import AUTO, METHODS

    method = plan.method
    if method["name"] != AUTO:
        return [method["name"]]
    defaults = {parameter.name: parameter.default for parameter in METHODS[AUTO].parameters}
    rtol = defaults["rtol"] if method["rtol"] is None else method["rtol"]
    entries = study.members(len(plan.records)).entries
    by_events = {goes_by_events(entry.build().n_voussoir, rtol) for entry in entries}
    return [(AUTO, "event_driven")[by] for by in sorted(by_events)]
