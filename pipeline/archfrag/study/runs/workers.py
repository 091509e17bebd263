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
from collections import defaultdict, deque
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from functools import cache, partial
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any

import numpy as np

from archfrag.errors import WorkerError
from archfrag.files import counted
from archfrag.physics.kernels.primitives import LANES
from archfrag.physics.steps.run import PLACES
from archfrag.simulation.simulate import Stream
from archfrag.study.designs import Cases
from archfrag.study.provenance import available_cores, commit, versions
from archfrag.study.runs import store
from archfrag.study.runs.store import ROW, Plan, Table

if TYPE_CHECKING:
    from distributed import Client

ANSWER_WITHIN = 10.0  # longest wait for a scheduler [s]
HEARD_WITHIN = 0.5  # longest time until Ctrl-C is noticed [s]
# What the steps after the runs import; xarray asks for dask's arrays.
# This thread alone does so: two that import the same at once may fail.
NEEDED_LATER = ("archfrag.study.answer.fits", "dask.array")
_GO_ON = "finished parts are kept, the same command goes on"
Made = tuple[Any, Table]  # the key of a chunk, and the rows of its runs
_identity = cache(store.code_identity)
_ONE_AT_A_TIME = threading.Lock()  # Python's parser needs it, up to 3.11 at least


def make_runs(plan: Plan, cases: Cases, pool: "_Pool | None" = None) -> Table:
    """Make some runs of one arch and return their rows.

    They go side by side with runs of others that have the same `pool`. WorkerError if this process
    has other code than the one that made the plan.
    """
    with _ONE_AT_A_TIME:
        same = _identity() == plan.identity
    if not same:
        raise WorkerError(f"a worker on {socket.gethostname()} runs {describe_code()}")
    return (pool or _Pool(1)).make(plan, cases)


class _Chunk:
    """Runs of one arch that were asked for together, and their rows as they come."""

    def __init__(self, plan: Plan, cases: Cases) -> None:
        self.plan = plan
        self.arch = int(cases["arch"][0])
        self.records = cases["record"].tolist()
        self.factors = plan.factors(cases).tolist()
        self.keys = plan.keys(cases)
        self.rows = np.zeros(len(cases), ROW)
        self.left = len(cases)  # runs that have not ended


