"""The arch: its starting mechanism, reactions at mega-voussoirs, thrust line, motion, energy."""

from functools import cache

import numpy as np
from figures.drawing import (
    BLUE,
    GREEN,
    GREY,
    HTML,
    INK,
    ORANGE,
    PALE,
    PURPLE,
    SKY,
    VERMILION,
    arrow,
    bare,
    moved,
    name,
    sheet,
    shown,
    stones,
)
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from numpy.typing import NDArray

import archfrag as af

FloatArray = NDArray[np.float64]
G = 9.80665
SIDES = {"intrados": BLUE, "extrados": VERMILION}
CLOSED = 7  # contact mode of a joint that is closed and sticks


@cache
def arch() -> af.Arch:
    """Oppenheim's arch: radius 10 m, thickness 1.5 m, embrace 157.5°, seven voussoirs."""
    return af.Arch.circular(10.0, 1.5, 157.5, 7, 0.7)


@cache
def run(amplitude: float, method: str = "event_driven") -> af.Response:
    """Its response to a ground acceleration of +a for 0.3 s and −a/2 for 0.6 s [g]."""
    time = np.arange(0.0, 1.0, 1e-3)
    shape = np.where(time < 0.3, 1.0, np.where(time < 0.9, -0.5, 0.0))
    motion = af.Motion(amplitude * G * shape, 1e-3)
    return af.simulate(arch(), motion, method=method, rtol=1e-6, history=True)


def hinges(axes: Axes, corners: list[FloatArray], sides: list[str]) -> None:
    """Hinges as discs in the colour of their side."""
    for corner, side in zip(corners, sides):
        axes.plot(*corner, "o", color=SIDES[side], ms=6, zorder=4)


def corner_of(joint: int, side: str) -> FloatArray:
    """Place of a corner at rest."""
    return (arch().extrados if side == "extrados" else arch().intrados)[joint]


def scheme() -> HTML:
    """Voussoirs and joints with their numbers (Fig 8)."""
    figure = sheet(7.4, 3.6)
    axes = figure.subplots()
    stones(axes, arch().outlines)
    for i, centre in enumerate(arch().chain.centroid):
        axes.plot(*centre, "o", color=INK, ms=2.5)
        name(axes, *(0.965 * centre), f"G({i + 1})")
    for j in range(arch().n_joint):
        name(axes, *(1.06 * arch().extrados[j]), str(j), GREY)
    arrow(axes, (-1.2, 2.5), (1.2, 2.5), INK, "kₛ g")
    bare(axes)
    return shown(
        figure, "An arch of seven voussoirs, joints numbered from 0 to 7",
        "Fig 8. "
        "Voussoirs i = 1 … n between joints j = 0 … n; the ground moves horizontally.",
    )  # fmt: skip


def joint() -> HTML:
    """An open joint: the two normals that split the law in two (Fig 9, Eqs 23a and 23b)."""
    figure = sheet(7.4, 3.2)
    axes = figure.subplots()
    angle = -0.35
    rotate = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    lower = np.array([[-2.0, 0.0], [0.0, 0.0], [0.0, 1.5], [-2.0, 1.5]])
    upper = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.5], [0.0, 1.5]]) @ rotate.T
    stones(axes, [lower, upper])
    axes.plot(0.0, 0.0, "o", color=INK, ms=6, zorder=4)
    name(axes, -0.05, -0.25, "P = Q")
    name(axes, -1.0, 0.75, "voussoir i")
    name(axes, *(rotate @ [1.1, 0.75]), "voussoir i + 1")
    arrow(axes, (0, 0), (0.9, 0.0), BLUE, "n of i (23a)", 0.6)
    arrow(axes, (0, 0), 0.9 * rotate[:, 0], VERMILION, "n of i + 1 (23b)", -0.75)
    bare(axes)
    return shown(
        figure, "Two voussoirs that touch at a corner with an open joint between them",
        "Fig 9. "
        "At an open joint each face has a normal of its own, and Signorini’s and Coulomb’s laws "
        "hold for both; at a closed joint the two coincide.",
    )  # fmt: skip


