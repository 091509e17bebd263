"""The runs of a batch on dask workers: round by round, resumable, with bounded memory."""

import contextlib
import logging
import sys
import time
from collections import deque
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import dask
import numpy as np
from distributed import Client, Future, LocalCluster, Security, wait
from distributed.scheduler import KilledWorker
from numpy.typing import NDArray
from tqdm import tqdm

from archfrag.errors import WorkerError
from archfrag.files import temporary_folder
from archfrag.study.bundles import Bundles, Rates
from archfrag.study.checks import check_arches
from archfrag.study.config import Study
from archfrag.study.files import make_folder
from archfrag.study.members import members
from archfrag.study.plan import Plan, make_plan
from archfrag.study.provenance import add_to_log, available_cores, machine
from archfrag.study.rounds import Cases
from archfrag.study.store import Store, timings_folder
from archfrag.study.worker import run_chunk, run_chunks

# A worker is to stay below 400 MB; dask ends one that reaches 95 % of the limit.
MEMORY_LIMIT = 800 * 10**6
IN_FLIGHT = 2
IN_PROCESS = 5.0  # of runs that this process makes before workers are started [s]
# A chunk is one call: four of its runs go side by side to near its end, workers divide a round.
LANES, SMALLEST_CHUNK, LARGEST_CHUNK, CHUNKS_EACH = 4, 8, 200, 3
# Where that makes many parts they hold more, so that looking for those there takes seconds.
MANY_PARTS = 2000
LOOK_AFTER = 0.5  # between looks whether workers are there [s]
LOSSES_ALLOWED = 3
PATIENCE = 60.0
ANSWER_WITHIN = 10.0
_GO_ON = "finished parts are kept, the same command with --resume goes on"
_SETTINGS: dict[str, Any] = {
    "distributed.scheduler.allowed-failures": LOSSES_ALLOWED,
    # A kernel holds its worker's only thread, and with it the heartbeat, for an entire run.
    "distributed.scheduler.worker-ttl": None,
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
    "distributed.worker.memory.terminate": 0.95,
    "distributed.admin.tick.limit": "1h",
    # What dask looks at beside the runs took 5 % of a core here and 2 % in each worker.
    "distributed.worker.profile.enabled": False,
    "distributed.worker.memory.monitor-interval": "250ms",
    "distributed.admin.tick.interval": "500ms",
    "distributed.admin.system-monitor.interval": "2s",
    "distributed.scheduler.active-memory-manager.start": False,
    "distributed.comm.timeouts.connect": "30s",
    # What is asked by HTTP has no credentials, so nothing answers there.
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
}


@dataclass
class BatchLog:
    """What a batch took; for the log beside the cube, never for the cube."""

    batch: int
    runs: int = 0  # that the design asked for
    kept: int = 0  # of them not made now
    rounds: int = 0
    workers: int = 0
    wall_time: float = 0.0  # [s]
    kernel_time: float = 0.0  # summed over workers [s]
    peak_memory: dict[str, float] = field(default_factory=dict)  # by process [MB]


def run_batch(
    study: Study, batch: int = 0, workers: int | None = None, quiet: bool = False
) -> BatchLog:
    """Make the runs of one batch that the design asks for; those that are there are kept."""
    started = time.perf_counter()
    plan = make_plan(study)
    for folder in (plan.parts, timings_folder(plan.parts)):
        make_folder(folder)
    log = BatchLog(batch)
    rounds, store = plan.rounds(batch, study.execution.batches), Store(plan.parts)
    count = workers or study.execution.workers or available_cores()
    with contextlib.ExitStack() as stack:
        bar = stack.enter_context(tqdm(
            unit="run", desc="simulations", disable=quiet, file=sys.stderr, dynamic_ncols=True,
            mininterval=0.2 if sys.stderr.isatty() else 10.0,
        ))  # fmt: skip
        in_one_round = plan.design["kind"] in ("stripes", "cloud")
        executor = _Executor(study, plan, count, bar, stack)
        while len(rounds.wanted):
            factors = plan.factors(rounds.wanted)
            keys = plan.keys(rounds.wanted, factors)
            missing = np.flatnonzero(store.places(keys) < 0)
            # Arches that differ in id only have runs in common.
            missing = missing[np.sort(np.unique(keys[missing], return_index=True)[1])]
            log.runs += len(keys)
            log.kept += len(keys) - missing.size
            _count(bar, log.runs, missing.size, in_one_round)
            if missing.size:
                chunks = cut(rounds.wanted[missing], study.execution.chunk, count)
                work = [(cases, factors[missing[rows]]) for rows, cases in chunks]
                for done in executor.results(work):
                    if not store.add(Path(done["part"])):
                        raise WorkerError(f"{done['part']}: cannot be read back; {_GO_ON}")
                    bar.update(int(done["runs"]))
                    log.kernel_time += done["kernel_time"]
                    log.peak_memory[str(done["pid"])] = done["peak_memory"]
            rounds.answer(store.verdicts(keys))
    log.rounds, log.workers = rounds.count, executor.count
    log.wall_time = time.perf_counter() - started
    add_to_log(study.work, {"step": "batch", **asdict(log), **machine()})
    return log


