"""A block on ground that moves as a sine: where its symmetric orbits begin and end, and a map."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import root

from archbench import harmonic
from archbench.exact import Rocking

TOPIC = "Block on harmonic ground"
KEPT = Path(__file__).parents[2] / "docs" / "validation" / "harmonic.json"
SLENDER = Rocking(0.05, harmonic.PACE)
FREQUENCIES = {1: (1, 1.4, 1.8, 2.2, 2.6, 3, 3.5, 4, 4.5, 5), 3: np.arange(2.5, 7.1, 0.5).tolist()}


def half(amplitude, frequency, order, phase, state):
    """Mirror image of a block's state half an orbit later, from archfrag."""
    given = frequency, 0.5 * order, phase, state
    return -np.array([each[-1] for each in harmonic.run(SLENDER.alpha, amplitude, *given, 1e-8)])


def boundary(frequency, order, upper):
    """Amplitude over the formula's where archfrag's half map has a fixed point and multiplier 1.

    Or -1 at the upper boundary. Derivatives are differences of runs; the determinant is r².
    """
    guess = harmonic.boundaries(frequency, order, SLENDER.ratio)[upper]
    phase, *state = harmonic.orbit(guess, frequency, order, SLENDER.ratio)
    middle = phase + 0.5 * math.pi * order
    multiplier = np.diag([-1.0, -1.0] if upper else [1.0, 1.0])

    def away(unknown):
        given = guess * unknown[2], frequency, order, middle
        after = half(*given, unknown[:2])
        near = [half(*given, unknown[:2] + step) for step in 1e-5 * np.eye(2)]
        jacobian = 1e5 * (np.array(near) - after)
        assert np.linalg.det(jacobian) == pytest.approx(SLENDER.ratio**2, rel=4e-4)
        return [*(after - unknown[:2]), np.linalg.det(jacobian - multiplier)]

    found = root(away, [*state, 1.0], options={"eps": 1e-4, "xtol": 1e-6})
    assert found.success
    return found.x[2]


@pytest.mark.parametrize("order", [1, 3])
def test_boundaries(validated, order):
    for frequency in FREQUENCIES[order]:
        formula = harmonic.boundaries(frequency, order, SLENDER.ratio)
        for upper, name in enumerate(("least", "largest")):
            validated(
                f"order 1/{order}, W {frequency:g}, α 0.05", f"{name} A of the stable orbit",
                boundary(frequency, order, upper) * formula[upper], formula[upper],
                "closed form for slender blocks", rel=0.02,
            )  # fmt: skip


@pytest.mark.parametrize(("order", "frequency"), [(1, 2.0), (1, 4.0), (3, 4.0), (3, 6.0)])
def test_orbits_are_held_between_the_boundaries(order, frequency):
    ratio = Rocking(harmonic.ALPHA, harmonic.PACE).ratio
    low, high = harmonic.boundaries(frequency, order, ratio)
    for amplitude, holds in ((0.96 * low, 0), (1.06 * low, 1), (0.9 * high, 1), (1.2 * high, 0)):
        start = max(amplitude, 1.1 * low)
        phase, *state = harmonic.orbit(start, frequency, order, ratio)
        middle = phase + 0.5 * math.pi * order
        x, _ = harmonic.run(harmonic.ALPHA, amplitude, frequency, 200, middle, state)
        last = x[-12 * harmonic.SAMPLES :]
        alike = x.size > 0 and harmonic.unlike(last, order) < harmonic.UNLIKE
        assert (alike and np.abs(last).max() > 0.5 * state[0]) == holds


class TestMap:
    ROWS = json.loads(KEPT.read_text("utf-8"))["rows"]

    def test_orbits_of_the_map_lie_below_their_upper_boundaries(self):
        ratio = Rocking(harmonic.ALPHA, harmonic.PACE).ratio
        for row, amplitude in zip(self.ROWS, harmonic.AMPLITUDES):
            for own, frequency in zip(row, harmonic.FREQUENCIES):
                if own in "12":
                    order = 2 * int(own) - 1
                    low, high = harmonic.boundaries(frequency, order, ratio)
                    assert low < amplitude < 1.1 * high

    @pytest.mark.slow
    @pytest.mark.filterwarnings("ignore::archfrag.errors.UnitWarning")
    def test_runs_of_the_map_made_again(self):
        """Twenty; chaotic transients may end otherwise on another machine."""
        generator, same = np.random.default_rng(33), 0
        for i, j in zip(generator.integers(0, 50, 20), generator.integers(0, 40, 20)):
            again = harmonic.response(harmonic.AMPLITUDES[i], harmonic.FREQUENCIES[j])
            same += again == int(self.ROWS[i][j])
        assert same >= 18