def onset(times: float = 1.0) -> HTML:
    """Starting mechanism, its instantaneous centres and the thrust line (Fig 10, Eq 28)."""
    start = af.onset(arch())
    corners = [corner_of(joint, side) for joint, side in start.hinges]
    figure = sheet(7.4, 4.6)
    axes = figure.subplots()
    stones(axes, arch().outlines)
    axes.plot(*start.thrust_plus.T, color=GREEN, label="thrust line at onset")
    centre = meeting(corners)
    for near, far in ((corners[0], corners[1]), (corners[3], corners[2])):
        axes.plot(*np.transpose([near, far, centre]), color=GREY, lw=0.8, ls=(0, (5, 3)))
    axes.plot(*centre, "s", color=INK, ms=5)
    name(axes, centre[0] + 0.5, centre[1] + 0.3, "C₂")
    hinges(axes, corners, [side for _, side in start.hinges])
    for corner, words in zip(corners, ("C₁", "C₁,₂", "C₂,₃", "C₃")):
        name(axes, *(1.09 * corner), words)
    axes.legend(loc="lower center")
    bare(axes)
    words = ", ".join(f"{joint} {side}" for joint, side in start.hinges)
    return shown(
        figure, "The arch at onset: four hinges, rotation centres and thrust line",
        "Fig 10. "
        f"Ground accelerating to the right at {start.plus:.4f} g: hinges {words}. C₂, about which "
        "the middle mega-voussoir starts to rotate, lies where the lines C₁ C₁,₂ and C₃ C₂,₃ "
        "meet; the thrust line passes through all four hinges.",
    )  # fmt: skip


def meeting(corners: list[FloatArray]) -> FloatArray:
    """Rotation centre of the middle one of three mega-voussoirs."""
    first, second = corners[1] - corners[0], corners[2] - corners[3]
    along = np.linalg.solve(np.column_stack([first, -second]), corners[3] - corners[0])[0]
    return corners[0] + along * first


class Instant:
    """A frame of a history: outlines, joint corners, reactions and where they act."""

    def __init__(self, response: af.Response, time: float) -> None:
        history = response.history
        frame = history.isel(time=int(np.abs(history.time.values - time).argmin()))
        self.time = float(frame.time)
        self.shift, self.rotation = frame.displacement.values, frame.rotation.values
        self.force, moment = frame.reaction.values, frame.moment.values
        self.mode = frame.contact_mode.values
        chain = arch().chain
        body = np.r_[np.arange(arch().n_voussoir), -1]
        self.corners = np.empty((arch().n_joint, 2, 2))
        for j, i in enumerate(body):
            if i < 0:
                self.corners[j] = chain.face_after[j]
                continue
            c, s = np.cos(self.rotation[i]), np.sin(self.rotation[i])
            placed = chain.face_after[j] @ np.array([[c, s], [-s, c]])
            self.corners[j] = chain.centroid[i] + self.shift[i] + placed
        along = self.corners[:, 1] - self.corners[:, 0]
        length = np.linalg.norm(along, axis=1)
        along /= length[:, None]
        across = np.column_stack([along[:, 1], -along[:, 0]])
        pressing = (self.force * across).sum(1)
        self.slope = (self.force * along).sum(1) / pressing
        at = 0.5 * length + moment / pressing
        first, second = np.isin(self.mode, (1, 2, 3)), np.isin(self.mode, (4, 5, 6))
        self.place = np.where(first, 0.0, np.where(second, length, at)) / length  # e of Eq 34
        self.thrust = self.corners[:, 0] + (self.place * length)[:, None] * along


