"""Chunks of a batch, dealt out to workers in bundles that take a second or two each."""

from collections import deque
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from archfrag.study.plan import Plan

# An exchange with a worker costs its scheduler about 10 ms, as much as a chunk of short runs; a
# bundle is what a lost worker loses, and what the others wait for at the end.
LONGEST, SHORTEST = 2.0, 0.2  # [s]
DEALT_AT_ONCE = 1 / 2  # of a worker's fair part of what is left
MOST_CHUNKS = 200


def simulated_time(plan: Plan, chunks: Sequence[int]) -> list[float]:
    """Durations of the records of all runs in each chunk, summed [s]."""
    duration = np.array([record.duration for record in plan.records])
    n_level = len(plan.levels)
    return [
        float(duration[np.array(plan.rows(chunk)) // n_level % duration.size].sum())
        for chunk in chunks
    ]


def longest_first(plan: Plan, chunks: Sequence[int]) -> list[int]:
    """Chunks by simulated time, the longest first: then workers finish together."""
    length = dict(zip(chunks, simulated_time(plan, chunks)))
    return sorted(chunks, key=lambda chunk: -length[chunk])


class Bundles:
    """Deals out the chunks of a plan, the longest first.

    A bundle is as long as the chunks before it suggest, and shorter towards the end. Of an arch
    of which nothing is known yet a bundle is one chunk.

    Parameters
    ----------
    plan : Plan
    chunks : sequence of int
    workers : int
    """

    def __init__(self, plan: Plan, chunks: Sequence[int], workers: int) -> None:
        self._length = dict(zip(chunks, simulated_time(plan, chunks)))
        self._arch = {chunk: plan.case(plan.rows(chunk).start)[0] for chunk in chunks}
        self._waiting = deque(longest_first(plan, chunks))
        self._left = sum(self._length.values())
        self._workers = max(1, workers)
        self._wall: dict[int, float] = {}  # by arch [s]
        self._simulated: dict[int, float] = {}  # in that [s]

    def learn(self, done: Iterable[Mapping[str, float]]) -> None:
        """Take note of how long chunks took: their `chunk` and `wall_time` [s]."""
        for result in done:
            chunk = int(result["chunk"])
            arch = self._arch[chunk]
            self._wall[arch] = self._wall.get(arch, 0.0) + result["wall_time"]
            self._simulated[arch] = self._simulated.get(arch, 0.0) + self._length[chunk]

    def take(self) -> tuple[int, ...]:
        """The next bundle; empty if all chunks are dealt out."""
        bundle: list[int] = []
        spent, allowed = 0.0, 0.0
        while self._waiting and len(bundle) < MOST_CHUNKS:
            chunk = self._waiting[0]
            pace = self._pace(self._arch[chunk])
            if not bundle:
                fair = DEALT_AT_ONCE * pace * self._left / self._workers
                allowed = min(max(fair, SHORTEST), LONGEST)
            spent += pace * self._length[chunk]
            if bundle and spent > allowed:
                break
            bundle.append(self._waiting.popleft())
            self._left -= self._length[chunk]
        return tuple(bundle)

    def _pace(self, arch: int) -> float:
        """Wall time a simulated second; infinite if no chunk of the arch is done yet."""
        if arch not in self._wall:
            return float("inf")
        return self._wall[arch] / max(self._simulated[arch], 1e-9)
