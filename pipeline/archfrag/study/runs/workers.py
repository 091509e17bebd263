"""Runs fanned out by dask: on threads of this process, or on the workers of a cluster."""

import contextlib
import importlib
import json
import operator
import pickle
import socket
import sys
import threading
import uuid
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from functools import cache, partial
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any

import numpy as np

from archfrag.errors import WorkerError
from archfrag.files import counted
from archfrag.simulation.simulate import results_of_runs
from archfrag.study.designs import Cases
from archfrag.study.provenance import available_cores, commit, versions
from archfrag.study.runs import store
from archfrag.study.runs.store import Plan, Table

if TYPE_CHECKING:
    from distributed import Client

ANSWER_WITHIN = 10.0  # longest wait for a scheduler [s]
HEARD_WITHIN = 0.5  # longest time until Ctrl-C is noticed [s]
# What the steps after the runs import, half a second of it because xarray asks for dask's arrays.
# This thread alone does so: two that import the same at once may fail.
NEEDED_LATER = ("archfrag.study.answer.fits", "dask.array")
_GO_ON = "finished parts are kept, the same command goes on"
Made = tuple[Any, Table]  # the key of a chunk, and the rows of its runs
_identity = cache(store.code_identity)
_ONE_AT_A_TIME = threading.Lock()  # Python's parser needs it, up to 3.11 at least


def make_runs(plan: Plan, cases: Cases) -> Table:
    """Make some runs of one arch and return their rows.

    WorkerError if this process has other code than the one that made the plan.
    """
    with _ONE_AT_A_TIME:
        same = _identity() == plan.identity
    if not same:
        raise WorkerError(f"a worker on {socket.gethostname()} runs {describe_code()}")
    runs = zip(
        cases["arch"].tolist(), cases["record"].tolist(), plan.factors(cases).tolist()
    )
    motions, factors = zip(*(plan.ground(*run) for run in runs))
    options = plan.study.method.model_dump()
    options["method"] = options.pop("name")
    arch = plan.arch(int(cases["arch"][0]))
    results, wall_time, starts = results_of_runs(arch, motions, factors, **options)
    return store.table_of(plan.keys(cases), results, wall_time, starts)


def describe_code() -> str:
    """Name the code of this process: version, commit, identity, and what it is compiled with."""
    found = versions()
    return (
        f"archfrag {found['archfrag']} (commit {commit()[:12]}, identity "
        f"{store.code_identity()[:12]}, numba {found.get('numba')}, numpy {found.get('numpy')})"
    )


class Threads:
    """Workers that are threads of this process.

    Kernels run in parallel on them, since they do not hold the GIL.
    """

    spare = 0  # chunks that may wait while all threads are busy

    def __init__(self, plan: Plan, count: int) -> None:
        self.count = count
        self._plan = plan
        self._made = SimpleQueue[Made | Future]()
        self._pool = ThreadPoolExecutor(count)
        self._graphs = ThreadPoolExecutor(count)  # each thread waits for a graph

    def send(self, chunks: dict[Any, Cases]) -> None:
        """Start some chunks of runs, given by key."""
        import dask.threaded

        graph: dict[Any, Any] = {"plan": self._plan}
        graph |= {key: (make_runs, "plan", chunk) for key, chunk in chunks.items()}

        def keep(key, rows, *_) -> None:
            if key != "plan":
                self._made.put((key, rows))

        def end(whole: Future) -> None:
            if not whole.cancelled() and whole.exception():
                self._made.put(whole)

        self._graphs.submit(
            dask.threaded.get,
            graph,
            list(chunks),
            pool=self._pool,
            callbacks=[(None, None, None, keep, None)],  # after each task
        ).add_done_callback(end)
        with contextlib.suppress(ImportError):  # distributed is an extra
            for name in NEEDED_LATER:  # kernels leave the GIL to it
                importlib.import_module(name)

    def made(self) -> list[Made]:
        """Wait for the next chunk; return its key and its rows, in a list."""
        while True:  # a signal may come just before a wait, and is heard after it
            with contextlib.suppress(Empty):
                found = self._made.get(timeout=HEARD_WITHIN)
                return [found.result() if isinstance(found, Future) else found]

    def close(self) -> None:
        """Start no more chunks. A thread that makes a chunk goes on to its end."""
        for pool in (self._pool, self._graphs):
            pool.shutdown(wait=False, cancel_futures=True)


