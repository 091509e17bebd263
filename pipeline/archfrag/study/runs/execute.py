"""The runs of a batch: made here for the first seconds, then by workers; resumable."""

import contextlib
import multiprocessing
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from concurrent.futures import ProcessPoolExecutor as Pool
from concurrent.futures.process import BrokenProcessPool
from functools import lru_cache, partial
from itertools import islice
from multiprocessing import spawn
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from archfrag.errors import WorkerError
from archfrag.files import end_with_parent, make_folder
from archfrag.fragility.counts import Verdict
from archfrag.study.file.arches import ArchEntry
from archfrag.study.file.members import check_standing
from archfrag.study.file.records import PreparedRecord, load_record
from archfrag.study.file.schema import Method, Study
from archfrag.study.files import add_to_log, available_cores, commit, machine, versions
from archfrag.study.runs import store
from archfrag.study.runs.design import Cases, Verdicts, ask
from archfrag.study.runs.store import Plan, Table, places

if TYPE_CHECKING:
    import pandas as pd

IN_PROCESS = 5.0  # CPU time of runs that this process makes before workers are started [s]
IN_FLIGHT = 2  # chunks for each worker
# A chunk is one call: four of its runs go side by side to near its end. It takes about a second,
# which is what a lost worker loses, and what the others wait for at the end.
LANES, FIRST_CHUNK, LARGEST_CHUNK, CHUNK_TIME = 4, 16, 200, 1.0
LOSSES_ALLOWED = 3
PATIENCE = 60.0  # with a scheduler that has no workers yet [s]
ANSWER_WITHIN = 10.0  # [s]
_GO_ON = "finished parts are kept, the same command goes on"
_STARTING = threading.Lock()
_motion = lru_cache(maxsize=64)(load_record)  # one of a minute with its vertical takes 0.2 MB


def make_runs(
    work: Path, parts: Path, method: Method, arch: ArchEntry,
    records: Sequence[PreparedRecord], factors: Sequence[float], keys: NDArray[np.bytes_],
    code: tuple[str, str],
) -> tuple[Path, float]:  # fmt: skip
    """Make some runs of one arch, motions from the folder `work`; their part and CPU time [s].

    `code` is the identity and the description of the code that asks for them. A process that has
    other code makes none (WorkerError).
    """
    from archfrag.simulate import results_of_runs

    if store.code_identity() != code[0]:
        raise WorkerError(
            f"a worker on {socket.gethostname()} runs {describe_code()}; the study is run by "
            f"{code[1]}; install the same code for all workers, and start them anew"
        )
    started = time.process_time()
    motions = [_motion(work, record) for record in records]
    options = method.model_dump(exclude={"name", "delay"})
    options |= {"method": method.name, "far": method.delay}
    results, wall_time = results_of_runs(arch.build(), motions, factors, **options)
    part = store.write_part(parts, keys, store.columns_of(results) | {"wall_time": wall_time})
    return part, time.process_time() - started


def run_batch(
    study: Study, batch: int = 0, workers: int | None = None, quiet: bool = False,
    plan: Plan | None = None,
) -> tuple[dict[str, Any], "pd.DataFrame"]:  # fmt: skip
    """Make the runs of one batch that the design requests; those that are there are kept.

    Returned are the entry of the log (runs requested and of them kept, iterations, workers, wall
    time, of which compiling, time in the kernels summed over workers [s]) and a row for each run:
    arch, record, level, verdict, steps, wall time [s]. `workers` take the place of the study's;
    `plan` is that of the study, if it is known. WorkerError if workers cannot be started or are
    lost.
    """
    import pandas as pd

    started = time.perf_counter()
    log: dict[str, Any] = dict.fromkeys(("runs", "kept", "iterations"), 0)
    known = plan or store.make_plan(study)
    table = store.read_parts(make_folder(known.parts))
    count = workers or study.execution.workers or available_cores()
    requests = known.requests(batch, study.execution.batches)
    estimate = len(requests) * study.design.size(len(known.records), len(known.levels))[0]
    seen = sys.stderr.isatty() or "ipykernel" in sys.modules
    pause = 0.2 if seen else 10.0  # a file gets few lines
    bar = _Bar(
        unit="run", desc="simulations", total=0, disable=quiet, file=sys.stderr,
        dynamic_ncols=True, mininterval=pause, delay=pause,
    )  # fmt: skip

    def verdicts_of(cases: Cases) -> Verdicts:
        nonlocal table
        keys = known.keys(cases)
        missing = np.flatnonzero(places(table, keys) < 0)
        # Arches that differ in id only have runs in common.
        missing = missing[np.sort(np.unique(keys[missing], return_index=True)[1])]
        log["iterations"] += 1
        log["runs"] += len(keys)
        log["kept"] += len(keys) - missing.size
        if not bar.disable:  # runs that are not missing are shown as done, at no time
            bar.estimated = study.design.adaptive
            bar.total = estimate if bar.estimated else log["runs"]
            bar.initial += len(keys) - missing.size
            bar.update(len(keys) - missing.size)
        while missing.size:
            table = store.joined([table, *makers.make(cases[missing])])
            missing = missing[places(table, keys[missing]) < 0]
        verdicts: Verdicts = table["verdict"][places(table, keys)]
        return verdicts

    with bar, contextlib.closing(_Makers(known, count, bar)) as makers:
        cases, _ = ask(requests, verdicts_of)
        bar.finish(log["runs"])
        bar.leave = False  # the caller tells what was done
    log |= {"workers": makers.used, "kernel_time": makers.kernel_time}
    log["compile_time"] = makers.compile_time
    log["wall_time"] = time.perf_counter() - started
    add_to_log(study.work, {"step": "runs", "batch": batch, **log, **machine()})
    rows = table[places(table, known.keys(cases))]
    names = np.array([member.name.lower() for member in Verdict], object)
    return log, pd.DataFrame({
        "arch": np.array([member.id for member in known.arches], object)[cases["arch"]],
        "record": np.array([record.id for record in known.records], object)[cases["record"]],
        "level": cases["level"], "verdict": names[rows["verdict"]],
        "steps": rows["steps"], "wall_time": rows["wall_time"],
    })  # fmt: skip


