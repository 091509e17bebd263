"""Random irregular chains under random motions: a scene follows from its seed alone."""

from typing import NamedTuple

import numpy as np

import archfrag as af
from archfrag.arch import STANDARD_GRAVITY
from archfrag.errors import GeometryError

# Steady acceleration that a chain bears in both directions [g].
LEAST_ONSET, MOST_ONSET = 0.02, 1.5
LEAST_PEAK, MOST_PEAK = 0.3, 2.0  # of the ground acceleration [g]
FREE_END, INFINITE, LOADED, VERTICAL = 0.1, 0.1, 0.3, 0.6  # how often


class Irregular(NamedTuple):
    """A chain that stands, and a motion for it."""

    arch: af.Arch
    motion: af.Motion
    onset: float  # the smaller of both directions [g]
    peak: float  # of the horizontal component [g]


def irregular_scene(seed):
    """Scene of a seed.

    Arches of 2 to 15 voussoirs, one in ten a free-standing column: no two joints alike in
    place, inclination and length. Motions of 2 to 4 s, one to five times what starts the chain.
    """
    rng = np.random.default_rng(seed)
    while True:
        try:
            arch = _chain(rng)
        except GeometryError:
            continue
        start = af.onset(arch)
        onset = min(start.plus, start.minus) if start.stands else 0.0
        if LEAST_ONSET < onset < MOST_ONSET:
            break
    least = max(LEAST_PEAK, onset)
    most = min(MOST_PEAK, max(2.0 * LEAST_PEAK, 5.0 * onset))
    peak = float(np.exp(rng.uniform(np.log(least), np.log(most))))
    return Irregular(arch, _motion(rng, peak), float(onset), peak)


def _chain(rng):
    friction = np.inf if rng.random() < INFINITE else float(rng.uniform(0.2, 0.9))
    voussoirs = int(rng.integers(2, 16))
    size = float(np.exp(rng.uniform(np.log(1.0), np.log(15.0))))
    free = bool(rng.random() < FREE_END)
    inner, outer = _column_joints(rng, voussoirs) if free else _arch_joints(rng, voussoirs)
    load = None
    if rng.random() < LOADED:
        load = rng.uniform(0.0, 2e4, voussoirs) * size**2
    return af.Arch.from_joints(size * inner, size * outer, friction, dead_load=load, free_end=free)


def _arch_joints(rng, voussoirs):
    """Ends of joints about an ellipse of about unit size, each moved, rotated and drawn out."""
    half = rng.uniform(np.radians(50.0), np.radians(90.0))
    spacing = 2.0 * half / voussoirs
    angle = np.linspace(0.5 * np.pi + half, 0.5 * np.pi - half, voussoirs + 1)
    angle[1:-1] += rng.uniform(-0.3, 0.3, voussoirs - 1) * spacing
    lean = angle + rng.uniform(-1.0, 1.0, voussoirs + 1) * min(0.15, 0.4 * spacing)
    thickness = rng.uniform(0.12, 0.35) * rng.uniform(0.85, 1.15, voussoirs + 1)
    reach = rng.uniform(0.97, 1.03, voussoirs + 1)
    rise = rng.uniform(0.6, 1.5)
    middle = np.column_stack([reach * np.cos(angle), rise * reach * np.sin(angle)])
    # The normal of the ellipse at a radial angle, leant over.
    outward = np.column_stack([rise * np.cos(lean), np.sin(lean)])
    outward /= np.linalg.norm(outward, axis=1)[:, None]
    arm = 0.5 * thickness[:, None] * outward
    return middle - arm, middle + arm


def _column_joints(rng, voussoirs):
    """Ends of joints of a column of unit height; the last pair is its free face."""
    height = np.concatenate([[0.0], np.cumsum(rng.uniform(0.5, 1.5, voussoirs))])
    height /= height[-1]
    half = 0.5 * rng.uniform(0.15, 0.4) * rng.uniform(0.9, 1.1, voussoirs + 1)
    tilt = rng.uniform(-0.1, 0.1, voussoirs + 1) / voussoirs
    tilt[0] = 0.0
    arm = np.column_stack([half, tilt])
    middle = np.column_stack([np.zeros(voussoirs + 1), height])
    return middle + arm, middle - arm


def _motion(rng, peak):
    """Random phases and amplitudes below 10 Hz, rising and fading."""
    dt = float(rng.choice([0.001, 0.002]))
    time = np.arange(0.0, rng.uniform(2.0, 4.0), dt)
    across = _waves(rng, time) * peak * STANDARD_GRAVITY
    effective_gravity = None
    if rng.random() < VERTICAL:
        effective_gravity = _waves(rng, time) * rng.uniform(0.0, 0.3) * STANDARD_GRAVITY
    return af.Motion(across, dt, effective_gravity)


def _waves(rng, time):
    """A sum of eight sines under a window, its largest value 1."""
    frequency = np.exp(rng.uniform(np.log(0.4), np.log(10.0), 8))
    phase = rng.uniform(0.0, 2.0 * np.pi, 8)
    wave = rng.normal(size=8) @ np.sin(2.0 * np.pi * np.outer(frequency, time) + phase[:, None])
    wave *= np.minimum(1.0, np.minimum(time, time[-1] - time) / 0.2)
    return wave / np.abs(wave).max()
