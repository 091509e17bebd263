"""A slender block on ground that moves as a sine: its symmetric orbits in closed form, and runs.

Rotations are in units of the slenderness alpha, time in units of 1/p with p² = 3 g / (4 R), and
the ground accelerates by A alpha g sin(W t + f). Between impacts a block that leans to the right,
x > 0, obeys x'' = x - 1 - A sin(W t + f). An impact multiplies x' by r, `Rocking.ratio`.

An orbit of order 1/n with n odd has impacts every L = n pi / W, and each half of it is the mirror
image of the half before. Let T = tanh(L/2), B = A / (1 + W²) and S = B sin f. From x(0) = x(L) = 0

    x(t) = 1 + B sin(W t + f) - cosh(t - L/2) / cosh(L/2) + S sinh(t - L/2) / sinh(L/2).

The impact at L, r x'(L) = -x'(0), demands with q = (1 + r) / (1 - r) that

    W B cos f + q S / T = -T;   the velocity after an impact then is   v = -2 r S / ((1 - r) T).

There is a phase f if B >= T / sqrt(W² + (q / T)²): the lower boundary. The orbit of the two phases
with the larger v can be stable. The map from one impact to the next, mirrored, has the determinant
r² and the trace

    -2 r cosh L + (r sinh L / v) (1 + r + (1 - r) A sin f).

Its eigenvalue is 1 at the lower boundary. Where it is -1, at the trace -(1 + r²), the halves cease
to be alike: S = -(1 - r²) k / (4 r k + (1 - r)² ((1 + W²) k - 2)) with k = cosh L - 1, and A
follows from the condition. This is the upper boundary, unless the orbit touches the ground between
impacts at a smaller A.

``python -m archbench.harmonic FILE`` writes the map of the validation page.
"""

import json
import math
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

import archfrag as af
from archbench.scene import STANDARD_GRAVITY
from archfrag.errors import UnitWarning
from archfrag.study.files import commit

Array = NDArray[np.float64]

PACE = 5.0  # p [1/s]
SAMPLES = 60  # of a period of the ground
# The map: slenderness [rad], W and A; it starts from rest where the ground accelerates most.
ALPHA, START = 0.15, 0.5 * math.pi
FREQUENCIES, AMPLITUDES = np.linspace(2.25, 12.0, 40), np.linspace(0.8, 10.6, 50)
PERIODS, LAST = 200, 12  # of the ground: of a run, and at its end of what is judged
REST, UNLIKE = 1e-3, 0.02  # largest |x| of a block at rest; largest `unlike` of an orbit
CLASSES = ("at rest", "1/1", "1/3", "other bounded motion", "overturned")


def orbit(
    amplitude: float, frequency: float, order: int, ratio: float, part: Any = 0.5
) -> tuple[float, Any, Any]:  # fmt: skip
    """Phase f [rad] of the orbit with the larger v, and x and x' when `part` of L has passed."""
    length, wave = order * math.pi / frequency, amplitude / (1.0 + frequency**2)
    half = math.tanh(0.5 * length)
    pull = (1.0 + ratio) / (1.0 - ratio) / half
    least = half / math.hypot(frequency, pull)
    phase = math.atan2(pull, frequency) - math.acos(-min(least / wave, 1.0))
    turn, middle = phase + frequency * length * part, length * (part - 0.5)
    even, odd = 1.0 / math.cosh(0.5 * length), wave * math.sin(phase) / math.sinh(0.5 * length)
    x = 1.0 + wave * np.sin(turn) - even * np.cosh(middle) + odd * np.sinh(middle)
    speed = wave * frequency * np.cos(turn) - even * np.sinh(middle) + odd * np.cosh(middle)
    return phase, x, speed


def boundaries(frequency: float, order: int, ratio: float) -> tuple[float, float]:
    """Least and largest amplitude A of the stable orbit of order 1/`order`."""
    length, square = order * math.pi / frequency, 1.0 + frequency**2
    half, pull = math.tanh(0.5 * length), (1.0 + ratio) / (1.0 - ratio)
    low = square * half / math.hypot(frequency, pull / half)
    k, loss = math.cosh(length) - 1.0, 1.0 - ratio
    sine = -loss * (1.0 + ratio) * k / (4.0 * ratio * k + loss**2 * (square * k - 2.0))
    high = square * math.hypot(sine, (half + pull * sine / half) / frequency)
    inside = np.linspace(0.0, 1.0, 402)[1:-1]

    def clear(amplitude: float) -> float:
        return orbit(amplitude, frequency, order, ratio, inside)[1].min()

    return low, high if clear(high) > 0.0 else brentq(clear, 2.0 * low, high, rtol=1e-6)


def run(
    alpha: float, amplitude: float, frequency: float, periods: float, phase: float = 0.0,
    state: tuple[float, float] | None = None, rtol: float = 1e-6,
) -> tuple[Array, Array]:  # fmt: skip
    """x and x' from archfrag at every sample of the ground's motion; none if it overturned.

    It starts at the `state` (x, x') where the ground has the `phase`, or from rest.
    """
    half_diagonal = 0.75 * STANDARD_GRAVITY / PACE**2
    across, up = half_diagonal * math.sin(alpha), half_diagonal * math.cos(alpha)
    turn = np.arange(round(periods * SAMPLES) + 1) / SAMPLES
    push = alpha * amplitude * STANDARD_GRAVITY * np.sin(2.0 * math.pi * turn + phase)
    motion = af.Motion(push, 2.0 * math.pi / (frequency * PACE * SAMPLES))
    initial = None
    if state is not None:  # rotation about the right corner
        angle, rate = alpha * state[0], alpha * PACE * state[1]
        x = up * math.sin(angle) - across * math.cos(angle)
        y = up * math.cos(angle) + across * math.sin(angle)
        initial = [[x + across, y - up, -angle]], [[rate * y, -rate * x, -rate]]
    found = af.simulate(
        af.Block(2.0 * across, 2.0 * up, math.inf), motion, method="event_driven", rtol=rtol,
        history=True, initial=initial, follow=0.0,
    )  # fmt: skip
    history: Any = found.history
    time = motion.dt * np.arange(0 if found.collapsed else turn.size)
    x, speed = (
        np.interp(time, history.time, history[name][:, 0]) / -alpha
        for name in ("rotation", "angular_velocity")
    )
    return x, speed / PACE


def unlike(x: Array, order: int) -> float:
    """Largest |x(t) + x(t + L)|, zero of an orbit of this order, over the largest |x|."""
    shift = order * SAMPLES // 2
    return float(np.abs(x[shift:] + x[:-shift]).max() / np.abs(x).max())


def response(amplitude: float, frequency: float) -> int:
    """Class of a run of the map, an index of `CLASSES`."""
    last = run(ALPHA, amplitude, frequency, PERIODS, START)[0][-LAST * SAMPLES :]
    if last.size == 0:
        return 4
    if np.abs(last).max() < REST:
        return 0
    return next((k for k, n in ((1, 1), (2, 3)) if unlike(last, n) < UNLIKE), 3)


if __name__ == "__main__":
    warnings.simplefilter("ignore", UnitWarning)
    kept = {
        "commit": commit(),
        "rows": ["".join(str(response(a, w)) for w in FREQUENCIES) for a in AMPLITUDES],
    }
    Path(sys.argv[1]).write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
