"""Scenes: data files that become polygons and a ground motion.

Only numpy is needed, so that another solver's interpreter can build the scene too.
"""

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

FOLDER = Path(__file__).parent / "scenes"
STANDARD_GRAVITY = 9.80665  # [m/s2]
NO_SLIDING = 5.0  # the friction of joints without limit in solvers that have none

Array = NDArray[np.float64]


class Bodies(NamedTuple):
    """Inertial data of the voussoirs: (n,) [kg], (n,) [kg m2] and (n, 2) [m]."""

    mass: Array
    inertia: Array
    centroid: Array


@dataclass(frozen=True)
class Scene:
    """Straight-sided voussoirs in a row, on the ground or between two springings, and a motion.

    `source` names the sets that the scene belongs to, or where its facts are from.
    `chain`: `kind` "circular" (radius, thickness [m], embrace [degrees], voussoirs, and angles of
    unequal `joints` from the left springing), "block" (width, height) or "column" (width,
    top_width, heights of its drums); friction, a number or "inf"; density; depth; `dead_load` [N].
    `motion`: `kind` "none", "rectangle" (amplitude for `duration`), "pulse" (the same, then minus
    half of it for twice as long), "sine" (`cycles` of `period`, in a `background` of `length`, its
    peak zero if it is `lost`), "record" (`file`) or "samples" (`values` in units of the amplitude,
    at `each` of the steps);
    amplitude in multiples of standard gravity, of a record its peak; `sample_step` [s].
    `duration` is simulated time [s]; collapse begins between the amplitudes `low` and `high`, nan
    if it is not searched; `initial` is the state at time 0, see `initial_state`, None: at rest.
    """

    name: str
    title: str
    source: str
    chain: dict[str, Any]
    motion: dict[str, Any]
    duration: float
    low: float = math.nan
    high: float = math.nan
    initial: dict[str, Any] | None = None

    def at(self, amplitude: float) -> "Scene":
        """Same scene with another amplitude of the ground motion, in standard gravity."""
        return replace(self, motion={**self.motion, "amplitude": amplitude})

    @property
    def friction(self) -> float:
        """Coulomb coefficient of all joints."""
        return float(self.chain["friction"])

    @property
    def finite_friction(self) -> float:
        """The same for solvers that know no joint without friction limit."""
        return min(self.friction, NO_SLIDING)

    @property
    def free_end(self) -> bool:
        """Whether the last body touches no ground."""
        return bool(self.chain["kind"] != "circular")

    @property
    def thickness(self) -> float:
        """Ring's thickness, or the width at the base [m]; collapse is judged by it."""
        return float(self.chain["width" if self.free_end else "thickness"])

    def joint_lines(self) -> tuple[Array, Array]:
        """Intrados and extrados ends of the joint lines, (n + 1, 2) each [m].

        Those of a block or column go from its base to its free top, left ends first.
        """
        chain = self.chain
        if self.free_end:
            rows = [chain["height"]] if chain["kind"] == "block" else chain["heights"]
            height = np.concatenate([[0.0], np.cumsum(rows)])
            top = chain.get("top_width", chain["width"])
            half = 0.5 * (chain["width"] + (top - chain["width"]) * height / height[-1])
            return np.column_stack([-half, height]), np.column_stack([half, height])
        embrace = math.radians(chain["embrace"])
        angle = np.linspace(-0.5 * embrace, 0.5 * embrace, chain["voussoirs"] + 1)
        if "joints" in chain:
            angle = np.radians(chain["joints"]) - 0.5 * embrace
        direction = np.column_stack([np.sin(angle), np.cos(angle)])
        half = 0.5 * chain["thickness"]
        return (chain["radius"] - half) * direction, (
            chain["radius"] + half
        ) * direction

    def polygons(self) -> list[Array]:
        """Outlines of the voussoirs, anticlockwise, (4, 2) each [m]."""
        inner, outer = self.joint_lines()
        corners = zip(inner[:-1], inner[1:], outer[1:], outer[:-1])
        return [_anticlockwise(*each) for each in corners]

    def supports(self) -> list[Array]:
        """Outlines of ground blocks at the springing faces, anticlockwise [m].

        Each reaches a thickness beyond both ends of the face, for voussoirs that slide.
        """
        inner, outer = self.joint_lines()
        blocks = []
        for end, inside in ((0, 1), (-1, -2))[: 1 if self.free_end else 2]:
            along = (outer[end] - inner[end]) / np.linalg.norm(outer[end] - inner[end])
            away = np.array([-along[1], along[0]])
            away *= -math.copysign(
                2.0 * self.thickness, away @ (inner[inside] - inner[end])
            )
            near = inner[end] - self.thickness * along
            far = outer[end] + self.thickness * along
            blocks.append(_anticlockwise(near, far, far + away, near + away))
        return blocks

    def bodies(self) -> Bodies:
        """Masses, inertias and centroids of the voussoirs."""
        density = self.chain.get("density", 2000.0) * self.chain.get("depth", 1.0)
        area, centroid, polar = map(np.array, zip(*map(_section, self.polygons())))
        own = density * area
        inertia = density * polar
        load = (
            np.broadcast_to(self.chain.get("dead_load", 0.0), own.shape)
            / STANDARD_GRAVITY
        )
        _, outer = self.joint_lines()
        lever = 0.5 * (outer[:-1] + outer[1:]) - centroid
        fraction = load / (own + load)
        inertia = inertia + own * fraction * (lever**2).sum(axis=1)
        return Bodies(own + load, inertia, centroid + fraction[:, None] * lever)

    def ground_acceleration(self) -> tuple[Array, float]:
        """Samples of the horizontal ground acceleration [m/s2] and their step [s].

        A jump inside the motion stands in one sample of its mean, which keeps the ground's
        velocity exact beyond it.
        """
        motion = self.motion
        kind = self.motion["kind"]
        if kind == "none":
            return np.zeros(2), motion.get("sample_step", self.duration)
        step = float(motion["sample_step"])
        parts = motion.get("each", 1)
        if kind in ("pulse", "rectangle"):
            count = round(motion["duration"] / step)
            after = [-0.5] * (2 * count) if kind == "pulse" else [0.0]
            samples = np.array([1.0] * count + [0.5 * (1.0 + after[0]), *after])
        elif kind == "samples":
            values = np.asarray(motion["values"], float)
            place = np.arange((len(values) - 1) * parts + 1) / parts
            samples = np.interp(place, np.arange(len(values)), values)
        elif kind == "sine":
            samples = self._sine(motion["cycles"] * motion["period"])
            if "length" in motion:
                burst = samples
                samples = motion["background"] * self._sine(motion["length"])
                first = (len(samples) - len(burst)) // 2
                samples[first : first + len(burst)] = burst
            if motion.get("lost"):
                samples[np.argmax(np.abs(samples))] = 0.0
        else:
            raise ValueError(
                f"motion of kind {kind!r} in scene {self.name} has no samples"
            )
        return motion["amplitude"] * STANDARD_GRAVITY * samples, step / parts

    def _sine(self, duration: float) -> Array:
        step = float(self.motion["sample_step"])
        time = step * np.arange(round(duration / step) + 1)
        return np.sin(2.0 * math.pi * time / self.motion["period"])

    def initial_state(self) -> tuple[Array, Array]:
        """Displacements from rest and velocities at time 0, (n, 3) each [m, m, rad], [.../s].

        `shift` and `velocity` of all bodies, row by row. Of a block, `angle` [rad] about a base
        corner (anticlockwise about the left one if positive), `spin` [rad/s] about it, and `slip`
        of the corner along the ground [m/s]. `mirrored`: left for right, for a symmetric chain.
        """
        initial = self.initial or {}
        shape = (len(self.polygons()), 3)
        shift, velocity = (
            np.broadcast_to(np.asarray(initial.get(name, 0.0), float), shape).copy()
            for name in ("shift", "velocity")
        )
        if "angle" in initial:
            angle = initial["angle"]
            spin = initial.get("spin", 0.0)
            corner = -0.5 * math.copysign(self.chain["width"], angle)
            arm = complex(*self.bodies().centroid[0]) - corner
            now = arm * complex(math.cos(angle), math.sin(angle))
            shift[0] = [now.real - arm.real, now.imag - arm.imag, angle]
            velocity[0] += [
                initial.get("slip", 0.0) - spin * now.imag,
                spin * now.real,
                spin,
            ]
        if initial.get("mirrored"):
            shift, velocity = (
                rows[::-1] * [-1.0, 1.0, -1.0] for rows in (shift, velocity)
            )
        return shift, velocity

    def step_means(self, dt: float) -> Array:
        """Mean ground acceleration over each step of a run, (n_step,) [m/s2]."""
        samples, step = self.ground_acceleration()
        instants = dt * np.arange(round(self.duration / dt) + 1, dtype=float)
        return means_between(instants, samples, step)


