"""Histories of rocking blocks and a frame, beside another integration and closed forms."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq, root

import archfrag as af
from archbench import harmonic
from archbench.exact import Rocking
from tests.validation.scenes import first_collapse, g, rocking
from tests.validation.test_block import FINE, one_sine

TOPIC = "Rocking histories"
ROOT = Path(__file__).parents[2]
RECORD = ROOT / "records" / "near_source" / "synthetic" / "e1-r1.mseed"


def both(twin, motion):
    """Run of a block without sliding, and the largest rotation by another integration."""
    sides = (
        1.5
        * g
        / twin.frequency**2
        * np.array([math.sin(twin.alpha), math.cos(twin.alpha)])
    )
    run = af.simulate(af.Block(*sides, friction=math.inf), motion, **FINE)
    return run, np.abs(rocking(motion, twin, twin.ratio)).max()


def test_random_pulses(validated):
    """500 sines of one period, from hardly any rocking to what overturns without an impact."""
    generator = np.random.default_rng(33)
    verdicts = []
    away = []
    for alpha, p, ratio, level in generator.uniform(
        [0.05, 1, 1, 0], [0.3, 5, 8, 1], (500, 4)
    ):
        amplitude = math.tan(alpha) * (1.02 + level * (0.5 + 0.2 * ratio**2))
        run, peak = both(Rocking(alpha, p), one_sine(ratio * p, amplitude, 500))
        verdicts.append([run.collapsed is True, peak > 0.5 * math.pi])
        away.append(0.0 if run.collapsed else abs(run.peak_rotation - peak) / alpha)
    ours, theirs = np.transpose(verdicts)
    assert 150 < ours.sum() < 350
    case = "500 one-sine pulses, α 0.05 to 0.3"
    far = np.sum(np.array(away) > 1e-4)
    validated(
        case, "verdicts that differ", np.sum(ours != theirs), 0, "rocking equation"
    )
    name = "peak rotations that differ by more than α / 10,000"
    validated(case, name, far, 0, "rocking equation")


@pytest.mark.parametrize("ratio", [1.5, 2, 3, 4, 5, 6, 7, 8])
def test_overturning_spectrum(validated, ratio):
    """Without an impact by u' = u + A sin(W t) of u = x - 1 + x', and after one."""

    def short(a):  # of u = 0 at the end of the sine, from u = -1 where A sin(W t) = 1
        rest = a * ratio * math.exp((math.asin(1.0 / a) - 2.0 * math.pi) / ratio)
        return ratio * math.sqrt(a**2 - 1.0) - rest - ratio**2

    def falls(a, hits=None):
        run, peak = both(Rocking(0.02, 2.0), one_sine(2.0 * ratio, 0.02 * a, 500))
        return (
            peak > 1.0
            if hits is None
            else run.collapsed and run.events["impacts"] == hits
        )

    direct = brentq(short, 1.0 + 1e-12, 100.0)
    later = first_collapse(falls, 1.02, direct, 0.05)
    source = "closed form; Zhang and Makris 2001" if ratio == 5 else "closed form"
    for hits, expected, where in ((0, direct, source), (1, later, "rocking equation")):
        limits = np.array([0.98, 1.02, 0.01]) * expected
        found = first_collapse(lambda a, hits=hits: falls(a, hits), *limits)
        case = f"one sine, ω/p {ratio:g}, {('no', 'one')[hits]} impact, small angle"
        validated(case, "least amplitude over α g", found, expected, where, rel=3e-3)


@pytest.mark.parametrize("period", [2, 2.5, 3, 4, 5, 6, 7, 8])
def test_rocking_spectrum(validated, period):
    run, peak = both(Rocking(0.2, 2.0 * math.pi / period), af.read_motion(RECORD))
    case = f"record e1-r1, 2π/p {period:g} s, α 0.2"
    peaks = (run.peak_rotation / 0.2, peak / 0.2)
    validated(case, "peak rotation over α", *peaks, "rocking equation", rel=1e-3)


@pytest.mark.parametrize("height", [0.3, 2.0])
def test_frame(validated, height):
    """Two columns that carry a beam: docs/validation/harmonic.md derives p and the ratio."""
    alpha = 0.2
    half_diagonal = 2.0
    b = half_diagonal * math.sin(alpha)
    h = half_diagonal * math.cos(alpha)
    columns = [
        [[x - b, 0], [x + b, 0], [x + b, 2 * h], [x - b, 2 * h]] for x in (0.0, 3.0)
    ]
    beam = [[-b, 2 * h], [3 + b, 2 * h], [3 + b, 2 * h + height], [-b, 2 * h + height]]
    frame = af.Arch.from_polygons(
        [*columns, beam], math.inf, ground=[c[:2] for c in columns]
    )
    gamma = height * (3 + 2 * b) / (8 * b * h)
    square = 0.75 * g / half_diagonal * (1 + 2 * gamma) / (1 + 3 * gamma)
    ratio = 1 - 1.5 * math.sin(alpha) ** 2 + 3 * gamma * math.cos(2 * alpha)
    sine = one_sine(4.0 * math.pi, 0.55)
    theirs = rocking(sine, Rocking(alpha, math.sqrt(square)), ratio / (1 + 3 * gamma))
    run = af.simulate(frame, sine, history=True, **FINE)
    assert run.events["impacts"] >= 4 * 50  # of four joints
    time, (left, _, right) = (
        sine.dt * np.arange(theirs.size),
        run.history.rotation.values.T,
    )
    for ours in (left, right):
        ours = np.interp(time, run.history.time, -ours)
        np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=1e-4 * alpha)
    case = f"frame of two columns, γ {gamma:.3g}"
    peaks = np.abs([left.min(), theirs.max()])
    validated(
        case, "rotation over α", *peaks / alpha, "rocking equation of a frame", rel=1e-3
    )


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("frequency", np.arange(0.5, 5.1, 0.5))
@pytest.mark.parametrize("order", [1, 3])
def test_boundaries_of_orbits(validated, order, frequency, side):
    """Mirrored halves of runs have a fixed point of multiplier 1 or -1, and determinant r²."""
    ratio = Rocking(0.05, harmonic.PACE).ratio
    frequency = frequency + order - 1.0
    expected, phase, start = harmonic.boundaries(frequency, order, ratio)[side]

    def away(unknown):
        given = 0.05, unknown[2] * expected, frequency, 0.5 * order, phase
        states = unknown[:2] + 1e-5 * np.eye(3, 2, -1)
        after, *near = (
            -harmonic.run(*given, state, rtol=1e-8)[:, -1] for state in states
        )
        jacobian = 1e5 * (np.array(near) - after)
        assert np.linalg.det(jacobian) == pytest.approx(ratio**2, rel=4e-4)
        return [
            *(after - states[0]),
            np.linalg.det(jacobian - (1 - 2 * side) * np.eye(2)),
        ]

    found = root(away, [*start, 1.0], options={"eps": 1e-4, "xtol": 1e-6})
    assert found.success
    case = f"order 1/{order}, ω/p {frequency:g}, α 0.05"
    name = ("least", "largest")[side]
    validated(
        case,
        f"{name} A of the stable orbit",
        found.x[2] * expected,
        expected,
        "closed form for slender blocks",
        rel=0.02,
    )


@pytest.mark.filterwarnings("ignore::archfrag.errors.UnitWarning")
def test_map():
    """Twenty of its runs made again; chaotic ones may end otherwise on another machine."""
    kept = (ROOT / "docs" / "validation" / "harmonic.json").read_text("utf-8")
    known, (w, a) = (
        json.loads(kept)["rows"],
        (harmonic.FREQUENCIES, harmonic.AMPLITUDES),
    )
    drawn = np.random.default_rng(33).integers(0, [50, 40], (20, 2))
    assert (
        sum(harmonic.response(a[i], w[j]) == int(known[i][j]) for i, j in drawn) >= 18
    )
    ratio = Rocking(harmonic.ALPHA, harmonic.PACE).ratio
    for i, j in np.ndindex(50, 40):
        if known[i][j] in "12":
            low, high = harmonic.boundaries(w[j], 2 * int(known[i][j]) - 1, ratio)
            assert low[0] < a[i] < 1.06 * high[0]
