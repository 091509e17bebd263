"""The single block: reactions in the plane of the generalised directions of its contact."""

from collections.abc import Sequence

import numpy as np
from figures.drawing import (
    BLUE,
    GREEN,
    GREY,
    HTML,
    INK,
    ORANGE,
    PURPLE,
    SKY,
    VERMILION,
    arrow,
    bare,
    sheet,
    shown,
)
from matplotlib.axes import Axes
from matplotlib.patches import Wedge
from numpy.typing import NDArray

from archbench.paper import block as paper
from archbench.paper.block import (
    CORNER_A,
    Mechanism,
    RigidBlock,
    corner_motion,
    uniform_block,
)

# One block in all panels, so that they can be compared.
BLOCK = (0.4, 1.0)
FRICTION = 0.6
CONE = "#cfe3f1"
FloatArray = NDArray[np.float64]
_Vector = Sequence[float] | FloatArray


def reactions_in_cone() -> HTML:
    """Reactions of a block about corner A within Coulomb's cone, in plane pi (Eqs 15 to 20)."""
    b, h = BLOCK
    block = uniform_block(b, h, 1.0)
    figure = sheet(7.4, 6.8)
    panels = figure.subplots(2, 2)
    _balance(panels[0, 0], block, 0.0, 0.0, 0.5, "starts to rock")
    _balance(panels[0, 1], block, 0.15, 0.8, 0.55, "rocks on")
    _balance(panels[1, 0], block, 0.0, 0.0, 2.2, "starts to slide-rock")
    _split(panels[1, 1], block, 0.15, 1.0, -0.8, "slide-rocks on")
    return shown(
        figure,
        "Four balances of a block about a corner, drawn in the plane of the generalised "
        "directions of its contact: starting to rock, rocking, starting to slide-rock, sliding",
        "Figs 4 to 7. "
        f"Uniform block, b/h = {b / h:g}, μ = {FRICTION:g}, in contact at corner A; vectors in "
        "plane π, with mass, weight and height one. Nₜ and Nₙ are not orthogonal in the metric of "
        "kinetic energy, so Coulomb’s cone (shaded, from N⁻ to N⁺) leans. Starting to rock, −S "
        "lies inside the cone and its components are the reactions Ψₜ and Ψₙ. In motion the "
        "centripetal part of ü is added to it. Starting to slide-rock, −S lies outside: the "
        "reaction Ψ is on the boundary with the same projection on Nₙ, and what is missing from "
        "it lets the corner accelerate opposite to Nₜ. While the corner slides, Nₜ is split along "
        "u̇, the part that slows the motion, and across it, the part in plane π; the friction is "
        "Rₜ Nₜ.",
    )


class Plane:
    """Coordinates in the plane of two directions: along the second, and across it."""

    def __init__(self, first: _Vector, second: _Vector) -> None:
        self.up = np.array(second) / np.linalg.norm(second)
        across = np.array(first) - (np.array(first) @ self.up) * self.up
        self.across = across / np.linalg.norm(across)

    def __call__(self, vector: _Vector) -> FloatArray:
        return np.array([self.across @ np.array(vector), self.up @ np.array(vector)])


