"""Scenes: data files that become polygons and a ground motion.

Only numpy is needed, so that another solver's interpreter can build the scene too.
"""

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from archfrag.arch.geometry import cross, polygon_section
from archfrag.arch.gravity import STANDARD_GRAVITY

__all__ = ["STANDARD_GRAVITY", "Bodies", "Scene", "load_scene", "scene_names"]
FOLDER = Path(__file__).parent / "scenes"
# What stands for a joint without friction limit in solvers that have none.
NO_SLIDING = 5.0

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Scene:
    """Straight-sided voussoirs in a row, on the ground or between two springings, and a motion.

    Attributes
    ----------
    name, title, source : str
        `source` names the section of the comparison that the scene belongs to.
    chain : dict
        As in the file: `kind` "circular" (radius [m], thickness [m], embrace [degrees],
        voussoirs, and `joints` if they are not equal: angles from the left springing [degrees]),
        "block" (width [m], height [m]) or "column" (width and top_width [m], heights of its drums
        [m]); friction, a number or "inf"; density [kg/m3]; depth [m]; `dead_load`, a weight on
        each back [N].
    motion : dict
        As in the file: `kind` "none", "rectangle" (amplitude for `duration`), "pulse" (the same,
        then minus half of it for twice as long), "sine" (`cycles` of `period`; in the
        middle of a `background` that goes on for `length` [s] if there is one), "record"
        (`file` in the shipped records or in a folder of real ones) or "samples" (`values` in
        units of the amplitude, linear between them where `each` divides their step); amplitude in
        multiples of standard gravity, of a record its peak; `sample_step` [s].
    duration : float
        Simulated time [s].
    low, high : float
        Amplitudes between which collapse begins, for searches; nan if it is not searched.
    initial : dict or None
        State at time 0, see `initial_state`; None: at rest.
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

    def to_dict(self) -> dict[str, Any]:
        """Content of the scene's file."""
        return dict(vars(self))

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
        return float(self.chain["thickness" if self.chain["kind"] == "circular" else "width"])

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
        return (chain["radius"] - half) * direction, (chain["radius"] + half) * direction

    def polygons(self) -> list[Array]:
        """Outlines of the voussoirs, anticlockwise, (4, 2) each [m]."""
        inner, outer = self.joint_lines()
        outlines = []
        for j in range(len(inner) - 1):
            outlines.append(_anticlockwise(inner[j], inner[j + 1], outer[j + 1], outer[j]))
        return outlines

    def supports(self) -> list[Array]:
        """Outlines of rigid ground blocks that hold the springing faces, anticlockwise [m].

        Each reaches a thickness beyond both ends of the face, so that a voussoir that slides
        finds ground under it, and two thicknesses behind it.
        """
        inner, outer = self.joint_lines()
        faces = [(inner[0], outer[0], inner[1])]
        if not self.free_end:
            faces.append((inner[-1], outer[-1], inner[-2]))
        blocks = []
        for start, end, inside in faces:
            along = (end - start) / np.linalg.norm(end - start)
            away = np.array([-along[1], along[0]])
            if away @ (inside - start) > 0.0:
                away = -away
            reach, behind = self.thickness * along, 2.0 * self.thickness * away
            near, far = start - reach, end + reach
            blocks.append(_anticlockwise(near, far, far + behind, near + behind))
        return blocks

    def bodies(self) -> "Bodies":
        """Masses, inertias and centroids of the voussoirs."""
        density = self.chain.get("density", 2000.0) * self.chain.get("depth", 1.0)
        sections = [polygon_section(outline) for outline in self.polygons()]
        own = density * np.array([section.area for section in sections])
        inertia = density * np.array([section.polar for section in sections])
        centroid = np.array([section.centroid for section in sections])
        load = np.broadcast_to(self.chain.get("dead_load", 0.0), own.shape) / STANDARD_GRAVITY
        _, outer = self.joint_lines()
        lever = 0.5 * (outer[:-1] + outer[1:]) - centroid
        fraction = load / (own + load)
        inertia = inertia + own * fraction * (lever**2).sum(axis=1)
        return Bodies(own + load, inertia, centroid + fraction[:, None] * lever)

    def ground_acceleration(self) -> tuple[Array, float]:
        """Samples of the horizontal ground acceleration [m/s2] and their step [s].

        Linear between samples and zero outside them. A jump inside the motion stands in one
        sample of its mean, which keeps the ground's velocity exact beyond it.
        """
        motion = self.motion
        if motion["kind"] == "none":
            return np.zeros(2), motion.get("sample_step", self.duration)
        step = float(motion["sample_step"])
        peak = motion["amplitude"] * STANDARD_GRAVITY
        if motion["kind"] == "pulse":
            first = round(motion["duration"] / step)
            samples = np.full(3 * first + 1, -0.5 * peak)
            samples[:first] = peak
            samples[first] = 0.25 * peak
            return samples, step
        if motion["kind"] == "rectangle":
            count = round(motion["duration"] / step)
            samples = np.zeros(count + 2)
            samples[:count] = peak
            samples[count] = 0.5 * peak
            return samples, step
        if motion["kind"] == "samples":
            values, parts = np.asarray(motion["values"], float), motion.get("each", 1)
            place = np.arange((len(values) - 1) * parts + 1) / parts
            return peak * np.interp(place, np.arange(len(values)), values), step / parts
        if motion["kind"] != "sine":
            raise ValueError(
                f"motion of kind {motion['kind']!r} in scene {self.name} has no samples"
            )
        count = round(motion["cycles"] * motion["period"] / step)
        time = step * np.arange(count + 1)
        sine = np.sin(2.0 * math.pi * time / motion["period"])
        if "length" not in motion:
            return peak * sine, step
        time = step * np.arange(round(motion["length"] / step) + 1)
        samples = motion["background"] * np.sin(2.0 * math.pi * time / motion["period"])
        first = (len(samples) - len(sine)) // 2
        samples[first : first + len(sine)] = sine
        return peak * samples, step

    def initial_state(self) -> tuple[Array, Array]:
        """Displacements from rest and velocities at time 0, (n, 3) each [m, m, rad], [.../s].

        Of a block, `angle` [rad] about a base corner (anticlockwise about the left one if
        positive), `spin` [rad/s] about it, and `slip` of the corner along the ground [m/s]. Of
        an arch, four `hinges` (joint, "intrados" or "extrados") and the `angle` by which the
        first part between them has rotated. Of either, `velocity` of all bodies, row by row, and
        `mirrored`: all of it left for right, for a symmetric chain.
        """
        centroid = self.bodies().centroid
        shift = np.zeros((len(centroid), 3))
        velocity = np.zeros_like(shift)
        initial = self.initial or {}
        if "hinges" in initial:
            shift = self._four_hinges(initial["hinges"], initial["angle"])
        elif "angle" in initial:
            angle, spin = initial["angle"], initial.get("spin", 0.0)
            corner = np.array([-0.5 * math.copysign(self.chain["width"], angle), 0.0])
            shift[0, :2], shift[0, 2] = _rotated(centroid[0], corner, angle), angle
            arm = centroid[0] + shift[0, :2] - corner
            velocity[0] = [initial.get("slip", 0.0) - spin * arm[1], spin * arm[0], spin]
        velocity = velocity + np.asarray(initial.get("velocity", 0.0), float)
        if initial.get("mirrored"):
            shift, velocity = (rows[::-1] * [-1.0, 1.0, -1.0] for rows in (shift, velocity))
        return shift, velocity

    def _four_hinges(self, hinges: list[tuple[int, str]], angle: float) -> Array:
        """Displacements of the mechanism of three parts, closed by two circles."""
        sides = dict(zip(("intrados", "extrados"), self.joint_lines()))
        first, second, third, last = (sides[side][joint] for joint, side in hinges)
        second_now = second + _rotated(second, first, angle)
        apart = last - second_now
        distance = float(np.hypot(*apart))
        middle, far = np.hypot(*(third - second)), np.hypot(*(last - third))
        along = (distance**2 + middle**2 - far**2) / (2.0 * distance)
        across = math.sqrt(middle**2 - along**2)
        unit = apart / distance
        normal = np.array([-unit[1], unit[0]])
        third_now = min(
            (second_now + along * unit + sign * across * normal for sign in (1.0, -1.0)),
            key=lambda place: float(np.hypot(*(place - third))),
        )
        angles = [
            angle,
            _angle_between(third - second, third_now - second_now),
            _angle_between(last - third, last - third_now),
        ]
        centroid = self.bodies().centroid
        shift = np.zeros((len(centroid), 3))
        parts = zip(hinges, hinges[1:], (first, second, third), (first, second_now, third_now))
        for ((start, _), (end, _), pivot, pivot_now), rotation in zip(parts, angles):
            for body in range(start, end):
                shift[body, :2] = _rotated(centroid[body], pivot, rotation)
                shift[body, :2] += pivot_now - pivot
                shift[body, 2] = rotation
        return shift

    def step_means(self, dt: float) -> Array:
        """Mean ground acceleration over each step of a run, (n_step,) [m/s2]."""
        count = round(self.duration / dt)
        samples, step = self.ground_acceleration()
        velocity = np.concatenate([[0.0], np.cumsum(0.5 * step * (samples[1:] + samples[:-1]))])
        place = np.clip(dt * np.arange(count + 1) / step, 0.0, len(samples) - 1.0)
        index = np.minimum(place.astype(int), len(samples) - 2)
        part = place - index
        slope = samples[index + 1] - samples[index]
        at_steps = velocity[index] + step * (samples[index] * part + 0.5 * slope * part**2)
        return np.diff(at_steps) / dt


