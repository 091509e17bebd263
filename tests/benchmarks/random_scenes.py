"""Random scenes from a seed and an index, and a look at a final state for lost contact."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

import archfrag
from archfrag.arch import STANDARD_GRAVITY
from archfrag.errors import InputError
from archfrag.mechanics.types import Chain

Array = NDArray[np.float64]
LEAST_ONSET = 1e-3  # [g]


@dataclass(frozen=True)
class RandomScene:
    """A chain that stands, and a ground motion for it.

    Attributes
    ----------
    kind, shaking : str
        Profile and form of the motion.
    onset : float
        Steady acceleration towards +x that the chain bears [g].
    level : float
        Largest ground acceleration over `onset` [1].
    redrawn : int
        Chains drawn before that cannot be built or do not stand.
    """

    arch: archfrag.Arch
    motion: archfrag.Motion
    kind: str
    shaking: str
    onset: float
    level: float
    redrawn: int


def random_scene(seed: int, index: int) -> RandomScene:
    """Scene of an index; the same for the same seed, whatever was drawn before.

    Parameters
    ----------
    seed, index : int

    Returns
    -------
    RandomScene
    """
    rng = np.random.default_rng([seed, index])
    redrawn = 0
    while True:
        kind = str(rng.choice(list(CHAINS)))
        try:
            arch = CHAINS[kind](rng, _friction(rng))
            start = archfrag.onset(arch)
        except InputError:
            redrawn += 1
            continue
        if start.stands and LEAST_ONSET <= start.plus < np.inf:
            break
        redrawn += 1
    shaking = str(rng.choice(list(SHAKINGS)))
    level = rng.uniform(0.5, rng.choice([2.0, 4.0, 10.0]))
    motion = _motion(rng, SHAKINGS[shaking], level * start.plus * STANDARD_GRAVITY)
    return RandomScene(arch, motion, kind, shaking, start.plus, level, redrawn)


def _friction(rng: Generator) -> float:
    return float(np.inf) if rng.random() < 0.3 else float(rng.uniform(0.2, 1.2))


def _count(rng: Generator, least: int) -> int:
    """Bodies up to 60; in half of the scenes small numbers are as frequent as large ones."""
    if rng.random() < 0.5:
        return int(rng.integers(least, 61))
    return int(np.exp(rng.uniform(np.log(least), np.log(61.0))))


def _circular(rng: Generator, friction: float) -> archfrag.Arch:
    return archfrag.Arch.circular(
        10.0,
        rng.uniform(0.8, 3.0),
        rng.uniform(60.0, 200.0),
        _count(rng, 2),
        friction,
        sector=bool(rng.random() < 0.5),
    )


def _segmental(rng: Generator, friction: float) -> archfrag.Arch:
    rise, thickness = rng.uniform(0.6, 3.0), rng.uniform(0.25, 1.0)
    return archfrag.Arch.segmental(6.0, rise, thickness, _count(rng, 2), friction)


def _pointed(rng: Generator, friction: float) -> archfrag.Arch:
    rise, thickness = rng.uniform(3.1, 6.0), rng.uniform(0.3, 1.2)
    return archfrag.Arch.pointed(6.0, rise, thickness, _count(rng, 2), friction)


def _elliptic(rng: Generator, friction: float) -> archfrag.Arch:
    rise, thickness = rng.uniform(1.2, 4.0), rng.uniform(0.3, 1.2)
    return archfrag.Arch.elliptic(6.0, rise, thickness, _count(rng, 2), friction)


def _catenary(rng: Generator, friction: float) -> archfrag.Arch:
    rise, thickness = rng.uniform(1.5, 8.0), rng.uniform(0.15, 0.8)
    return archfrag.Arch.catenary(6.0, rise, thickness, _count(rng, 2), friction)


def _block(rng: Generator, friction: float) -> archfrag.Arch:
    width = rng.uniform(0.2, 1.0)
    return archfrag.Block(width, width * rng.uniform(1.0, 8.0), friction)


def _column(rng: Generator, friction: float) -> archfrag.Arch:
    """Tapered, of drums of unequal height."""
    drums = _count(rng, 1)
    height = np.concatenate([[0.0], np.cumsum(rng.uniform(0.5, 1.0, drums))])
    height *= rng.uniform(2.0, 10.0) / height[-1]
    base = height[-1] / rng.uniform(3.0, 8.0)
    side = 0.5 * base * (1.0 - rng.uniform(0.0, 0.4) * height / height[-1])
    return _stack(side, height, friction)


def _wall(rng: Generator, friction: float) -> archfrag.Arch:
    """Of equal courses, each wider than high."""
    courses = _count(rng, 1)
    width = rng.uniform(0.2, 0.8)
    height = np.arange(courses + 1) * width * rng.uniform(0.15, 1.0)
    return _stack(np.full(courses + 1, 0.5 * width), height, friction)


def _stack(side: Array, height: Array, friction: float) -> archfrag.Arch:
    right = np.column_stack([side, height])
    return archfrag.Arch.from_joints(right, right * [-1.0, 1.0], friction, free_end=True)


CHAINS: dict[str, Callable[[Generator, float], archfrag.Arch]] = {
    "circular": _circular,
    "segmental": _segmental,
    "pointed": _pointed,
    "elliptic": _elliptic,
    "catenary": _catenary,
    "block": _block,
    "column": _column,
    "wall": _wall,
}


def _pulse(rng: Generator, time: Array) -> Array:
    length = rng.uniform(0.05, 0.6)
    after = -0.5 if rng.random() < 0.7 else 0.0
    return np.where(time < length, 1.0, np.where(time < 3.0 * length, after, 0.0))


def _sine(rng: Generator, time: Array) -> Array:
    frequency = rng.uniform(0.3, 6.0)
    wave = np.sin(2.0 * np.pi * frequency * time)
    return np.where(time < rng.integers(1, 9) / frequency, wave, 0.0)


def _noise(rng: Generator, time: Array) -> Array:
    """Smoothed over up to a fifth of a second, rising and fading."""
    width = int(rng.integers(3, 3 + max(1, round(0.2 / time[1]))))
    wave = np.convolve(rng.normal(size=time.size), np.hanning(width + 2), "same")
    return wave * np.sin(np.pi * (time + time[1]) / (time[-1] + 2.0 * time[1])) ** 0.5


SHAKINGS: dict[str, Callable[[Generator, Array], Array]] = {
    "pulse": _pulse,
    "sine": _sine,
    "noise": _noise,
}


def _motion(rng: Generator, form: Callable[[Generator, Array], Array], peak: float):
    """A motion that reaches `peak` [m/s2]; in three cases of ten it has a vertical."""
    step = float(rng.choice([0.005, 0.01, 0.02]))
    time = np.arange(0.0, rng.uniform(0.5, 6.0), step)
    wave = form(rng, time)
    wave *= rng.choice([-1.0, 1.0]) * peak / np.abs(wave).max()
    vertical = None
    if rng.random() < 0.3:
        vertical = _noise(rng, time)
        vertical *= rng.uniform(0.1, 0.9) * peak / np.abs(vertical).max()
    return archfrag.Motion(wave, step, vertical=vertical)


def place_faces(chain: Chain, position: Array, joint: int) -> tuple[Array, Array]:
    """Faces of the bodies before and after a joint, in the ground's frame.

    Parameters
    ----------
    chain : Chain
    position : ndarray, (n_body, 3)
        Centroid [m] and rotation [rad].
    joint : int

    Returns
    -------
    before, after : ndarray, (2, 2)
        Corner, xy [m].
    """
    faces = []
    for face, body in ((chain.face_before[joint], joint - 1), (chain.face_after[joint], joint)):
        if 0 <= body < len(position):
            x, y, angle = position[body]
            turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
            face = face @ turn.T + np.array([x, y])
        faces.append(np.array(face))
    return faces[0], faces[1]


def how_contact_ended(chain: Chain, position: Array, joint: int, apart: float = 1e-3) -> str:
    """What has become of a joint, by the geometry of its two faces alone.

    Parameters
    ----------
    chain, position, joint
        As in `place_faces`.
    apart : float
        Least distance between the faces that counts as lost contact, over their length [1].

    Returns
    -------
    str
        "apart", "past" (slid beyond the end of the face), "overturned" (by 90 degrees), or
        "held".
    """
    before, after = place_faces(chain, position, joint)
    length = min(np.linalg.norm(before[1] - before[0]), np.linalg.norm(after[1] - after[0]))
    turn = sum(
        sign * position[body, 2]
        for sign, body in ((1.0, joint), (-1.0, joint - 1))
        if 0 <= body < len(position)
    )
    if abs(turn) >= 0.5 * np.pi * (1.0 - 1e-9):
        return "overturned"
    if segment_distance(before, after) > apart * length:
        return "apart"
    for one, other in ((before, after), (after, before)):
        along = (one[1] - one[0]) / np.linalg.norm(one[1] - one[0])
        reach, span = (other - one[0]) @ along, np.linalg.norm(one[1] - one[0])
        if reach.min() >= span * (1.0 - 1e-6) or reach.max() <= span * 1e-6:
            return "past"
    return "held"


def segment_distance(one: Array, other: Array) -> float:
    """Least distance between two segments, each (2, 2); 0 where they cross."""

    def side(line: Array, point: Array) -> float:
        along, out = line[1] - line[0], point - line[0]
        return float(along[0] * out[1] - along[1] * out[0])

    if (
        side(one, other[0]) * side(one, other[1]) < 0.0
        and side(other, one[0]) * side(other, one[1]) < 0.0
    ):
        return 0.0
    least = np.inf
    for line, points in ((one, other), (other, one)):
        along = line[1] - line[0]
        for point in points:
            part = np.clip((point - line[0]) @ along / (along @ along), 0.0, 1.0)
            least = min(least, float(np.linalg.norm(point - line[0] - part * along)))
    return least
