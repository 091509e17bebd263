"""A slender block on ground that moves as a sine: limits of its symmetric orbits, and a map.

Rotations x are in units of the slenderness alpha, positive to the right, and time is in units of
1/p with p² = 3 g / (4 R). The ground accelerates by A alpha g sin(W t + f). An orbit of order 1/n,
n odd, has an impact every L = n pi / W, and each half of it is the mirror image of the one before.
docs/validation/harmonic.md derives the formulas; ``python -m archbench.harmonic FILE`` writes the
map of that page.
"""

import cmath
import json
import math
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np

import archfrag as af
from archbench.scene import STANDARD_GRAVITY
from archfrag.errors import UnitWarning
from archfrag.study.provenance import commit

PACE = 5.0  # p [1/s]; samples of a period of the ground
SAMPLES = 60
# The map: slenderness [rad], W and A; it starts from rest where the ground accelerates most.
ALPHA = 0.15
START = 0.5 * math.pi
FREQUENCIES = np.linspace(2.25, 12.0, 40)
AMPLITUDES = np.linspace(0.8, 10.6, 50)
PERIODS = 800  # of the ground: of a run, and at its end of what is judged
LAST = 12
REST = 1e-3  # largest x at rest; largest change from half to half over x
UNLIKE = 0.02
CLASSES = ("at rest", "1/1", "1/3", "other bounded motion", "overturned")


def boundaries(
    frequency: float, order: int, ratio: float
) -> list[tuple[float, float, Any]]:
    """Orbits of the least and the largest A that are stable; impacts leave `ratio` of a velocity.

    Of each A, and halfway between two impacts the phase of the ground [rad], and x and x'.
    """
    half = 0.5 * order * math.pi / frequency
    square = frequency**2
    loss = 1.0 - ratio
    found = []
    slope = math.tanh(half)
    k = 2.0 * math.sinh(half) ** 2
    pull = (1.0 + ratio) / loss / slope
    both = 4.0 * ratio * k + loss**2 * ((1.0 + square) * k - 2.0)
    for sine in (-slope * pull / (square + pull**2), -loss * (1.0 + ratio) * k / both):
        middle = complex(-(slope + pull * sine) / frequency, sine) * 1j**order
        x = 1.0 + middle.imag - 1.0 / math.cosh(half)
        speed = frequency * middle.real + sine / math.sinh(half)
        amplitude = (1.0 + square) * abs(middle)
        found.append((amplitude, cmath.phase(middle), np.array([x, speed])))
    return found


def run(
    alpha: float,
    amplitude: float,
    frequency: float,
    periods: float,
    phase: float,
    state: Any = None,
    rtol: float = 1e-6,
) -> np.ndarray:
    """x and x' from archfrag at each sample of the ground's motion, (2, n); none if it overturned.

    It starts at the `state` (x, x') where the ground has the `phase`, or from rest.
    """
    half_diagonal = 0.75 * STANDARD_GRAVITY / PACE**2
    wide = half_diagonal * math.sin(alpha)
    high = half_diagonal * math.cos(alpha)
    turn = np.arange(round(periods * SAMPLES) + 1) / SAMPLES
    push = alpha * amplitude * STANDARD_GRAVITY * np.sin(2.0 * math.pi * turn + phase)
    motion = af.Motion(push, 2.0 * math.pi / (frequency * PACE * SAMPLES))
    initial = None
    if state is not None:  # about the right corner
        angle = alpha * state[0]
        rate = alpha * PACE * state[1]
        x = half_diagonal * math.sin(angle - alpha)
        y = half_diagonal * math.cos(angle - alpha)
        initial = [[x + wide, y - high, -angle]], [[rate * y, -rate * x, -rate]]
    found = af.simulate(
        af.Block(2.0 * wide, 2.0 * high, math.inf),
        motion,
        method="event_driven",
        rtol=rtol,
        history=True,
        initial=initial,
        follow=0.0,
    )
    history: Any = found.history
    time = motion.dt * np.arange(0 if found.collapsed else turn.size)
    rates = history.rotation[:, 0], history.angular_velocity[:, 0] / PACE
    return np.array([np.interp(time, history.time, each) / -alpha for each in rates])


def response(amplitude: float, frequency: float) -> int:
    """Class of a run of the map, an index of `CLASSES`."""
    x = run(ALPHA, amplitude, frequency, PERIODS, START)[0, -LAST * SAMPLES :]
    if not x.size:
        return 4
    size = np.abs(x).max()
    halves = (SAMPLES // 2, 3 * SAMPLES // 2)
    alike = [np.abs(x[half:] + x[:-half]).max() < UNLIKE * size for half in halves]
    return [bool(size < REST), *alike, True].index(True)


if __name__ == "__main__":
    warnings.simplefilter("ignore", UnitWarning)
    rows = ["".join(str(response(a, w)) for w in FREQUENCIES) for a in AMPLITUDES]
    kept = {"commit": commit(), "rows": rows}
    Path(sys.argv[1]).write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