@dataclass(frozen=True)
class Bodies:
    """Inertial data of the voussoirs: (n,) [kg], (n,) [kg m2] and (n, 2) [m]."""

    mass: Array
    inertia: Array
    centroid: Array


def load_scene(name: str) -> Scene:
    """Scene of a file in the folder `scenes`, by its name.

    Raises
    ------
    FileNotFoundError, KeyError, TypeError
        If there is no such file, or a key is missing or unknown.
    """
    with open(FOLDER / f"{name}.json", encoding="utf-8") as file:
        return Scene(name=name, **json.load(file))


def scene_names() -> list[str]:
    """Names of all scene files."""
    return sorted(path.stem for path in FOLDER.glob("*.json"))


def _anticlockwise(*points: Array) -> Array:
    corners = np.array(points)
    return corners if np.sum(cross(corners, np.roll(corners, -1, axis=0))) > 0.0 else corners[::-1]


def _rotated(point: Array, pivot: Array, angle: float) -> Array:
    """Displacement of a point that rotates about another."""
    cosine, sine = math.cos(angle) - 1.0, math.sin(angle)
    x, y = point - pivot
    return np.array([cosine * x - sine * y, sine * x + cosine * y])


def _angle_between(before: Array, after: Array) -> float:
    return math.atan2(float(cross(before, after)), float(before @ after))