def describe_code() -> str:
    """Name the code of this process: version, commit, identity, and what it is compiled with."""
    found = versions()
    packages = ", ".join(f"{name} {found.get(name)}" for name in ("numba", "numpy"))
    own = f"identity {store.code_identity()[:12]}, {packages}"
    return f"archfrag {found['archfrag']} (commit {commit()[:12]}, {own})"


def chunks(cases: Cases, size: Callable[[], int]) -> Iterator[Cases]:
    """Runs cut into chunks of one arch each, of as many runs as `size` then gives."""
    for own in np.split(cases, np.flatnonzero(np.diff(cases["arch"])) + 1):
        start = 0
        while start < len(own):
            end = start + size()
            yield own[start:end]
            start = end


class _Bar(tqdm):
    """A bar that keeps its total; one that is only estimated is reached when all is done."""

    estimated = False

    def update(self, n: float | None = 1) -> bool | None:
        """Advance by some runs."""
        if self.estimated:
            n = max(0, min(n or 0, (self.total or 0) - 1 - self.n))
        shown: bool | None = super().update(n)
        return shown

    def finish(self, count: int) -> None:
        """Show the runs as all that there are, if anything was shown before."""
        if self.estimated and self.last_print_t > self.start_t + (self.delay or 0.0):
            self.n = self.total = count
            self.refresh()


