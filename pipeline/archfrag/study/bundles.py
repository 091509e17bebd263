"""Chunks of a round, dealt out to workers in bundles that take a second or two each."""

from collections import deque
from collections.abc import Iterable, Sequence

# An exchange with a worker costs its scheduler about 10 ms, as much as a chunk of short runs; a
# bundle is what a lost worker loses, and what the others wait for at the end.
LONGEST, SHORTEST = 2.0, 0.2  # [s]
DEALT_AT_ONCE = 1 / 2  # of a worker's fair part of what is left
MOST_CHUNKS = 200


class Rates:
    """Wall time a simulated second by kind of run, as far as chunks have shown it."""

    def __init__(self) -> None:
        self._wall: dict[object, float] = {}  # [s]
        self._simulated: dict[object, float] = {}  # [s]

    def learn(self, kind: object, wall: float, simulated: float) -> None:
        """Take note of what a chunk took."""
        self._wall[kind] = self._wall.get(kind, 0.0) + wall
        self._simulated[kind] = self._simulated.get(kind, 0.0) + simulated

    def of(self, kind: object) -> float:
        """Wall time a simulated second; infinite if no chunk of this kind is done yet."""
        if kind not in self._wall:
            return float("inf")
        return self._wall[kind] / max(self._simulated[kind], 1e-9)


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
            self._rates.learn(self._kind[chunk], wall, self._length[chunk])

    def take(self) -> tuple[int, ...]:
        """The next bundle; empty if all chunks are dealt out."""
        bundle: list[int] = []
        spent, allowed = 0.0, 0.0
        while self._waiting and len(bundle) < MOST_CHUNKS:
            chunk = self._waiting[0]
            rate = self._rates.of(self._kind[chunk])
            if not bundle:
                fair = DEALT_AT_ONCE * rate * self._left / self._workers
                allowed = min(max(fair, SHORTEST), LONGEST)
            spent += rate * self._length[chunk]
            if bundle and spent > allowed:
                break
            bundle.append(self._waiting.popleft())
            self._left -= self._length[chunk]
        return tuple(bundle)