class Cluster:
    """The workers of a dask client; they need no files of this machine."""

    spare = 1

    def __init__(self, plan: Plan, client: "Client", name: str) -> None:
        import dask
        from distributed import as_completed

        self._client = client
        self._name = name
        key = f"plan-{uuid.uuid4().hex}"  # others may use the scheduler too
        with self._worded():
            self._futures = as_completed(with_results=True, loop=client.loop)
            # As bytes, so that neither a scheduler nor a worker without our code ends by them.
            content = pickle.dumps(partial(make_runs, plan.with_motions()))
            # The scheduler keeps this graph: motions are sent anew if their worker is lost.
            with dask.config.set(
                {"distributed.admin.large-graph-warning-threshold": "1TB"}
            ):
                (self._plan,) = client.get(
                    {key: (pickle.loads, content)}, [key], sync=False
                )

    @property
    def count(self) -> int:
        """Number of threads of the workers that are connected now."""
        with self._worded():
            return sum(self._client.nthreads().values())

    def send(self, chunks: dict[Any, Cases]) -> None:
        """Start some chunks of runs, given by key."""
        graph = {
            key: (operator.call, self._plan, chunk) for key, chunk in chunks.items()
        }
        with self._worded():
            self._futures.update(self._client.get(graph, list(graph), sync=False))

    def made(self) -> list[Made]:
        """Wait for the next chunks; return the key and the rows of each."""
        with self._worded():
            found = [(future.key, rows) for future, rows in self._futures.next_batch()]
            if not all(isinstance(rows, np.ndarray) for _, rows in found):
                raise CancelledError
            return found

    def close(self) -> None:
        """Cancel all chunks that are not finished."""
        with contextlib.suppress(Exception):  # of a scheduler that is gone
            self._client.cancel([self._plan, *self._futures.futures])

    @contextlib.contextmanager
    def _worded(self) -> Iterator[None]:
        """Turn errors of workers or their scheduler into a WorkerError that says what is wrong."""
        from distributed.scheduler import KilledWorker

        try:
            yield
        except WorkerError as error:
            raise WorkerError(
                f"{error}; the study is run by {describe_code()}; install the same code for all "
                "workers, and start them anew"
            ) from error
        except KilledWorker as error:
            raise WorkerError(
                f"{self._name}: workers were killed or ran out of memory again and again "
                f"({error}); {_GO_ON}"
            ) from error
        except (CancelledError, OSError) as error:
            raise WorkerError(
                f"{self._name}: the scheduler is gone; {_GO_ON}"
            ) from error
        # Of other modules.
        except (ImportError, NameError, AttributeError, TypeError) as error:
            raise WorkerError(
                f"a worker failed: {type(error).__name__}: {error}; all workers must have "
                f"{describe_code()}; {_GO_ON}"
            ) from error


@contextlib.contextmanager
def workers_of(
    plan: Plan, count: int | None, say: Callable[[str], object]
) -> Iterator[Threads | Cluster]:
    """Give the workers for the runs of a plan, and close them after the block.

    They are the cluster that the study names, else the current dask client, else threads. If
    `count`, the number of threads, is given, a current client is not used. `say` is called with a
    line if a cluster is used. WorkerError if the cluster cannot be used.
    """
    given = plan.study.execution.scheduler
    with contextlib.ExitStack() as stack:
        workers: Threads | Cluster
        client: Client | None = None
        if given:
            client = stack.enter_context(_client_of(given))
        elif not count and "distributed" in sys.modules:
            from distributed import default_client

            with contextlib.suppress(ValueError):  # a script has made none
                client = default_client()
        if client is None:
            workers = Threads(plan, count or available_cores())
        else:
            name = given or client.scheduler.address
            workers = Cluster(plan, client, name)
            threads = workers.count
            have = counted(threads, "thread")
            if not threads:
                have = "no worker yet; runs begin when one comes"
            say(f"archfrag: cluster {name}: {have}")
        stack.callback(workers.close)
        yield workers


def _client_of(given: str) -> "Client":
    """Connect to the scheduler that a study names by its address or its file."""
    try:
        from distributed import Client
    except ImportError:
        raise WorkerError(
            f"execution.scheduler: {given} needs distributed, which comes with `pip install "
            "archfrag[cluster]`"
        ) from None
    try:
        # Of a file that is not there dask would wait without end.
        read = given.endswith(".json")
        address = json.loads(Path(given).read_bytes())["address"] if read else given
        return Client(address, timeout=ANSWER_WITHIN, set_as_default=False)
    except (OSError, ValueError, RuntimeError, LookupError, TypeError) as error:
        raise WorkerError(
            f"execution.scheduler: {given} cannot be used: {error or type(error).__name__}; "
            f"{_GO_ON}"
        ) from error
