"""Chunks of a round, dealt out to workers in bundles that take a second or two each."""

import math
from collections import deque
from collections.abc import Iterable, Sequence

# An exchange with a worker costs its scheduler about 10 ms, as much as a chunk of short runs; a
# bundle is what a lost worker loses, and what the others wait for at the end.
LONGEST, SHORTEST = 2.0, 0.2  # [s]
DEALT_AT_ONCE = 1 / 2  # of a worker's fair part of what is left
MOST_CHUNKS = 200


Rates = dict[object, tuple[float, float]]  # by kind of run: wall and simulated time so far [s]


class Bundles:
    """Deals out chunks, the longest first.

    A bundle is as long as the chunks before it suggest, and shorter towards the end. Of a kind of
    which nothing is known yet a bundle is one chunk.
    """

    def __init__(
        self, lengths: Sequence[float], kinds: Sequence[object], workers: int, rates: Rates
    ) -> None:
        self._length, self._kind, self._rates = lengths, kinds, rates
        self._waiting = deque(sorted(range(len(lengths)), key=lambda chunk: -lengths[chunk]))
        self._left = sum(lengths)
        self._workers = max(1, workers)

    def learn(self, walls: Iterable[tuple[int, float]]) -> None:
        """Take note of how long chunks took: number and wall time [s]."""
        for chunk, wall in walls:
            kind = self._kind[chunk]
            before, simulated = self._rates.get(kind, (0.0, 0.0))
            self._rates[kind] = before + wall, simulated + self._length[chunk]

    def _rate(self, chunk: int) -> float:
        """Wall time a simulated second; infinite if no chunk of this kind is done yet."""
        wall, simulated = self._rates.get(self._kind[chunk], (math.inf, 1.0))
        return wall / max(simulated, 1e-9)

    def take(self) -> tuple[int, ...]:
        """The next bundle; empty if all chunks are dealt out."""
        bundle: list[int] = []
        spent, allowed = 0.0, 0.0
        while self._waiting and len(bundle) < MOST_CHUNKS:
            chunk = self._waiting[0]
            rate = self._rate(chunk)
            if not bundle:
                fair = DEALT_AT_ONCE * rate * self._left / self._workers
                allowed = min(max(fair, SHORTEST), LONGEST)
            spent += rate * self._length[chunk]
            if bundle and spent > allowed:
                break
            bundle.append(self._waiting.popleft())
            self._left -= self._length[chunk]
        return tuple(bundle)