def means_between(time: Array, samples: Array, step: float) -> Array:
    """Exact means between instants of samples joined by lines; 0 where instants coincide."""
    velocity = np.append(0.0, np.cumsum(0.5 * step * (samples[1:] + samples[:-1])))
    place = np.clip(time / step, 0.0, len(samples) - 1.0)
    index = np.minimum(place.astype(int), len(samples) - 2)
    part = place - index
    slope = samples[index + 1] - samples[index]
    reached = velocity[index] + step * (samples[index] * part + 0.5 * slope * part**2)
    span = np.diff(time)
    return np.divide(np.diff(reached), span, out=np.zeros_like(span), where=span > 0.0)


def load_scene(name: str) -> Scene:
    """Scene of a file in the folder `scenes`, by its name."""
    return Scene(
        name=name, **json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    )


def scene_names() -> list[str]:
    """Names of all scene files."""
    return sorted(path.stem for path in FOLDER.glob("*.json"))


def _crosses(corners: Array) -> Array:
    """Twice the area between the first corner and each side."""
    x, y = corners.T
    return x * np.roll(y, -1) - np.roll(x, -1) * y


def _anticlockwise(*points: Array) -> Array:
    corners = np.array(points)
    return corners if _crosses(corners).sum() > 0.0 else corners[::-1]