def _balance(
    axes: Axes, block: RigidBlock, rotation: float, omega: float, k_s: float, title: str
) -> None:
    """Eq 19 in plane pi for a corner that had stuck until now."""
    arm = paper.corner_arm(block, CORNER_A, rotation)
    n_t, n_n = n = paper.gradient(block, arm)
    rocking = paper.rocking_mechanism(block, arm, 1.0)
    rate = paper.gradient_rate(block, arm, omega)
    known = paper.centripetal_acceleration(n, rate, omega * rocking).sum(axis=0)
    active = paper.active_force(block, k_s, 0.0, 1.0)
    force = -paper.part_in_plane(active, rocking)
    now = corner_motion(block, CORNER_A, rotation, omega, 0.0, active, FRICTION)
    psi_t, psi_n = paper.generalised_reaction(n, np.array([now.tangential, now.normal]))
    flat = Plane(n_t, n_n)
    wanted, held = flat(force + known), flat(psi_t + psi_n)
    ends = (wanted, flat(force), flat(psi_t), flat(psi_n))
    reach = 1.2 * max(float(np.linalg.norm(end)) for end in ends)
    _cone(axes, flat, n_t, n_n, reach)
    if omega:
        arrow(axes, (0, 0), flat(force), GREEN, "−S")
        arrow(axes, flat(force), wanted, ORANGE, "centripetal", 0.5)
    else:
        arrow(axes, (0, 0), wanted, GREEN, "−S")
    sliding = now.mechanism == Mechanism.SLIDE_ROCK
    for part, label, at in ((psi_t, "Ψₜ", -0.9), (psi_n, "Ψₙ", 0.9)):
        arrow(axes, (0, 0), flat(part), BLUE, label, at)
        axes.plot(*np.transpose([flat(part), held]), color=BLUE, lw=0.7, ls=(0, (3, 2)))
    if sliding or omega:
        arrow(axes, (0, 0), held, VERMILION, "Ψ", -0.45 if omega else 0.7)
    if sliding:
        arrow(axes, held, wanted, PURPLE, "missing", 0.5)
    if omega:
        title += f", θ = {rotation:g}, ω²h/g = {omega**2:.2g}"
    axes.set_title(f"{title}, kₛ = {k_s:g}")
    bare(axes, 0.17)


def _cone(axes: Axes, flat: Plane, n_t: _Vector, n_n: _Vector, reach: float) -> None:
    rays = [flat(ray) for ray in paper.cone(np.array([n_t, n_n]), FRICTION)]
    ends = [float(np.degrees(np.arctan2(ray[1], ray[0]))) for ray in rays]
    axes.add_patch(Wedge((0.0, 0.0), reach, *ends, facecolor=CONE, linewidth=0, zorder=0))
    for ray, label in zip(rays, ("N⁺", "N⁻"), strict=True):
        tip = reach * ray / np.linalg.norm(ray)
        axes.plot([0.0, tip[0]], [0.0, tip[1]], color=SKY, lw=1.0, zorder=1)
        _grey(axes, 1.07 * tip, label)
    for vector, label in ((n_t, "Nₜ"), (n_n, "Nₙ")):
        tip = reach * flat(vector) / np.linalg.norm(vector)
        axes.plot([0.0, tip[0]], [0.0, tip[1]], color=GREY, lw=0.9, ls=(0, (5, 2)))
        _grey(axes, 1.07 * tip, label)


def _grey(axes: Axes, place: FloatArray, text: str) -> None:
    x, y = place
    axes.text(x, y, text, ha="center", va="center", color=GREY)


def _split(
    axes: Axes, block: RigidBlock, rotation: float, omega: float, slip: float, title: str
) -> None:
    """Fig 7: the tangential direction along a motion that slides, and across it."""
    arm = paper.corner_arm(block, CORNER_A, rotation)
    n_t = paper.gradient(block, arm)[0]
    rocking = paper.rocking_mechanism(block, arm, omega)
    velocity = rocking + paper.metric(block) * [slip, 0.0, 0.0]
    across = paper.part_in_plane(n_t, velocity)
    active = paper.active_force(block, 0.3, 0.0, 1.0)
    now = corner_motion(block, CORNER_A, rotation, omega, slip, active, FRICTION)
    flat = Plane(across, velocity)
    friction = now.tangential * n_t
    arrow(axes, (0, 0), flat(n_t), INK, "Nₜ")
    arrow(axes, (0, 0), flat(across), BLUE, "in plane π", 0.6)
    arrow(axes, flat(across), flat(n_t), PURPLE, "along u̇", 0.5)
    arrow(axes, (0, 0), flat(friction), VERMILION, "Ψₜ = Rₜ Nₜ", -0.6)
    speed = flat(velocity) / np.linalg.norm(velocity)
    axes.plot([0.0, speed[0]], [0.0, speed[1]], color=GREY, lw=0.9, ls=(0, (5, 2)))
    _grey(axes, 1.08 * speed, "u̇")
    axes.axhline(0.0, color=SKY, lw=1.0, zorder=0)
    axes.set_title(f"{title}, θ = {rotation:g}, ω²h/g = {omega**2:.2g}")
    bare(axes, 0.17)