def in_motion(amplitude: float = 0.4, time: float = 0.25, times: float = 20.0) -> HTML:
    """Reactions between mega-voussoirs and the thrust line inside them (Eqs 29 to 35)."""
    now = Instant(run(amplitude), time)
    opened = [j for j, mode in enumerate(now.mode) if mode != CLOSED]
    figure = sheet(7.4, 4.8)
    axes = figure.subplots()
    stones(axes, moved(arch(), now.shift, now.rotation, 1.0))
    axes.plot(*now.thrust.T, color=GREEN, lw=1.2, label="thrust line")
    scale = 2.5 / np.linalg.norm(now.force, axis=1).max()
    hinge = [now.thrust[j] for j in opened]
    if len(hinge) == 4:
        centre = meeting(hinge)
        for near, far in ((hinge[0], hinge[1]), (hinge[3], hinge[2])):
            axes.plot(*np.transpose([near, far, centre]), color=GREY, lw=0.8, ls=(0, (5, 3)))
        axes.plot(*centre, "s", color=INK, ms=5)
        name(axes, centre[0] + 0.5, centre[1] + 0.3, "C₂")
    for j in opened:
        arrow(axes, now.thrust[j] - scale * now.force[j], now.thrust[j], PURPLE)
    inner = [j for j in range(arch().n_joint) if j not in opened]
    axes.plot(*now.thrust[inner].T, "o", color=GREEN, ms=4, label="contact centres, Eq 34")
    hinges(axes, hinge, ["intrados" if now.mode[j] < 4 else "extrados" for j in opened])
    axes.legend(loc="lower center")
    bare(axes)
    return shown(
        figure, "The arch in motion: reactions at hinges, thrust line and contact centres",
        f"The same arch under {amplitude:g} g at {now.time:.2f} s. Purple: reactions on the "
        "voussoir behind each hinge. The part of those at C₁,₂ and C₂,₃ in plane π⁽²⁾ points at "
        "C₂; the part across it gives the outer mega-voussoirs their acceleration. Green: second "
        "level, propagated from joint to joint.",
    )  # fmt: skip


def second_level(amplitude: float = 0.4, time: float = 0.25) -> HTML:
    """Contact centre e and obliquity of the reaction at each joint (Eqs 34 and 35)."""
    now = Instant(run(amplitude), time)
    figure = sheet(7.4, 2.7)
    left, right = figure.subplots(1, 2)
    joints = np.arange(arch().n_joint)
    left.plot(joints, now.place, "o-", color=GREEN)
    left.axhspan(0.0, 1.0, color=PALE, alpha=0.4, lw=0)
    left.set(xlabel="joint", ylabel="e (0: intrados, 1: extrados)", ylim=(-0.1, 1.1))
    right.plot(joints, now.slope, "o-", color=PURPLE)
    right.axhspan(-0.7, 0.7, color=PALE, alpha=0.4, lw=0)
    right.set(xlabel="joint", ylabel="shear over normal force")
    return shown(
        figure, "Contact centres and obliquity of reactions at all joints, within their limits",
        f"At {now.time:.2f} s under {amplitude:g} g: e stays within the joint (shaded) and the "
        "reaction within Coulomb’s cone, so the intermediate joints stay closed.",
    )  # fmt: skip