def _section(corners: Array) -> tuple[float, Array, float]:
    """Area, centroid and polar second moment about it of a polygon."""
    origin = corners.mean(axis=0)
    arm = corners - origin
    after = np.roll(arm, -1, axis=0)
    twice = _crosses(arm)
    area = 0.5 * twice.sum()
    middle = twice @ (arm + after) / (6.0 * area)
    polar = twice @ (arm**2 + arm * after + after**2).sum(axis=1) / 12.0
    return area, origin + middle, polar - area * (middle**2).sum()


class Corners:
    """Two contact points at each joint, for solvers that are given theirs.

    `joint`, `before`, `after` are (n_contact,): the joint and the bodies on both sides; the ground
    is the body after the last. `columns` (n_contact, 6) are those of both bodies among all
    positions. `normal` is that of the face of the body before, `arm_before` and `arm_after` reach
    from either centroid (`place`) to the corner, (n_contact, 2) each, at rest [m]. `inward` is
    the sense of slip that takes the corner of the body after onto the face of the one before.
    """

    def __init__(self, scene: Scene) -> None:
        centroid = scene.bodies().centroid
        self.count = count = len(centroid)
        inner, outer = scene.joint_lines()
        n_joint = count if scene.free_end else count + 1
        middle = 0.5 * (inner + outer)
        travel = np.diff(
            middle, axis=0, append=middle[-1:] + middle[-1:] - middle[-2:-1]
        )
        along = outer - inner
        normal = np.column_stack([-along[:, 1], along[:, 0]])
        normal *= np.sign(np.sum(normal * travel, axis=1))[:, None]
        normal /= np.hypot(*along.T)[:, None]
        self.joint = np.repeat(np.arange(n_joint), 2)
        corner = np.column_stack([inner, outer]).reshape(-1, 2)[: 2 * n_joint]
        self.place = np.vstack([centroid, np.zeros(2)])
        self.before = np.where(self.joint > 0, self.joint - 1, count)
        self.after = np.where(self.joint < count, self.joint, count)
        both = np.column_stack([self.before, self.after])
        self.columns = (3 * both[:, :, None] + np.arange(3)).reshape(-1, 6)
        self.normal = normal[self.joint]
        sense = np.sign(along[:, 1] * normal[:, 0] - along[:, 0] * normal[:, 1])
        self.inward = (sense[:, None] * [1.0, -1.0]).ravel()[: 2 * n_joint]
        self.arm_before = corner - self.place[self.before]
        self.arm_after = corner - self.place[self.after]

    def linearise(self, q: Array) -> tuple[Array, Array]:
        """Gap and slip of each contact [m], and their derivatives, at positions (n_body, 3).

        The corner that lies on the other body's face acts, along the normal of that face: a
        normal of either body at will gets friction at open joints wrong by their rotation. Values
        (n_contact, 2) are along the normal, and across it (anticlockwise); derivatives
        (n_contact, 2, 6) by the body before, then by that after.
        """
        q = np.vstack([q, np.zeros(3)])
        rotation = np.exp(1j * q[:, 2])
        centre = (self.place + q[:, :2]) @ [1.0, 1j]
        arm_before = rotation[self.before] * (self.arm_before @ [1.0, 1j])
        arm_after = rotation[self.after] * (self.arm_after @ [1.0, 1j])
        apart = centre[self.after] + arm_after - centre[self.before] - arm_before
        normal = self.normal @ [1.0, 1j]
        slip = ((1j * rotation[self.before] * normal).conj() * apart).real
        on_after = slip * self.inward < 0.0
        normal = normal * rotation[np.where(on_after, self.after, self.before)]
        # The frame rotates with the face's body, so its arm reaches the other's corner.
        reach_before = arm_before + np.where(on_after, 0.0, apart)
        reach_after = arm_after - np.where(on_after, apart, 0.0)
        matrix = np.empty((len(apart), 2, 6))
        value = np.empty((len(apart), 2))
        for row, e in enumerate((normal, 1j * normal)):
            value[:, row] = (e.conj() * apart).real
            spin = -(reach_before.conj() * e).imag, (reach_after.conj() * e).imag
            matrix[:, row] = np.column_stack(
                [-e.real, -e.imag, spin[0], e.real, e.imag, spin[1]]
            )
        return value, matrix
