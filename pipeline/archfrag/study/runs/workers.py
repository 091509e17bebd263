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
from itertools import count, islice, repeat
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any

import numpy as np

from archfrag.errors import WorkerError
from archfrag.files import counted
from archfrag.physics.steps.run import PLACES
from archfrag.simulation.simulate import Stream
from archfrag.study.designs import CASE, Cases
from archfrag.study.provenance import available_cores, commit, versions
from archfrag.study.runs import store
from archfrag.study.runs.store import Plan, Table

if TYPE_CHECKING:
    from distributed import Client

ANSWER_WITHIN = 10.0  # longest wait for a scheduler [s]
HEARD_WITHIN = 0.5  # longest time until Ctrl-C is noticed [s]
# What the steps after the runs import; xarray asks for dask's arrays.
# This thread alone does so: two that import the same at once may fail.
NEEDED_LATER = ("archfrag.study.answer.fits", "dask.array")
_GO_ON = "finished parts are kept, the same command goes on"
Made = tuple[Cases, Table]  # runs and their rows
# A chunk is one task of a cluster, whose lanes it fills alone: chunks of 4 cost half as much again
# as those of 64. If there are many chunks, workers wait less for the last one.
SMALLEST_CHUNK = 8
LARGEST_CHUNK = 64
CHUNKS_EACH = 8
# Most runs of an adaptive design in a chunk; a free worker gets its share of those that wait.
LARGEST_SHARE = 16
_identity = cache(store.code_identity)
_ONE_AT_A_TIME = threading.Lock()  # Python's parser needs it, up to 3.11 at least


def make_runs(plan: Plan, cases: Cases) -> Table:
    """Make some runs and return their rows.

    WorkerError if this process has other code than the one that made the plan.
    """
    with _ONE_AT_A_TIME:
        same = _identity() == plan.identity
    if not same:
        raise WorkerError(f"a worker on {socket.gethostname()} runs {describe_code()}")
    made = list[Table]()
    runs = _Runs(plan, 1, lambda cases, rows: made.append(rows))
    runs.add(cases)
    runs.end()
    runs.make()
    table = store.joined(made)
    return table[store.places(table, plan.keys(cases))]


class _Runs:
    """Runs that wait, of which threads fill their lanes until all have ended.

    Each of `threads` calls `make`; `keep` gets the runs that have ended and their rows.
    """

    def __init__(
        self, plan: Plan, threads: int, keep: Callable[[Cases, Table], object]
    ) -> None:
        self._plan = plan
        self._threads = threads
        self._keep = keep
        self._changed = threading.Condition()
        self._waiting = defaultdict[int, deque[tuple[Any, float]]](deque)  # by arch
        self._ends = False
        self._stops = False

    def add(self, cases: Cases) -> None:
        """Add runs."""
        pairs = zip(cases, self._plan.factors(cases).tolist())
        with self._changed:
            for case, factor in pairs:
                self._waiting[int(case["arch"])].append((case, factor))
            self._changed.notify_all()

    def end(self, stop: bool = False) -> None:
        """Let threads return when no run is left; if `stop`, as soon as they can."""
        with self._changed:
            self._ends = True
            self._stops = stop
            self._changed.notify_all()

    def make(self) -> None:
        """Make runs until `end` is called and none is left for this thread."""
        options = self._plan.study.method.model_dump()
        options["method"] = options.pop("name")
        made = -1
        while (arch := self._next_arch(made)) is not None:
            if arch != made:
                stream = Stream(self._plan.arch(arch), **options)
                made = arch
            while self._fill(arch, stream) and not self._stops:
                ended, results, wall_time, starts = stream.go_on()
                if ended:
                    cases = np.array(ended, CASE)
                    keys = self._plan.keys(cases)
                    rows = store.table_of(keys, results, wall_time, starts)
                    self._keep(cases, rows)

    def _next_arch(self, made: int) -> int | None:
        """Wait for runs; return an arch that has some, `made` if it has."""
        with self._changed:
            self._changed.wait_for(lambda: self._ends or any(self._waiting.values()))
            asked = [arch for arch, runs in self._waiting.items() if runs]
            if not asked or self._stops:
                return None
            return made if made in asked else asked[0]

    def _fill(self, arch: int, stream: Stream) -> int:
        """Let a stream take waiting runs of its arch; return how many it holds then."""
        with self._changed:
            waiting = self._waiting[arch]
            ahead = len(waiting) // (2 * stream.lanes * self._threads)
            room = min(stream.lanes + ahead, PLACES) - stream.held
            taken = [waiting.popleft() for _ in range(min(room, len(waiting)))]
        for case, factor in taken:
            ground = self._plan.ground(arch, int(case["record"]), factor)
            stream.add(case, *ground)
        return stream.held


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

    def __init__(self, plan: Plan, count: int) -> None:
        self.count = count
        self._made = SimpleQueue[Made | Future]()
        self._runs = _Runs(plan, count, lambda *made: self._made.put(made))
        self._pool = ThreadPoolExecutor(count)
        self._graph = ThreadPoolExecutor(1)  # its thread waits for all others
        self._begun = False

    def send(self, cases: Cases) -> None:
        """Let threads make some runs."""
        self._runs.add(cases)
        if self._begun:
            return
        self._begun = True
        import dask.threaded

        def end(whole: Future) -> None:
            if not whole.cancelled() and whole.exception():
                self._made.put(whole)

        graph = {f"runs-{number}": (self._runs.make,) for number in range(self.count)}
        self._graph.submit(
            dask.threaded.get, graph, list(graph), pool=self._pool
        ).add_done_callback(end)
        for name in NEEDED_LATER:  # kernels leave the GIL to it
            importlib.import_module(name)

    def made(self) -> list[Made]:
        """Wait for the next runs; return some of them and their rows."""
        found = list[Made | Future]()
        while not found:  # a signal may come just before a wait, and is heard after it
            with contextlib.suppress(Empty):
                found.append(self._made.get(timeout=HEARD_WITHIN))
                while True:
                    found.append(self._made.get_nowait())
        return [each.result() if isinstance(each, Future) else each for each in found]

    def close(self) -> None:
        """Begin no more runs; threads end once a run of theirs does."""
        self._runs.end(stop=True)
        for pool in (self._pool, self._graph):
            pool.shutdown(wait=False, cancel_futures=True)