def mechanism(amplitude: float = 0.5, end: float = 1.2) -> HTML:
    """Which joints are open, at which side, over time."""
    history = run(amplitude).history.sel(time=slice(0.0, end))
    mode, time = history.contact_mode.values, history.time.values
    figure = sheet(7.4, 3.6)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    for j in range(arch().n_joint):
        for modes, side in (((1, 2, 3), "intrados"), ((4, 5, 6), "extrados")):
            held = np.r_[False, np.isin(mode[:-1, j], modes), False]
            ends = time[np.flatnonzero(np.diff(held.astype(int)))].reshape(-1, 2)
            spans = [[(a, j), (b, j)] for a, b in ends]
            upper.add_collection(LineCollection(spans, colors=SIDES[side], linewidths=5))
    upper.set(ylim=(-0.6, arch().n_joint - 0.4), ylabel="joint hinged at")
    for side, colour in SIDES.items():
        upper.plot([], [], color=colour, lw=5, label=side)
    upper.legend(loc="upper left", bbox_to_anchor=(0.0, 1.22), ncols=2)
    lower.step(time, (mode != CLOSED).sum(1), where="post", color=INK, lw=0.9)
    lower.set(xlabel="time [s]", ylabel="open joints", xlim=(0.0, end))
    return shown(
        figure, "Hinges of each joint over time, and how many joints are open",
        f"Ground +{amplitude:g} g for 0.3 s, then −{amplitude / 2:g} g for 0.6 s. Before the "
        "first impact five joints are open; after it hinges split, migrate and change side.",
    )  # fmt: skip


def portraits(amplitudes: tuple[float, ...] = (0.4, 0.5, 0.6, 0.7)) -> HTML:
    """Rotation and angular velocity of the first voussoir under pulses of some sizes."""
    figure = sheet(7.4, 3.2)
    axes = figure.subplots()
    for amplitude, colour in zip(amplitudes, (SKY, BLUE, ORANGE, VERMILION)):
        response = run(amplitude)
        history = response.history
        angle, rate = history.rotation.values[:, 0], history.angular_velocity.values[:, 0]
        words = "collapses" if response.collapsed else "stands"
        kept = np.abs(angle) < 0.2
        axes.plot(angle[kept], rate[kept], color=colour, lw=1.0, label=f"{amplitude:g} g, {words}")
    axes.set(xlabel="rotation of voussoir 1 [rad]", ylabel="angular velocity [rad/s]")
    axes.set(ylim=(-0.6, 0.6))
    axes.legend()
    return shown(
        figure, "Phase portrait of the first voussoir under four pulses",
        "Vertical jumps are impacts. The least pulse that collapses is about 0.68 g.",
    )  # fmt: skip


def shapes(amplitude: float = 0.5, times: float = 8.0) -> HTML:
    """The arch at four instants, displacements multiplied."""
    figure = sheet(7.4, 4.2)
    for axes, time in zip(figure.subplots(2, 2).ravel(), (0.2, 0.4, 0.6, 0.8)):
        now = Instant(run(amplitude), time)
        stones(axes, arch().outlines, facecolor="none", edgecolor=PALE)
        stones(axes, moved(arch(), now.shift, now.rotation, times))
        axes.set_title(f"{now.time:.1f} s")
        bare(axes)
    return shown(
        figure, "The arch at four instants of its motion",
        f"Ground +{amplitude:g} g for 0.3 s, then −{amplitude / 2:g} g; displacements {times:g} "
        "times, the arch at rest in grey.",
    )  # fmt: skip


def energy(amplitudes: tuple[float, ...] = (0.4, 0.5, 0.6)) -> HTML:
    """Where the work of the ground goes."""
    figure = sheet(7.4, 2.6)
    axes = figure.subplots()
    parts = (("ground", GREEN), ("impacts", VERMILION), ("friction", ORANGE))
    for row, amplitude in enumerate(amplitudes):
        held = run(amplitude).energy
        for k, (part, colour) in enumerate(parts):
            label = part if row == 0 else None
            axes.barh(row + 0.2 * (1.5 - k), held[part] / 1e3, 0.19, color=colour, label=label)
    axes.axvline(0.0, color=GREY, lw=0.8)
    axes.set(yticks=range(len(amplitudes)), xlabel="energy [kJ]")
    axes.set_yticklabels([f"{amplitude:g} g" for amplitude in amplitudes])
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return shown(
        figure, "Work of the ground, of impacts and of friction for three pulses",
        "Runs that come to rest: what the ground has given, impacts and friction have taken. What "
        "no contact law explains is the integrator’s error and is reported for each run.",
    )  # fmt: skip