class _Makers:
    """Makes runs in this process while that is cheaper than workers, then on workers."""

    def __init__(self, plan: Plan, count: int, bar: tqdm) -> None:
        self.used = 0  # processes
        self.kernel_time = self.compile_time = 0.0  # [s]
        self._plan, self._count, self._bar = plan, count, bar
        self._code = plan.identity, describe_code()
        self._runs, self._cpu, self._losses = 0, 0.0, 0
        self._pool: Executor | None = None
        self._client: Any = None

    def close(self) -> None:
        """End all workers."""
        if self._pool is not None:
            with contextlib.suppress(OSError):  # of a pool that has just lost its workers
                # That of dask cancels what waits without being told.
                more = {} if self._client is not None else {"cancel_futures": True}
                self._pool.shutdown(wait=False, **more)
            for child in multiprocessing.active_children():
                child.kill()
                child.join()
        if self._client is not None:
            self._client.close()

    def make(self, cases: Cases) -> list[Table]:
        """Make runs, of so many chunks at once that memory stays bounded.

        Returned are their parts, not all if a worker was lost; WorkerError if that goes on.
        """
        if not self.used:
            self._prepare()
        made: list[Table] = []
        work, waiting = chunks(cases, self._size), set[Future[tuple[Path, float]]]()
        try:
            while True:
                long = self._count > 1 and self._cpu >= IN_PROCESS
                if self._pool is None and (long or self._plan.study.execution.scheduler):
                    self._pool = self._start()
                free = 1 if self._pool is None else IN_FLIGHT * self._count - len(waiting)
                waiting |= {self._submit(chunk) for chunk in islice(work, free)}
                if not waiting:
                    break
                done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                for path, cpu in (future.result() for future in done):
                    if (part := store.read_part(path)) is None:
                        raise WorkerError(f"{path}: cannot be read back; {_GO_ON}")
                    made.append(part)
                    self._runs += len(part)
                    self._cpu += cpu
                    self.kernel_time += float(part["wall_time"].sum())
                    self._bar.update(len(part))
        except CancelledError as error:
            raise WorkerError(f"the scheduler is gone; {_GO_ON}") from error
        except (ImportError, AttributeError, TypeError) as error:  # of another version's modules
            if self._client is None:
                raise
            what = f"{type(error).__name__}: {error}; all workers must have {self._code[1]}"
            raise WorkerError(f"a worker failed: {what}; {_GO_ON}") from error
        except BrokenProcessPool:
            self._losses += 1
            if self._losses > LOSSES_ALLOWED:
                lost = f"workers were killed or ran out of memory {self._losses} times"
                raise WorkerError(f"{lost}; {_GO_ON}") from None
            self._pool = None
        return made

    def _prepare(self) -> None:
        from archfrag.warmup import every, kernels_are_compiled, warmup

        bar, self.used = self._bar, 1
        with contextlib.nullcontext() if bar.disable else every(bar.mininterval, bar.refresh):
            name = method_to_compile(self._plan)
            if not kernels_are_compiled(name):  # else each worker loads them for itself
                bar.bar_format = "{desc}"
                show = partial(bar.set_description_str, refresh=False)
                self.compile_time = warmup(name, progress=show)
            check_standing(self._plan.arches)
        bar.bar_format, bar.desc = None, "simulations"
        bar.unpause()  # its clock is that of the runs
        if self.compile_time and not bar.disable:
            bar.delay = 0.0
            bar.write(f"archfrag: kernels: compiled in {self.compile_time:.1f} s", sys.stderr)

    def _size(self) -> int:
        """Runs of the next chunk, by how long the runs so far took."""
        if (given := self._plan.study.execution.chunk) is not None:
            return given
        if not self._runs:
            return FIRST_CHUNK
        lanes = CHUNK_TIME * self._runs / max(self._cpu, 1e-9) / LANES
        return LANES * int(np.clip(lanes, 1, LARGEST_CHUNK // LANES))

    def _submit(self, cases: Cases) -> "Future[tuple[Path, float]]":
        plan = self._plan
        work = (
            plan.study.work, plan.parts, plan.study.method, plan.arches[cases["arch"][0]].entry,
            [plan.records[record] for record in cases["record"]],
            plan.factors(cases).tolist(), plan.keys(cases), self._code,
        )  # fmt: skip
        if self._pool is not None:
            self.used = self._count
            with _without_script():
                return self._pool.submit(make_runs, *work)
        future: Future[tuple[Path, float]] = Future()
        future.set_result(make_runs(*work))
        return future

    def _start(self) -> Executor:
        """Processes of this machine, or workers of the dask scheduler that the study names."""
        address = self._plan.study.execution.scheduler
        if address is None:
            return Pool(self._count, multiprocessing.get_context("spawn"), _follow_parent)
        from distributed import Client

        try:
            self._client = Client(address, timeout=ANSWER_WITHIN, set_as_default=False)
            self._client.wait_for_workers(1, timeout=PATIENCE)
        except (OSError, TimeoutError, ValueError, RuntimeError) as error:
            what = f"{address} cannot be used: {error or type(error).__name__}"
            raise WorkerError(f"execution.scheduler: {what}; {_GO_ON}") from error
        self._count = max(1, len(self._client.scheduler_info()["workers"]))
        executor: Executor = self._client.get_executor(pure=False)
        return executor


@contextlib.contextmanager
def _without_script() -> Iterator[None]:
    """Let processes that this thread starts do without the user's script, which they would run."""
    thread = threading.get_ident()

    def prepared(name: str) -> dict[str, Any]:
        given: dict[str, Any] = usual(name)
        own = threading.get_ident() == thread
        return {k: v for k, v in given.items() if not (own and k.startswith("init_main"))}

    with _STARTING:
        usual = spawn.get_preparation_data
        spawn.get_preparation_data = prepared
        try:
            yield
        finally:
            spawn.get_preparation_data = usual


def _follow_parent() -> None:
    """Leave Ctrl-C to the process that started this one, and end when it is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent()


def method_to_compile(plan: Plan) -> str:
    """Return the name of the method whose kernels a study needs."""
    from archfrag.methods.auto import goes_by_events
    from archfrag.methods.registry import AUTO, METHODS

    method = plan.study.method
    if method.name != AUTO:
        return method.name
    defaults = {parameter.name: parameter.default for parameter in METHODS[AUTO].parameters}
    rtol = defaults["rtol"] if method.rtol is None else method.rtol
    return "event_driven" if goes_by_events(rtol) else AUTO
