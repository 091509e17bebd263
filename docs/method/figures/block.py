"""The single block: which motion starts, the laws of its contact, impacts, free rocking."""

from typing import Any

import numpy as np
from figures.cone import BLOCK, FRICTION
from figures.drawing import (
    BLUE,
    EDGE,
    GREY,
    HTML,
    INK,
    PALE,
    SKY,
    STONE,
    VERMILION,
    arrow,
    name,
    sheet,
    shown,
)
from matplotlib.axes import Axes
from matplotlib.patches import Polygon
from matplotlib.ticker import MaxNLocator

import archfrag as af
from archbench.paper.block import (
    CORNER_A,
    Mechanism,
    RigidBlock,
    rocking_impact,
    starting_motion,
    uniform_block,
)
from archbench.paper.regions import impact_ratio, rocking_friction, sliding_load

_SHADE = {
    Mechanism.REST: "#eef1f4",
    Mechanism.SLIDE: "#fbe6bd",
    Mechanism.SLIDE_ROCK: "#f6cbb0",
    Mechanism.ROCK: "#cfe3f1",
    Mechanism.LIFT_OFF: "#dcd3e6",
}
_BORDER: dict[str, Any] = {"color": INK, "lw": 1.1}


def starting_regions(slenderness: float = 0.4, ground_y: float = -0.4) -> HTML:
    """Which motion starts from rest, over k_s and mu, and over k_s and k_v."""
    block, friction = uniform_block(slenderness, 1.0, 1.0), 1.5 * slenderness
    figure = sheet(7.4, 5.9)
    (first, second), (third, sketch) = figure.subplots(2, 2)
    reach = 2.5 * slenderness
    for axes, lift in ((first, 0.0), (second, ground_y)):
        _regions_over_friction(axes, block, lift, reach)
        axes.set_title(f"kᵥ = {lift:g}".replace("-", "−"))
    _regions_over_vertical(third, block, friction, reach)
    third.set_title(f"μ = {friction:g}")
    _draw_block(sketch, block)
    return shown(
        figure,
        f"Regions of starting motion of a block with b/h = {slenderness:g}: rest, slide, rock, "
        "slide-rock and lift-off, by ground acceleration and friction",
        "Fig 1: the block. "
        f"Motion that starts from rest, uniform block with b/h = {slenderness:g}; kₛ and kᵥ are "
        "the accelerations of the ground in g, to the right and upwards. Borders: rest and slide "
        "|kₛ| = μ (1 + kᵥ); rest and rock |kₛ| = (b/h)(1 + kᵥ); slide and slide-rock μ = b/h; the "
        "curved border of slide-rock and rock is Shenton’s condition; lift-off below kᵥ = −1.",
    )


def _regions_over_friction(axes: Axes, block: RigidBlock, ground_y: float, reach: float) -> None:
    upward = 1.0 + ground_y
    tip = block.reach_a / block.rise
    load = np.unique(np.append(np.linspace(0.0, reach / upward, 301), tip))
    beyond = load[load >= tip]
    shenton = np.array([rocking_friction(block, CORNER_A, q) for q in beyond])
    inside = load[load <= tip]
    for sign in (1.0, -1.0):
        x_in, x_out = sign * upward * inside, sign * upward * beyond
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
        axes.plot([sign * upward * tip] * 2, [tip, reach], **_BORDER)
        axes.plot(x_out, level, **_BORDER)
        axes.plot(x_out, shenton, **_BORDER)
        corner = "A" if sign > 0 else "B"
        middle = 0.5 * sign * (upward * tip + reach)
        end = shenton[-1]
        name(axes, middle, 0.5 * (end + reach), f"rock\nover {corner}")
        axes.text(
            0.98 * sign * reach, tip + 0.3 * (end - tip), "slide-rock", fontsize=7.0, va="center",
            ha="right" if sign > 0 else "left",
        )  # fmt: skip
        name(axes, middle, 0.4 * tip, "slide")
    name(axes, 0.0, 0.6 * reach, "rest")
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
            name(axes, sign * 0.5 * (onset * (1 + height) + min(slips * (1 + height), reach)),
                  height, f"rock\nover {corner}")  # fmt: skip
        where = f"slide-rock\nover {corner}" if friction > tip else "slide"
        name(axes, 0.74 * sign * reach, -0.72, where)
    axes.axhline(-1.0, **_BORDER)
    name(axes, 0.0, 0.4, "rest")
    name(axes, 0.0, 0.5 * (low - 1.0), "lift-off")
    axes.set(xlim=(-reach, reach), ylim=(low, high), xlabel="kₛ [g]", ylabel="kᵥ [g]")
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.yaxis.set_major_locator(MaxNLocator(6))


def _draw_block(axes: Axes, block: RigidBlock) -> None:
    a, height = block.reach_a, 2.0 * block.rise
    corners = np.array([[-a, 0.0], [a, 0.0], [a, height], [-a, height]])
    axes.add_patch(Polygon(corners, facecolor=STONE, edgecolor=EDGE, linewidth=0.9))
    axes.plot([-1.1, 1.1], [0.0, 0.0], color=GREY, lw=0.8, zorder=0)
    axes.plot(0.0, block.rise, "o", color=INK, ms=3.5)
    name(axes, 0.07, block.rise + 0.04, "G")
    name(axes, -a - 0.07, 0.07, "A")
    name(axes, a + 0.07, 0.07, "B")
    name(axes, 0.0, -0.09, "b")
    name(axes, a + 0.09, 0.72 * height, "h")
    arrow(axes, (-0.28, -0.2), (0.28, -0.2), INK)
    name(axes, 0.42, -0.2, "kₛ g")
    arrow(axes, (-0.85, 0.02), (-0.85, 0.36), INK)
    name(axes, -0.85, 0.45, "kᵥ g")
    axes.set(xlim=(-1.15, 1.15), ylim=(-0.32, height + 0.08))
    axes.set_aspect("equal")
    axes.set_axis_off()