def cut(cases: Cases, chunk: int | None, workers: int) -> list[tuple[slice, Cases]]:
    """Runs cut into chunks of one arch and stage each, which a worker makes in one call."""
    even = -(-len(cases) // (CHUNKS_EACH * workers))
    largest = max(LARGEST_CHUNK, -(-len(cases) // MANY_PARTS))
    most = chunk or min(max(-(-even // LANES) * LANES, SMALLEST_CHUNK), largest)
    kind = np.stack([cases["stage"], cases["arch"]])
    borders = np.flatnonzero((kind[:, 1:] != kind[:, :-1]).any(axis=0)) + 1
    chunks = []
    for start, end in pairwise([0, *borders.tolist(), len(cases)]):
        rows = [slice(first, min(first + most, end)) for first in range(start, end, most)]
        chunks += [(each, cases[each]) for each in rows]
    return chunks


class _Executor:
    """Makes runs: in this process for as long as workers take to start, then on workers."""

    def __init__(
        self, study: Study, plan: Plan, count: int, bar: tqdm, stack: contextlib.ExitStack
    ) -> None:
        self.count = 0
        self._study, self._plan, self._wanted = study, plan, count
        self._bar, self._stack = bar, stack
        asked = study.execution.scheduler is not None or study.execution.workers is not None
        self._left = 0.0 if asked else IN_PROCESS  # of that time [s]
        self._workers: _Workers | None = None

    def results(self, work: list[tuple[Cases, NDArray]]) -> Iterator[dict[str, Any]]:
        """Run chunks, in this process for `IN_PROCESS` seconds."""
        if not self.count:
            self._plan.save()
            with _ticking(self._bar):
                _compile_kernels(kernels_needed(self._study, self._plan), self._bar)
                if self._left > 0.0:
                    check_arches(self._study, len(self._plan.records))
            self.count = 1
        waiting = deque(work)
        while waiting and self._left > 0.0:
            done = run_chunk(str(self._plan.path), *waiting.popleft())
            self._left -= done["wall_time"]
            yield done
        if waiting:
            if self._workers is None:
                self._workers = self.start_workers()
            yield from self._workers.results(self._plan, list(waiting))

    def start_workers(self) -> "_Workers":
        """Workers that are ready, and arches checked."""
        with _ticking(self._bar):
            with ThreadPoolExecutor(1) as beside:
                checked = beside.submit(check_arches, self._study, len(self._plan.records))
                client = self._stack.enter_context(_client(self._study, self._wanted))
            checked.result()
        self.count = self._wanted
        return _Workers(client)


def _compile_kernels(names: list[str], bar: tqdm) -> None:
    """Compile the kernels of some methods, which the bar then shows, if they are not."""
    from archfrag.simulate import kernels_are_compiled, warmup

    for name in names:
        if not kernels_are_compiled(name):  # else each worker loads them for itself
            warmup(name, progress=bar.set_description)
    bar.set_description("simulations", refresh=False)


def kernels_needed(study: Study, plan: Plan) -> list[str]:
    """Names of the methods whose kernels a study's methods use: `auto` may go by events."""
    from archfrag.methods.auto import goes_by_events
    from archfrag.methods.registry import AUTO, METHODS

    defaults = {parameter.name: parameter.default for parameter in METHODS[AUTO].parameters}
    arches = members(study, len(plan.records)).entries
    bodies = {entry.build().n_voussoir for entry in arches}
    names: list[str] = []
    for method in plan.methods:
        if method["name"] != AUTO:
            names.append(method["name"])
            continue
        rtol = defaults["rtol"] if method["rtol"] is None else method["rtol"]
        by_events = {goes_by_events(n, rtol) for n in bodies}
        names += [(AUTO, "event_driven")[by] for by in sorted(by_events)]
    return list(dict.fromkeys(names))


def _count(bar: tqdm, asked: int, missing: int, in_one_round: bool) -> None:
    """Show all runs that are not missing as done; how many there will be where that is known."""
    if not bar.disable:
        bar.initial += asked - missing - bar.n
        bar.total, bar.n = asked if in_one_round else None, asked - missing
        bar.refresh()


def _ticking(bar: tqdm) -> contextlib.AbstractContextManager[None]:
    """Show the time that passes while nothing is done that the bar counts."""
    from archfrag.simulation.warm import every

    return contextlib.nullcontext() if bar.disable else every(bar.mininterval, bar.refresh)


@contextlib.contextmanager
def _client(study: Study, count: int) -> Iterator[Client]:
    """Client of the study's scheduler, or of a cluster of our own that ends with the block."""
    for name in ("distributed", "distributed.nanny", "distributed.scheduler"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    address = study.execution.scheduler
    with contextlib.ExitStack() as stack:
        scratch = stack.enter_context(temporary_folder(study.work))
        settings = {**_SETTINGS, "temporary-directory": scratch}
        stack.enter_context(dask.config.set(settings))
        try:
            # Whoever reaches a scheduler may run code: the credentials are known to the processes
            # of this cluster only. Any port, since two studies may run at once.
            target = address or stack.enter_context(LocalCluster(
                n_workers=count, threads_per_worker=1, processes=True, memory_limit=MEMORY_LIMIT,
                security=Security.temporary(), dashboard_address="127.0.0.1:0",
                silence_logs=logging.CRITICAL,
            ))  # fmt: skip
            client = stack.enter_context(Client(target, timeout=ANSWER_WITHIN))
        except (OSError, TimeoutError, ValueError, RuntimeError) as error:
            what = f"execution.scheduler: {address}" if address else "the local workers"
            why = error or type(error).__name__
            raise WorkerError(f"{what} cannot be used: {why}; finished parts are kept") from error
        yield client


def _result(future: Future) -> list[dict[str, float]] | None:
    """Results of a bundle; None if it went under with its worker and is to be made again."""
    try:
        return future.result(timeout=2.0)
    except TimeoutError:
        return None
    except KilledWorker as error:
        lost = f"its worker was killed or ran out of memory {LOSSES_ALLOWED + 1} times"
        raise WorkerError(f"{future.key}: {lost}; {_GO_ON}") from error


class _Workers:
    """Workers, watched for those that vanish: dask itself would wait for ever."""

    def __init__(self, client: Client) -> None:
        self._client = client
        self._seen = set(self._addresses())
        self.size = len(self._seen)
        self._alive_at = self._looked_at = time.monotonic()
        self._rates: Rates = {}

    def results(self, plan: Plan, work: list[tuple[Cases, NDArray]]) -> Iterator[dict[str, Any]]:
        """Run chunks, so many in flight that memory does not grow with their number."""
        at_work: dict[Future, tuple[int, ...]] = {}
        duration = np.array([record.duration for record in plan.records])
        lengths = [float(duration[cases["record"]].sum()) for cases, _ in work]
        kinds = [(int(cases["stage"][0]), int(cases["arch"][0])) for cases, _ in work]
        bundles = Bundles(lengths, kinds, self.size, self._rates)

        def send() -> None:
            if bundle := bundles.take():
                chunks = [work[chunk] for chunk in bundle]
                key = f"runs-{plan.keys(chunks[0][0][:1], chunks[0][1][:1]).tobytes().hex()}"
                sent = self._client.submit(run_chunks, str(plan.path), chunks, key=key, pure=False)
                at_work[sent] = bundle

        for _ in range(IN_FLIGHT * max(1, self.size)):
            send()
        try:
            while at_work:
                with contextlib.suppress(TimeoutError):
                    wait(list(at_work), timeout=1.0, return_when="FIRST_COMPLETED")
                self._check()
                for future in [future for future in at_work if future.done()]:
                    results = _result(future)
                    if results is not None:
                        bundle = at_work.pop(future)
                        bundles.learn(zip(bundle, (each["wall_time"] for each in results)))
                        send()
                        yield from results
        finally:
            if at_work:
                with contextlib.suppress(Exception):
                    self._client.cancel(list(at_work), force=True)

    def _addresses(self) -> list[str]:
        return list(self._client.scheduler_info(n_workers=-1)["workers"])

    def _check(self) -> None:
        now = time.monotonic()
        if now - self._looked_at < LOOK_AFTER:
            return
        self._looked_at = now
        present = self._addresses()
        self._seen.update(present)
        if present:
            self._alive_at = now
        lost = len(self._seen) - max(self.size, len(present))
        own = self._client.cluster is not None
        if now - self._alive_at > PATIENCE or (own and lost > LOSSES_ALLOWED * self.size):
            left = f"and {len(present)} are left"
            raise WorkerError(f"{lost} workers were killed or out of memory {left}; {_GO_ON}")