class Cluster:
    """The workers of a dask client; they need no files of this machine."""

    def __init__(self, plan: Plan, client: "Client", name: str) -> None:
        import dask
        from distributed import as_completed

        self._client = client
        self._name = name
        self._study = plan.study
        self._waiting = np.empty(0, CASE)
        self._chunks: dict[Any, Cases] = {}  # that workers have, by key
        # Unique, since a scheduler may hold keys of others.
        self._keys = zip(repeat(f"runs-{uuid.uuid4().hex}"), count())
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

    def send(self, cases: Cases) -> None:
        """Let workers make some runs."""
        self._waiting = np.concatenate([self._waiting, cases])

    def _start(self) -> None:
        """Send waiting runs to workers in chunks.

        All are sent; of an adaptive design only as many chunks as workers can take now, and one
        that waits.
        """
        waiting = len(self._waiting)
        count = self.count
        if self._study.design.adaptive:
            room = max(count + 1 - len(self._chunks), 0)
            size = min(-(-waiting // max(room, 1)), LARGEST_SHARE)
        else:
            room = waiting
            share = -(-waiting // max(count, 1))
            size = min(max(share // CHUNKS_EACH, SMALLEST_CHUNK), share, LARGEST_CHUNK)
        cut = chunks(self._waiting, self._study.execution.chunk or size)
        new = dict(zip(self._keys, islice(cut, room)))
        if not new:
            return
        self._chunks |= new
        self._waiting = np.concatenate([np.empty(0, CASE), *cut])
        graph = {key: (operator.call, self._plan, chunk) for key, chunk in new.items()}
        with self._worded():
            self._futures.update(self._client.get(graph, list(graph), sync=False))

    def made(self) -> list[Made]:
        """Wait for the next runs; return some of them and their rows."""
        if len(self._waiting):
            self._start()
        with self._worded():
            found = [(future.key, rows) for future, rows in self._futures.next_batch()]
            if not all(isinstance(rows, np.ndarray) for _, rows in found):
                raise CancelledError
        return [(self._chunks.pop(key), rows) for key, rows in found]

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


def chunks(cases: Cases, size: int) -> Iterator[Cases]:
    """Yield the runs in chunks of at most `size`, each of one arch."""
    cases = cases[np.argsort(cases["arch"], kind="stable")]
    for own in np.split(cases, np.flatnonzero(np.diff(cases["arch"])) + 1):
        yield from (own[start : start + size] for start in range(0, len(own), size))


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