class _Pool:
    """Runs that threads make together, so that all lanes are full until the last runs.

    A thread waits for its own runs; meanwhile it steps a stream, which takes whatever runs of its
    arch wait. At most `threads` do so at once.
    """

    def __init__(self, threads: int) -> None:
        self._threads = threads
        self._busy = 0
        self._changed = threading.Condition()
        self._waiting = defaultdict[int, deque[tuple[_Chunk, int]]](deque)  # by arch
        self._streams: list[tuple[int, Stream]] = []  # by arch; those that nobody steps
        self._error: BaseException | None = None

    def make(self, plan: Plan, cases: Cases) -> Table:
        """Make runs of one arch; return their rows."""
        chunk = _Chunk(plan, cases)
        with self._changed:
            self._waiting[chunk.arch] += ((chunk, row) for row in range(len(cases)))
            self._changed.notify_all()
        while chunk.left:
            with self._changed:
                self._changed.wait_for(lambda: not chunk.left or self._can_step())
                if self._error:
                    raise self._error
                self._busy += 1
            try:
                self._step_until(chunk)
            except BaseException as error:
                self.end(error)
            finally:
                with self._changed:
                    self._busy -= 1
                    self._changed.notify_all()
        return chunk.rows

    def end(self, error: BaseException) -> None:
        """Raise an error in all threads that wait for runs."""
        with self._changed:
            self._error = self._error or error
            self._changed.notify_all()

    def _can_step(self) -> bool:
        room = self._busy < self._threads
        return bool(self._error) or (room and self._has_work())

    def _has_work(self) -> bool:
        held = any(stream.held for _, stream in self._streams)
        return held or any(self._waiting.values())

    def _step_until(self, chunk: _Chunk) -> None:
        """Step streams until all runs of a chunk have ended, or only others step them."""
        while chunk.left and not self._error:
            with self._changed:
                if not self._has_work():
                    return
                arch, stream = self._take_stream()
            if stream is None:
                options = chunk.plan.study.method.model_dump()
                options["method"] = options.pop("name")
                stream = Stream(chunk.plan.arch(arch), **options)
            while self._fill(arch, stream) and chunk.left and not self._error:
                self._keep(*stream.go_on())
            with self._changed:
                self._streams.append((arch, stream))

    def _take_stream(self) -> tuple[int, Stream | None]:
        """Take a stream that nobody steps, of an arch whose runs wait if none has begun."""
        asked = next((arch for arch, runs in self._waiting.items() if runs), -1)

        def use(each: tuple[int, Stream]) -> tuple[bool, bool]:
            return each[1].held > 0, each[0] == asked

        best = max(self._streams, key=use, default=None)
        if best is None or not any(use(best)):
            del self._streams[self._threads :]
            return asked, None
        self._streams.remove(best)
        return best

    def _fill(self, arch: int, stream: Stream) -> int:
        """Let a stream take waiting runs of its arch; return how many it holds then."""
        with self._changed:
            waiting = self._waiting[arch]
            ahead = len(waiting) // (2 * stream.lanes * self._threads)
            room = min(stream.lanes + ahead, PLACES) - stream.held
            taken = [waiting.popleft() for _ in range(min(room, len(waiting)))]
        for chunk, row in taken:
            moved = chunk.plan.ground(arch, chunk.records[row], chunk.factors[row])
            stream.add((chunk, row), *moved)
        return stream.held

    def _keep(self, ended: list[tuple[_Chunk, int]], *results) -> None:
        """Give the rows of runs that have ended to their chunks."""
        keys = np.array([chunk.keys[row] for chunk, row in ended], ROW["key"])
        table = store.table_of(keys, *results)
        with self._changed:
            for (chunk, row), made in zip(ended, table):
                chunk.rows[row] = made
                chunk.left -= 1
            if not all(chunk.left for chunk, _ in ended):
                self._changed.notify_all()


def describe_code() -> str:
    """Name the code of this process: version, commit, identity, and what it is compiled with."""
    found = versions()
    return (
        f"archfrag {found['archfrag']} (commit {commit()[:12]}, identity "
        f"{store.code_identity()[:12]}, numba {found.get('numba')}, numpy {found.get('numpy')})"
    )


class Threads:
    """Workers that are threads of this process.

    Kernels run in parallel on them, since they do not hold the GIL. There are more threads than
    cores: most wait for runs of theirs that others step.
    """

    def __init__(self, plan: Plan, count: int) -> None:
        self.count = count
        self.room = (LANES[-1] + 1) * count
        self._plan = plan
        self._runs = _Pool(count)
        self._made = SimpleQueue[Made | Future]()
        self._pool = ThreadPoolExecutor(self.room)
        self._graphs = ThreadPoolExecutor(self.room)  # each thread waits for a graph

    def send(self, chunks: dict[Any, Cases]) -> None:
        """Start some chunks of runs, given by key."""
        import dask.threaded

        make = partial(make_runs, pool=self._runs)
        graph: dict[Any, Any] = {"plan": self._plan}
        graph |= {key: (make, "plan", chunk) for key, chunk in chunks.items()}

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
        for name in NEEDED_LATER:  # kernels leave the GIL to it
            importlib.import_module(name)

    def made(self) -> list[Made]:
        """Wait for the next chunk; return its key and its rows, in a list."""
        while True:  # a signal may come just before a wait, and is heard after it
            with contextlib.suppress(Empty):
                found = self._made.get(timeout=HEARD_WITHIN)
                return [found.result() if isinstance(found, Future) else found]

    def close(self) -> None:
        """Start no more chunks, and leave those that were begun once a run ends."""
        self._runs.end(CancelledError())
        for pool in (self._pool, self._graphs):
            pool.shutdown(wait=False, cancel_futures=True)


class Cluster:
    """The workers of a dask client; they need no files of this machine."""

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

    @property
    def room(self) -> int:
        """Number of chunks that keep all workers busy: one waits."""
        return self.count + 1

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