def laws() -> HTML:
    """Signorini's and Coulomb's laws, traced by motions that start from rest (Figs 2 and 3)."""
    block, figure = uniform_block(2.0, 1.0, 1.0), sheet(7.4, 2.7)
    normal, tangential = figure.subplots(1, 2)
    lifts = np.linspace(-1.6, 0.6, 23)
    starts = [starting_motion(block, 0.0, lift, FRICTION, 1.0) for lift in lifts]
    rates = [max(start.y, 0.0) for start in starts]
    normal.plot(rates, [start.normal for start in starts], "o", color=BLUE, ms=4)
    normal.set(xlabel="normal acceleration of the base [g]", ylabel="Rₙ [weight]")
    loads = np.linspace(-1.2, 1.2, 25)
    starts = [starting_motion(block, load, 0.0, FRICTION, 1.0) for load in loads]
    slips = [start.slip for start in starts]
    ratios = [start.tangential / start.normal for start in starts]
    tangential.plot(slips, ratios, "o", color=BLUE, ms=4)
    tangential.axhline(FRICTION, color=PALE, lw=0.8)
    tangential.axhline(-FRICTION, color=PALE, lw=0.8)
    tangential.set(xlabel="tangential acceleration of the base [g]", ylabel="Rₜ / Rₙ")
    return shown(
        figure,
        "Two graphs: normal reaction over lift-off, tangential reaction over slip",
        "Figs 2 and 3. "
        f"Reactions and accelerations of a squat block (b/h = 2, μ = {FRICTION:g}) under "
        "vertical (left) and horizontal (right) ground accelerations: each point is one solution.",
    )  # fmt: skip


def contact_centre() -> HTML:
    """Contact centre e of Eq 14 over the horizontal ground acceleration."""
    b, h = BLOCK
    block, figure = uniform_block(b, h, 1.0), sheet(7.4, 2.6)
    axes = figure.subplots()
    loads = np.linspace(-0.9, 0.9, 181)
    for friction, colour in ((0.8, BLUE), (0.2, VERMILION)):
        centres = [starting_motion(block, k, 0.0, friction, 1.0).centre for k in loads]
        axes.plot(loads, centres, color=colour, label=f"μ = {friction:g}")
    axes.set(xlabel="kₛ [g]", ylabel="e", ylim=(-0.05, 1.05))
    axes.legend()
    return shown(
        figure, "Contact centre over ground acceleration, for two frictions",
        f"Where the reaction acts on the base: e = 0 at A, 1 at B; b/h = {b / h:g}. It reaches a "
        "corner at |kₛ| = b/h and stays there; a block that slides keeps it inside.",
    )  # fmt: skip


def impacts() -> HTML:
    """Angular velocity after over before an impact (Eq 21), by slenderness and friction."""
    figure = sheet(7.4, 2.8)
    axes = figure.subplots()
    slopes = np.linspace(0.02, 1.6, 120)
    blocks = [uniform_block(slope, 1.0, 1.0) for slope in slopes]
    for friction, colour in ((np.inf, INK), (0.3, BLUE), (0.15, VERMILION)):
        after = [rocking_impact(block, CORNER_A, -1.0, 0.0, friction) for block in blocks]
        label = "does not slide" if np.isinf(friction) else f"μ = {friction:g}"
        axes.plot(slopes, [-found.rotation for found in after], color=colour, label=label)
    ratio = [impact_ratio(block, CORNER_A) for block in blocks]
    axes.plot(slopes, ratio, ":", color=GREY, label="1 − 1.5 sin²α (Housner)")
    axes.set(xlabel="b/h", ylabel="velocity ratio", ylim=(-0.1, 1.05))
    axes.legend()
    return shown(
        figure, "Ratio of angular velocities at an impact over slenderness, three frictions",
        "Above b/h = √2 Housner’s ratio is negative: both corners press and the block stays flat. "
        "Little friction lets the corner slide and takes less of the rotation.",
    )  # fmt: skip


def phase_portrait() -> HTML:
    """Free rocking: rotation and angular velocity, with the jumps at impacts."""
    figure = sheet(7.4, 3.2)
    axes = figure.subplots()
    width, height = 0.4, 2.0
    alpha = np.arctan(width / height)
    for part, colour in ((0.3, SKY), (0.6, BLUE), (0.9, INK)):
        tilt = part * alpha
        x = 0.5 * (width * (1.0 - np.cos(tilt)) + height * np.sin(tilt))
        y = 0.5 * (width * np.sin(tilt) - height * (1.0 - np.cos(tilt)))
        state = (np.array([[x, y, -tilt]]), np.zeros((1, 3)))
        history = af.simulate(
            af.Block(width, height, friction=2.0), af.Motion(np.zeros(400), 0.01), initial=state,
            method="event_driven", rtol=1e-6, history=True,
        ).history  # fmt: skip
        angle, rate = history.rotation.values[:, 0], history.angular_velocity.values[:, 0]
        axes.plot(angle / alpha, rate, color=colour, label=f"from {part:g} α")
    axes.set(xlabel="rotation / α", ylabel="angular velocity [rad/s]")
    axes.legend(loc="upper right")
    return shown(
        figure, "Phase portrait of a block that rocks freely from three angles",
        "Free rocking of a block of 0.4 m by 2 m. Each impact at zero rotation takes the same "
        "part of the rate, and the motion ends in a finite time after infinitely many.",
    )  # fmt: skip
