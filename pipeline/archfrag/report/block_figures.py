"""The single block: regions of starting motion, and reactions within Coulomb's cone."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon, Wedge
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike

from archfrag.errors import InputError
from archfrag.mechanics.block import formulas, plane
from archfrag.mechanics.block.formulas import CORNER_A, RigidBlock, uniform_block
from archfrag.mechanics.block.motion import Mechanism, corner_motion
from archfrag.mechanics.block.regions import rocking_friction, sliding_load
from archfrag.report import canvas
from archfrag.report.canvas import Picture, picture, standalone
from archfrag.report.summary import FloatArray
from archfrag.study.files import make_folder, replacing

_SHADE = {
    Mechanism.REST: "#eef1f4",
    Mechanism.SLIDE: "#fbe6bd",
    Mechanism.SLIDE_ROCK: "#f6cbb0",
    Mechanism.ROCK: "#cfe3f1",
    Mechanism.LIFT_OFF: "#dcd3e6",
}
_STONE, _EDGE = "#e9e4da", "#8d8473"
_BORDER: dict[str, Any] = {"color": canvas.INK, "lw": 1.1}
# One block in all panels, so that they can be compared.
_BLOCK = (0.4, 1.0)
_FRICTION = 0.6
_Vector = Sequence[float] | FloatArray


def starting_regions(
    slenderness: float, name: str, friction: float, ground_y: float = -0.4
) -> Picture:
    """Which motion starts from rest, in the plane of k_s and mu and in that of k_s and k_v.

    Parameters
    ----------
    slenderness : float
        b/h of a uniform rectangle.
    name : str
        Unique on the page.
    friction : float
        Of the panel over k_s and k_v.
    ground_y : float
        k_v of the second panel over k_s and mu.
    """
    block = uniform_block(slenderness, 1.0, 1.0)

    def draw(figure: Figure) -> None:
        (first, second), (third, sketch) = figure.subplots(2, 2)
        reach = 2.5 * slenderness
        for axes, lift in ((first, 0.0), (second, ground_y)):
            _regions_over_friction(axes, block, lift, reach)
            axes.set_title(f"kᵥ = {lift:g}".replace("-", "−"))
        _regions_over_vertical(third, block, friction, reach)
        third.set_title(f"μ = {friction:g}")
        _draw_block(sketch, block)

    return picture(
        name, (canvas.WIDTH, 5.9), draw,
        alternative=f"Regions of starting motion of a block with b/h = {slenderness:g}: rest, "
        "slide, rock, slide-rock and lift-off, by horizontal and vertical ground acceleration and "
        "friction",
        caption=f"Motion that starts from rest, uniform block with b/h = {slenderness:g}; "
        "kₛ and kᵥ are the accelerations of the ground in g, to the right and upwards. Borders: "
        "rest and slide |kₛ| = μ (1 + kᵥ); rest and rock |kₛ| = (b/h)(1 + kᵥ); slide and "
        "slide-rock μ = b/h; the curved border of slide-rock and rock is Shenton's condition; "
        "lift-off below kᵥ = −1. Over A or B: corner about which the block turns.",
    )  # fmt: skip


def _regions_over_friction(axes: Axes, block: RigidBlock, ground_y: float, reach: float) -> None:
    pressed = 1.0 + ground_y
    tip = block.reach_a / block.rise
    load = np.unique(np.append(np.linspace(0.0, reach / pressed, 301), tip))
    beyond = load[load >= tip]
    shenton = np.array([rocking_friction(block, CORNER_A, q) for q in beyond])
    inside = load[load <= tip]
    for sign in (1.0, -1.0):
        x_in, x_out = sign * pressed * inside, sign * pressed * beyond
        level, top = np.full(beyond.size, tip), np.full(beyond.size, reach)
        for x, low, high, mechanism in (
            (x_in, inside, np.full(inside.size, reach), Mechanism.REST),
            (x_in, 0.0 * inside, inside, Mechanism.SLIDE),
            (x_out, 0.0 * level, level, Mechanism.SLIDE),
            (x_out, level, shenton, Mechanism.SLIDE_ROCK),
            (x_out, shenton, top, Mechanism.ROCK),
        ):
            axes.fill_between(x, low, high, color=_SHADE[mechanism], linewidth=0.5)
        axes.plot(x_in, inside, **_BORDER)
        axes.plot([sign * pressed * tip] * 2, [tip, reach], **_BORDER)
        axes.plot(x_out, level, **_BORDER)
        axes.plot(x_out, shenton, **_BORDER)
        corner = "A" if sign > 0 else "B"
        middle = 0.5 * sign * (pressed * tip + reach)
        end = shenton[-1]
        _name(axes, middle, 0.5 * (end + reach), f"rock\nover {corner}")
        axes.text(
            0.98 * sign * reach, tip + 0.3 * (end - tip), "slide-rock", fontsize=7.0, va="center",
            ha="right" if sign > 0 else "left",
        )  # fmt: skip
        _name(axes, middle, 0.4 * tip, "slide")
    _name(axes, 0.0, 0.6 * reach, "rest")
    axes.set(xlim=(-reach, reach), ylim=(0.0, reach), xlabel="kₛ [g]", ylabel="μ [1]")
    axes.xaxis.set_major_locator(MaxNLocator(5))


def _regions_over_vertical(axes: Axes, block: RigidBlock, friction: float, reach: float) -> None:
    tip = block.reach_a / block.rise
    low, high = -1.4, 0.8
    lift = np.array([-1.0, high])
    onset = min(tip, friction)
    slips = sliding_load(block, CORNER_A, friction) if friction > tip else onset
    slips = min(slips, 1e3)
    other = Mechanism.SLIDE_ROCK if friction > tip else Mechanism.SLIDE
    axes.axhspan(low, -1.0, color=_SHADE[Mechanism.LIFT_OFF], linewidth=0)
    axes.fill_betweenx(
        lift, -onset * (1 + lift), onset * (1 + lift), color=_SHADE[Mechanism.REST], linewidth=0
    )
    for sign in (1.0, -1.0):
        corner = "A" if sign > 0 else "B"
        edges = [onset, slips, 1e3]
        for a, b, mechanism in zip(edges, edges[1:], (Mechanism.ROCK, other), strict=False):
            axes.fill_betweenx(
                lift, sign * a * (1 + lift), sign * b * (1 + lift), color=_SHADE[mechanism],
                linewidth=0,
            )  # fmt: skip
            if a < 1e3:
                axes.plot(sign * a * (1 + lift), lift, **_BORDER)
        if slips > onset:
            height = 0.25
            _name(axes, sign * 0.5 * (onset * (1 + height) + min(slips * (1 + height), reach)),
                  height, f"rock\nover {corner}")  # fmt: skip
        where = f"slide-rock\nover {corner}" if friction > tip else "slide"
        _name(axes, 0.74 * sign * reach, -0.72, where, 7.0)
    axes.axhline(-1.0, **_BORDER)
    _name(axes, 0.0, 0.4, "rest")
    _name(axes, 0.0, 0.5 * (low - 1.0), "lift-off")
    axes.set(xlim=(-reach, reach), ylim=(low, high), xlabel="kₛ [g]", ylabel="kᵥ [g]")
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.yaxis.set_major_locator(MaxNLocator(6))


def _name(axes: Axes, x: float, y: float, text: str, size: float = 8.0) -> None:
    axes.text(x, y, text, ha="center", va="center", fontsize=size, linespacing=1.1)


def _draw_block(axes: Axes, block: RigidBlock) -> None:
    a, height = block.reach_a, 2.0 * block.rise
    corners = np.array([[-a, 0.0], [a, 0.0], [a, height], [-a, height]])
    axes.add_patch(Polygon(corners, facecolor=_STONE, edgecolor=_EDGE, linewidth=0.9))
    axes.plot([-1.1, 1.1], [0.0, 0.0], color=canvas.GREY, lw=0.8, zorder=0)
    axes.plot(0.0, block.rise, "o", color=canvas.INK, ms=3.5)
    _name(axes, 0.07, block.rise + 0.04, "G")
    _name(axes, -a - 0.07, 0.07, "A")
    _name(axes, a + 0.07, 0.07, "B")
    _name(axes, 0.0, -0.09, "b")
    _name(axes, a + 0.09, 0.72 * height, "h")
    _arrow(axes, (-0.28, -0.2), (0.28, -0.2), canvas.INK)
    _name(axes, 0.42, -0.2, "kₛ g")
    _arrow(axes, (-0.85, 0.02), (-0.85, 0.36), canvas.INK)
    _name(axes, -0.85, 0.45, "kᵥ g")
    axes.set(xlim=(-1.15, 1.15), ylim=(-0.32, height + 0.08))
    axes.set_aspect("equal")
    axes.set_axis_off()


def reactions_in_cone(name: str) -> Picture:
    """Reactions of a block about corner A within Coulomb's cone, in plane pi (Eqs 15 to 20).

    Parameters
    ----------
    name : str
        Unique on the page.
    """
    b, h = _BLOCK
    block = uniform_block(b, h, 1.0)

    def draw(figure: Figure) -> None:
        panels = figure.subplots(2, 2)
        _balance(panels[0, 0], block, 0.0, 0.0, 0.5, "starts to rock")
        _balance(panels[0, 1], block, 0.15, 0.8, 0.55, "rocks on")
        _balance(panels[1, 0], block, 0.0, 0.0, 2.2, "starts to slide-rock")
        _split(panels[1, 1], block, 0.15, 1.0, -0.8, "slide-rocks on")

    return picture(
        name, (canvas.WIDTH, 6.8), draw,
        alternative="Four balances of a block about a corner, drawn in the plane of the "
        "generalised directions of its contact: starting to rock, rocking, starting to "
        "slide-rock, sliding",
        caption=f"Uniform block, b/h = {b / h:g}, μ = {_FRICTION:g}, in contact at corner A; "
        "vectors in plane π, with mass, weight and height one. Nₜ and Nₙ are not orthogonal in "
        "the metric of kinetic energy, so Coulomb’s cone (shaded, from N⁻ to N⁺) leans. Starting "
        "to rock, −S lies inside the cone and its components are the reactions Ψₜ and Ψₙ. In "
        "motion the centripetal part of ü is added to it. Starting to slide-rock, −S lies "
        "outside: the reaction Ψ is on the boundary with the same projection on Nₙ, and what is "
        "missing from it lets the corner accelerate opposite to Nₜ. While the corner slides, Nₜ "
        "is split along u̇, the part that slows the motion, and across it, the part in plane π; "
        "the friction is Rₜ Nₜ.",
    )  # fmt: skip


class _Plane:
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
    arm = formulas.corner_arm(block, CORNER_A, rotation)
    n_t, n_n = formulas.tangential_gradient(block, arm), formulas.normal_gradient(block, arm)
    turning = plane.rocking_mechanism(block, arm, 1.0)
    known = np.sum(
        plane.centripetal_acceleration(
            n_t, n_n, formulas.tangential_gradient_rate(block, arm, omega),
            formulas.normal_gradient_rate(block, arm, omega), formulas.scaled(omega, turning),
        ), axis=0,
    )  # fmt: skip
    force = -np.array(plane.part_in_plane(formulas.active_force(block, k_s, 0.0, 1.0), turning))
    now = corner_motion(block, CORNER_A, rotation, omega, 0.0, k_s, 0.0, _FRICTION, 1.0)
    psi_t, psi_n = formulas.generalised_reaction(n_t, n_n, now.tangential, now.normal)
    flat = _Plane(n_t, n_n)
    wanted, held = flat(force + known), flat(np.add(psi_t, psi_n))
    ends = (wanted, flat(force), flat(psi_t), flat(psi_n))
    reach = 1.2 * max(float(np.linalg.norm(end)) for end in ends)
    _cone(axes, flat, n_t, n_n, reach)
    if omega:
        _arrow(axes, (0, 0), flat(force), canvas.GREEN, "−S")
        _arrow(axes, flat(force), wanted, canvas.ORANGE, "centripetal", 0.5)
    else:
        _arrow(axes, (0, 0), wanted, canvas.GREEN, "−S")
    sliding = now.mechanism == Mechanism.SLIDE_ROCK
    for part, label, at in ((psi_t, "Ψₜ", -0.9), (psi_n, "Ψₙ", 0.9)):
        _arrow(axes, (0, 0), flat(part), canvas.BLUE, label, at)
        axes.plot(*np.transpose([flat(part), held]), color=canvas.BLUE, lw=0.7, ls=(0, (3, 2)))
    if sliding or omega:
        _arrow(axes, (0, 0), held, canvas.VERMILION, "Ψ", -0.45 if omega else 0.7)
    if sliding:
        _arrow(axes, held, wanted, canvas.PURPLE, "missing", 0.5)
    if omega:
        title += f", θ = {rotation:g}, ω²h/g = {omega**2:.2g}"
    axes.set_title(f"{title}, kₛ = {k_s:g}")
    _frame(axes)


def _cone(axes: Axes, flat: _Plane, n_t: _Vector, n_n: _Vector, reach: float) -> None:
    rays = [flat(ray) for ray in plane.cone_boundaries(n_t, n_n, _FRICTION)]
    ends = [float(np.degrees(np.arctan2(ray[1], ray[0]))) for ray in rays]
    axes.add_patch(
        Wedge((0.0, 0.0), reach, *ends, facecolor=_SHADE[Mechanism.ROCK], linewidth=0, zorder=0)
    )
    for ray, label in zip(rays, ("N⁺", "N⁻"), strict=True):
        tip = reach * ray / np.linalg.norm(ray)
        axes.plot([0.0, tip[0]], [0.0, tip[1]], color=canvas.SKY, lw=1.0, zorder=1)
        _grey(axes, 1.07 * tip, label)
    for vector, label in ((n_t, "Nₜ"), (n_n, "Nₙ")):
        tip = reach * flat(vector) / np.linalg.norm(vector)
        axes.plot([0.0, tip[0]], [0.0, tip[1]], color=canvas.GREY, lw=0.9, ls=(0, (5, 2)))
        _grey(axes, 1.07 * tip, label)


def _grey(axes: Axes, place: FloatArray, text: str) -> None:
    x, y = place
    axes.text(x, y, text, ha="center", va="center", color=canvas.GREY)


def _split(
    axes: Axes, block: RigidBlock, rotation: float, omega: float, slip: float, title: str
) -> None:
    """Fig 7: the tangential direction along a motion that slides, and across it."""
    arm = formulas.corner_arm(block, CORNER_A, rotation)
    n_t = formulas.tangential_gradient(block, arm)
    velocity = formulas.combine(
        1.0, plane.rocking_mechanism(block, arm, omega),
        1.0, formulas.generalised(block, slip, 0.0, 0.0),
    )  # fmt: skip
    across = plane.split_along(n_t, velocity)[1]
    now = corner_motion(block, CORNER_A, rotation, omega, slip, 0.3, 0.0, _FRICTION, 1.0)
    flat = _Plane(across, velocity)
    friction = formulas.scaled(now.tangential, n_t)
    _arrow(axes, (0, 0), flat(n_t), canvas.INK, "Nₜ")
    _arrow(axes, (0, 0), flat(across), canvas.BLUE, "in plane π", 0.6)
    _arrow(axes, flat(across), flat(n_t), canvas.PURPLE, "along u̇", 0.5)
    _arrow(axes, (0, 0), flat(friction), canvas.VERMILION, "Ψₜ = Rₜ Nₜ", -0.6)
    speed = flat(velocity) / np.linalg.norm(velocity)
    axes.plot([0.0, speed[0]], [0.0, speed[1]], color=canvas.GREY, lw=0.9, ls=(0, (5, 2)))
    _grey(axes, 1.08 * speed, "u̇")
    axes.axhline(0.0, color=canvas.SKY, lw=1.0, zorder=0)
    axes.set_title(f"{title}, θ = {rotation:g}, ω²h/g = {omega**2:.2g}")
    _frame(axes)


def _arrow(
    axes: Axes, start: ArrayLike, end: ArrayLike, colour: str, label: str = "", at: float = 1.0
) -> None:
    start, end = np.asarray(start, float), np.asarray(end, float)
    axes.annotate(
        "", xy=tuple(end), xytext=tuple(start),
        arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.3, "shrinkA": 0, "shrinkB": 0,
                    "mutation_scale": 8},
    )  # fmt: skip
    axes.update_datalim([start, end])
    if not label:
        return
    way = end - start
    place = start + abs(at) * way
    side = np.copysign(1.0, at) * np.array([-way[1], way[0]]) if abs(at) < 1.0 else way
    offset = 10.0 * side / max(float(np.linalg.norm(side)), 1e-12)
    axes.annotate(
        label, xy=tuple(place), xytext=tuple(offset), textcoords="offset points", color=colour,
        ha="center" if abs(offset[0]) < 5 else ("left" if offset[0] > 0 else "right"), va="center",
    )  # fmt: skip


def _frame(axes: Axes) -> None:
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.17)
    axes.autoscale_view()
    axes.set_axis_off()


def write_method_figures(folder: Path, slenderness: float = 0.4) -> list[Path]:
    """Write the figures of the method as SVG files.

    Parameters
    ----------
    folder : Path
        Made if it is not there.
    slenderness : float
        b/h of the block whose regions are drawn.

    Returns
    -------
    list of Path

    Raises
    ------
    InputError
        If the slenderness cannot be drawn.
    OutputError
        If the folder cannot be written.

    Examples
    --------
    >>> from pathlib import Path
    >>> from archfrag.report.block_figures import write_method_figures
    >>> [path.name for path in write_method_figures(Path("figures"))]
    ['block_regions.svg', 'block_reactions.svg']
    """
    if not 0.05 <= slenderness <= 5.0:
        raise InputError(f"slenderness is {slenderness:g}; b/h must be between 0.05 and 5")
    make_folder(folder)
    figures = {
        "block_regions": starting_regions(slenderness, "block-regions", 1.5 * slenderness),
        "block_reactions": reactions_in_cone("block-reactions"),
    }
    written = []
    for name, shown in figures.items():
        path = folder / f"{name}.svg"
        with replacing(path) as temporary:
            temporary.write_text(standalone(shown), encoding="utf-8")
        written.append(path)
    return written
