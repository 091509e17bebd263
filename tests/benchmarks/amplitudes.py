"""Least collapsing amplitudes: verdicts over a grid, what stands above, and a bisection."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import archfrag as af
from archfrag.arch import STANDARD_GRAVITY
from archfrag.evidence.run import Verdict, Way, verdict
from archfrag.mechanics.status import Status
from archfrag.simulate import warmup


@dataclass(frozen=True)
class Sweep:
    """What one way says of one scene.

    Attributes
    ----------
    amplitudes : ndarray, (n_amplitude,)
        The grid, increasing.
    verdicts : tuple of bool or None
        Whether it collapsed; a run still moving when it ended has not. None where the solver
        failed.
    least : float
        Least collapsing amplitude, bisected between the grid's first collapse and the point
        before it; nan if nothing on the grid collapses.
    mode : str
        How it collapses there.
    energy_error : float
        Largest of all runs [1].
    unsolved : int
        Runs of any kind that ended in neither collapse nor survival.
    seconds : float
        Wall time of the runs.
    """

    amplitudes: NDArray[np.float64]
    verdicts: tuple[Verdict, ...]
    least: float
    mode: str
    energy_error: float
    moving: int
    failures: tuple[str, ...]
    seconds: float

    @property
    def standing_above(self) -> list[float]:
        """Grid points above the first collapse that stand."""
        if True not in self.verdicts:
            return []
        first = self.verdicts.index(True)
        pairs = zip(self.amplitudes[first:], self.verdicts[first:])
        return [float(a) for a, fell in pairs if fell is False]


def sweep(
    arch: af.Arch, motion: af.Motion, amplitudes: Sequence[float], way: Way, width: float
) -> Sweep:
    """Verdicts at all amplitudes, and the first change bisected down to a relative `width`."""
    warmup(way.method)
    runs: list[af.Response] = []
    failures: list[str] = []

    def run(amplitude: float) -> af.Response:
        response = af.simulate(arch, motion, scale=float(amplitude), **way.options)
        runs.append(response)
        if verdict(response) is None:
            failures.append(f"{amplitude:.6g} {response.status.name}")
        return response

    responses = [run(amplitude) for amplitude in amplitudes]
    verdicts = tuple(verdict(response) for response in responses)
    least, mode = np.nan, "none"
    if True in verdicts:
        first = verdicts.index(True)
        least, mode = float(amplitudes[first]), responses[first].collapse_mode
        stands = float(amplitudes[first - 1]) if first else least
        while least - stands > width * least:
            middle = 0.5 * (least + stands)
            response = run(middle)
            if verdict(response):
                least, mode = middle, response.collapse_mode
            else:
                stands = middle
    return Sweep(
        np.asarray(amplitudes, float),
        verdicts,
        least,
        mode,
        max(response.energy_error for response in runs),
        sum(response.status is Status.UNFINISHED for response in runs),
        tuple(failures),
        sum(response.wall_time for response in runs),
    )


def first_collapse(
    arch: af.Arch, motion: af.Motion, low: float, high: float, way: Way, ratio: float
) -> float:
    """First collapsing amplitude of a geometric grid from `low` up; nan if none up to `high`."""
    warmup(way.method)
    for amplitude in np.geomspace(low, high, 2 + int(np.log(high / low) / np.log(ratio))):
        if verdict(af.simulate(arch, motion, scale=float(amplitude), **way.options)):
            return float(amplitude)
    return np.nan


def around(amplitude: float, part: float, spacing: float) -> list[float]:
    """Grid of relative `spacing` from ``(1 - part)`` to ``(1 + part)`` times an amplitude."""
    count = round(part / spacing)
    return [amplitude * (1.0 + spacing * k) for k in range(-count, count + 1)]


def ranges(values: Sequence[float], spacing: float, digits: int = 4) -> str:
    """Amplitudes in words, neighbours of the grid joined: ``0.41-0.43, 0.5``."""
    groups: list[list[float]] = []
    for value in values:
        if groups and value - groups[-1][-1] < 1.5 * spacing:
            groups[-1].append(value)
        else:
            groups.append([value])
    return ", ".join(
        f"{group[0]:.{digits}g}" + (f"-{group[-1]:.{digits}g}" if len(group) > 1 else "")
        for group in groups
    )


def sampled(shape: Any, duration: float, dt: float) -> af.Motion:
    """Motion whose acceleration [g] at time t [s] is ``shape(t)``, zero from `duration` on."""
    time = np.arange(round(duration / dt) + 3) * dt
    value = np.where(time < duration - 1e-9, np.broadcast_to(shape(time), time.shape), 0.0)
    return af.Motion(value * STANDARD_GRAVITY, dt)


def two_part_pulse(duration: float, dt: float = 1e-4) -> af.Motion:
    """Ground acceleration 1 g for `duration` [s], then -1/2 g for twice as long."""
    return sampled(lambda t: np.where(t < duration - 1e-9, 1.0, -0.5), 3.0 * duration, dt)
