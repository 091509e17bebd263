"""A method run by `archfrag.simulate` as ever, and what the response does not tell of it."""

import time
from functools import cache

import numpy as np

from archfrag.mechanics.types import Options, Outcome
from archfrag.methods.registry import METHODS, resolve


class Watched:
    """A method that remembers what it was given and what it left behind.

    Attributes
    ----------
    name : str
        Under which `archfrag.simulate` finds it.
    position, velocity : ndarray, (n_body, 3)
        At the end of the last run.
    options : Options
    outcome : Outcome
    cpu_time : float
        Of the method alone, nothing of what is around it [s]: on a busy machine what wall time
        is not.
    """

    position: np.ndarray
    velocity: np.ndarray
    options: Options
    outcome: Outcome
    cpu_time: float

    def __init__(self, method: str) -> None:
        info = resolve(method)
        if info is None:
            raise SystemExit(f"there is no method {method!r}")
        self.name, self.run = f"watched {method}", info.load()
        METHODS[self.name] = info._replace(load=lambda: self)

    def __call__(self, chain, ground, position, velocity, from_rest, options, *room, **own):
        """Run it; the signature of every method."""
        self.position, self.velocity, self.options = position, velocity, options
        began = time.process_time()
        self.outcome = self.run(
            chain, ground, position, velocity, from_rest, options, *room, **own
        )
        self.cpu_time = time.process_time() - began
        return self.outcome


@cache
def watched(method: str) -> Watched:
    """The method, put into the registry once for this process."""
    return Watched(method)
