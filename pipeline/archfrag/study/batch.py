"""The runs of a batch on dask workers: chunk by chunk, resumable, with bounded memory."""

import contextlib
import inspect
import logging
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field
from typing import Any

import dask
from distributed import Client, Future, LocalCluster, Security, wait
from distributed.scheduler import KilledWorker
from tqdm import tqdm

from archfrag.errors import ArchfragError, WorkerError
from archfrag.study.bundles import Bundles
from archfrag.study.checks import check_arches
from archfrag.study.config import Study
from archfrag.study.files import make_folder
from archfrag.study.parts import read_part
from archfrag.study.plan import Plan, chunks_of_batch, make_plan
from archfrag.study.provenance import add_to_log, available_cores, machine
from archfrag.study.worker import run_chunks

# A worker is to stay below 400 MB; dask ends one that reaches 95 % of the limit.
MEMORY_LIMIT = 800 * 10**6
IN_FLIGHT = 2
LOOK_AFTER = 0.5  # between looks whether workers are there [s]
LOSSES_ALLOWED = 3
PATIENCE = 60.0
ANSWER_WITHIN = 10.0
_SETTINGS: dict[str, Any] = {
    "distributed.scheduler.allowed-failures": LOSSES_ALLOWED,
    # A kernel holds its worker's only thread, and with it the heartbeat, for a whole run.
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
    runs: int = 0
    kept: int = 0
    workers: int = 0
    wall_time: float = 0.0  # [s]
    kernel_time: float = 0.0  # summed over workers [s]
    peak_memory: dict[str, float] = field(default_factory=dict)  # by process [MB]


def run_batch(
    study: Study, batch: int = 0, workers: int | None = None, quiet: bool = False
) -> BatchLog:
    """Run one batch of a study; parts that are there and valid are kept.

    Parameters
    ----------
    study : Study
        Whose motions are prepared.
    batch : int
        Which of the study's batches.
    workers : int, optional
        Processes; as the study says, or as many as cores, if not given.
    quiet : bool
        No progress bar.

    Raises
    ------
    InputError
        If the motions are not prepared, or there is no such batch.
    StabilityError
        If an arch does not stand.
    OutputError
        If the output cannot be written; finished parts are kept.
    WorkerError
        If workers are lost again and again, or no scheduler answers.
    """
    started = time.perf_counter()
    plan = make_plan(study)
    chunks = list(chunks_of_batch(plan, batch, study.execution.batches))
    for folder in (plan.part(0).parent, plan.timing(0).parent):
        make_folder(folder)
    missing = [chunk for chunk in chunks if read_part(plan, chunk) is None]
    log = BatchLog(batch, runs=sum(len(plan.rows(c)) for c in chunks))
    log.kept = log.runs - sum(len(plan.rows(c)) for c in missing)
    if missing:
        plan.save()
        log.workers = min(workers or study.execution.workers or available_cores(), len(missing))
        with _progress(log, quiet) as bar, contextlib.ExitStack() as stack:
            with _ticking(bar):
                _compile_kernels(kernels_needed(study, plan), bar)
                bar.set_description("starting workers")
                with ThreadPoolExecutor(1) as beside:
                    checked = beside.submit(check_arches, study)
                    client = stack.enter_context(_client(study, log.workers))
                checked.result()
            _start_clock(bar)
            for done in _results(client, plan, missing):
                bar.update(int(done["runs"]))
                log.kernel_time += done["kernel_time"]
                log.peak_memory[str(done["pid"])] = done["peak_memory"]
    log.wall_time = time.perf_counter() - started
    add_to_log(study.work, {"step": "batch", **asdict(log), **machine()})
    return log


def _compile_kernels(names: list[str], bar: tqdm) -> None:
    """Compile the kernels of some methods, which the bar then says, if they are not."""
    from archfrag.simulate import kernels_are_compiled, warmup

    options: dict[str, Any] = {}
    if "progress" in inspect.signature(warmup).parameters:
        options["progress"] = bar.set_description
    for name in names:
        if not kernels_are_compiled(name):  # else each worker loads them for itself
            warmup(name, **options)


def kernels_needed(study: Study, plan: Plan) -> list[str]:
    """Names of the methods whose kernels a study's method uses: `auto` may go by events."""
    from archfrag.methods.auto import goes_by_events
    from archfrag.methods.registry import AUTO, METHODS

    method = study.method
    if method.name != AUTO:
        return [method.name]
    defaults = {parameter.name: parameter.default for parameter in METHODS[AUTO].parameters}
    rtol = defaults["rtol"] if method.rtol is None else method.rtol
    coarse = (method.settings or {}).get("coarse", defaults["coarse"])
    bodies = {entry.build().n_voussoir for entry in study.arches}
    breaks = {record.breaks for record in plan.records}
    found = {goes_by_events(n, each, rtol, coarse) for n in bodies for each in breaks}
    return [name for by, name in ((False, AUTO), (True, "event_driven")) if by in found]


@contextlib.contextmanager
def _progress(log: BatchLog, quiet: bool) -> Iterator[tqdm]:
    with tqdm(
        total=log.runs,
        initial=log.kept,
        unit="run",
        desc="simulations",
        disable=quiet,
        file=sys.stderr,
        dynamic_ncols=True,
        mininterval=0.2 if sys.stderr.isatty() else 10.0,
    ) as bar:
        yield bar


@contextlib.contextmanager
def _ticking(bar: tqdm) -> Iterator[None]:
    """Show the time that passes while nothing is done that the bar counts."""
    over = threading.Event()

    def tick() -> None:
        while not over.wait(bar.mininterval):
            bar.refresh()

    ticker = threading.Thread(target=tick, daemon=True)
    if not bar.disable:
        ticker.start()
    try:
        yield
    finally:
        over.set()
        if ticker.is_alive():
            ticker.join()


def _start_clock(bar: tqdm) -> None:
    """Begin to measure the rate of runs: what the start took says nothing of what is left."""
    bar.set_description("simulations", refresh=False)
    if not bar.disable:
        bar.start_t = bar.last_print_t = time.time()


@contextlib.contextmanager
def _client(study: Study, count: int) -> Iterator[Client]:
    """Client of the study's scheduler, or of a cluster of our own that ends with the block."""
    for name in ("distributed", "distributed.nanny", "distributed.scheduler"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    address = study.execution.scheduler
    settings = {**_SETTINGS, "temporary-directory": str(study.work / "dask")}
    with contextlib.ExitStack() as stack:
        stack.enter_context(dask.config.set(settings))
        try:
            if address is None:
                target = stack.enter_context(
                    LocalCluster(
                        n_workers=count,
                        threads_per_worker=1,
                        processes=True,
                        memory_limit=MEMORY_LIMIT,
                        # Whoever reaches a scheduler may run code: these credentials are known
                        # to the processes of this cluster only.
                        security=Security.temporary(),
                        dashboard_address="127.0.0.1:0",  # any: two studies may run at once
                        silence_logs=logging.CRITICAL,
                    )
                )
            else:
                target = address
            client = stack.enter_context(Client(target, timeout=ANSWER_WITHIN))
        except (OSError, TimeoutError, ValueError, RuntimeError) as error:
            what = f"execution.scheduler: {address}" if address else "the local workers"
            raise WorkerError(
                f"{what} cannot be used: {error or type(error).__name__}; finished parts are kept"
            ) from error
        yield client


def _results(client: Client, plan: Plan, chunks: list[int]) -> Iterator[dict[str, float]]:
    """Run chunks with few in flight, so that memory does not grow with their number."""
    at_work: set[Future] = set()
    crew = _Crew(client)
    bundles = Bundles(plan, chunks, crew.size)

    def send(count: int) -> None:
        for _ in range(count):
            bundle = bundles.take()
            if not bundle:
                return
            key = f"{_name(bundle)}-{plan.identity[:12]}"
            at_work.add(client.submit(run_chunks, str(plan.path), bundle, key=key, pure=False))

    send(IN_FLIGHT * max(1, crew.size))
    try:
        while at_work:
            with contextlib.suppress(TimeoutError):
                wait(at_work, timeout=1.0, return_when="FIRST_COMPLETED")
            crew.check()
            for future in [future for future in at_work if future.done()]:
                results = _result(future)
                if results is not None:
                    at_work.discard(future)
                    bundles.learn(results)
                    send(1)
                    yield from results
    finally:
        if at_work:
            with contextlib.suppress(Exception):
                client.cancel(list(at_work), force=True)


def _name(bundle: tuple[int, ...]) -> str:
    first, others = bundle[0], len(bundle) - 1
    return f"chunk-{first}" + (f"-and-{others}-more" if others else "")


def _result(future: Future) -> list[dict[str, float]] | None:
    """Results of a bundle; None if it went under with its worker and is to be made again."""
    try:
        return future.result(timeout=2.0)
    except ArchfragError:
        raise
    except TimeoutError:
        return None
    except KilledWorker as error:
        raise WorkerError(
            f"{future.key}: its worker was killed or ran out of memory {LOSSES_ALLOWED + 1} "
            "times; finished parts are kept, the same command with --resume goes on"
        ) from error


class _Crew:
    """Watches for workers that vanish: dask itself would wait for ever."""

    def __init__(self, client: Client) -> None:
        self._client = client
        self._seen = set(self._addresses())
        self.size = len(self._seen)
        self._alive_at = self._looked_at = time.monotonic()

    def _addresses(self) -> list[str]:
        return list(self._client.scheduler_info(n_workers=-1)["workers"])

    def check(self) -> None:
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
            raise WorkerError(
                f"{lost} workers were lost (killed, or out of memory) and {len(present)} are "
                "left; finished parts are kept, the same command with --resume goes on"
            )
