"""The log of a mechanism as a picture: which joints hinge, slide or are open, and when."""

from collections.abc import Sequence
from itertools import groupby

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from archfrag.arch import STANDARD_GRAVITY
from archfrag.mechanics.status import Model
from archfrag.report import canvas
from archfrag.report.canvas import Picture, faint_grid, picture
from archfrag.report.example import Example
from archfrag.report.ladder_figures import MODEL_LOOK
from archfrag.simulation.mechanism import MODEL_WORDS, MechanismChange

# What a joint may be seen doing; a sliding hinge is drawn as a hinge, hatched.
LOOK = {
    "hinge at intrados": (canvas.BLUE, ""),
    "hinge at extrados": (canvas.VERMILION, ""),
    "sliding hinge at intrados": (canvas.BLUE, "//////"),
    "sliding hinge at extrados": (canvas.VERMILION, "//////"),
    "slides": (canvas.ORANGE, "\\\\\\\\\\\\"),
    "open": (canvas.INK, ""),
}
_STATES = ("closed", *LOOK)
_BINS, _SAMPLES = 600, 8


def timeline(example: Example, name: str) -> Picture | None:
    """Ground motion, joints and model of the ladder over time; None if nothing moved.

    Parameters
    ----------
    example : Example
    name : str
        Unique on the page.
    """
    changes = example.response.mechanism or ()
    if not _moving(changes):
        return None
    start, end = window(changes, example.response.end_time)
    edges = np.linspace(start, end, _BINS + 1)
    joints, models = sampled(changes, example.arch.n_joint, edges)
    n_joint = example.arch.n_joint

    def draw(figure: Figure) -> None:
        height = max(1.4, min(0.17 * n_joint, 4.5))
        top, middle, bottom = figure.subplots(
            3, 1, sharex=True, height_ratios=[0.75, height, 0.16]
        )
        _ground(top, example, edges)
        top.set_title(_headline(example))
        for joint in range(n_joint):
            for state, low, high in runs(joints[:, joint]):
                if state:
                    _bar(middle, edges[low], edges[high], joint, LOOK[_STATES[state]])
        middle.set(ylim=(-0.6, n_joint - 0.4), ylabel="joint")
        middle.set_yticks(np.arange(0, n_joint, max(1, -(-n_joint // 15))))
        faint_grid(middle, "y")
        for model, low, high in runs(models):
            _bar(bottom, edges[low], edges[high], 0, MODEL_LOOK[Model(model)])
        bottom.set(ylim=(-0.4, 0.4), xlabel="time [s]", xlim=(start, end))
        bottom.set_yticks([0.0], ["model"])
        bottom.tick_params(axis="y", length=0)
        if example.response.collapsed:
            for axes in (top, middle):
                axes.axvline(
                    example.response.collapse_time, color=canvas.INK, lw=0.9, ls=(0, (4, 2))
                )
        handles = [_swatch(text, LOOK[text]) for k, text in enumerate(_STATES)
                   if k and np.any(joints == k)]  # fmt: skip
        handles += [
            _swatch(f"model: {MODEL_WORDS[Model(m)]}", MODEL_LOOK[Model(m)])
            for m in np.unique(models)
        ]
        figure.legend(handles=handles, loc="outside lower center", ncols=4, handlelength=1.6)

    return picture(
        name, (canvas.WIDTH, 2.1 + max(1.4, min(0.17 * n_joint, 4.5))), draw,
        alternative=f"Mechanism over time under {example.motion.id}: hinges, sliding and open "
        "joints, and the model of the ladder",
        caption=_caption(example, changes, edges),
    )  # fmt: skip


def window(changes: Sequence[MechanismChange], end_time: float) -> tuple[float, float]:
    """Time from just before the first motion to just after the last, or the end of the run [s]."""
    moving = _moving(changes)
    first = moving[0].time
    last = moving[-1].until if np.isfinite(moving[-1].until) else end_time
    margin = 0.03 * max(last - first, 1e-3)
    return max(0.0, first - margin), min(end_time, last + margin)


def sampled(
    changes: Sequence[MechanismChange], n_joint: int, edges: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """What lasted longest in each bin of time.

    Parameters
    ----------
    changes : sequence of MechanismChange
    n_joint : int
    edges : ndarray, (n_bin + 1,)
        Of the bins [s].

    Returns
    -------
    joints : ndarray of int, (n_bin, n_joint)
        0 for a closed joint, else 1 plus the position in `LOOK`.
    models : ndarray of int, (n_bin,)
        Codes of `Model`.
    """
    states = np.zeros((len(changes), n_joint), dtype=np.int64)
    for i, change in enumerate(changes):
        for joint, text in change.joints.items():
            states[i, joint] = state_of(text)
    models = np.array([Model[change.model.upper()] for change in changes], dtype=np.int64)
    inside = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    times = edges[:-1, None] + np.diff(edges)[:, None] * inside
    since = np.searchsorted([change.time for change in changes], times, side="right") - 1
    since = np.maximum(since, 0)
    return _longest(states[since], len(_STATES)), _longest(models[since], len(Model))


def state_of(text: str) -> int:
    """Position in the states of a joint's description in a `MechanismChange`."""
    if text.startswith("hinge"):
        sliding = "sliding " if "sliding" in text else ""
        return _STATES.index(f"{sliding}hinge at {text.split()[1]}")
    return _STATES.index("slides" if text.startswith("slides") else "open")


def runs(states: NDArray[np.int64]) -> list[tuple[int, int, int]]:
    """Stretches of equal state: state, first bin, bin after the last."""
    found, place = [], 0
    for state, members in groupby(states.tolist()):
        length = len(list(members))
        found.append((state, place, place + length))
        place += length
    return found


def _moving(changes: Sequence[MechanismChange]) -> list[MechanismChange]:
    """Entries that last, or last for a time not known, in another model than rest."""
    return [c for c in changes if c.model != "rest" and not c.until <= c.time]


def _longest(samples: NDArray[np.int64], n_state: int) -> NDArray[np.int64]:
    """Most frequent state along axis 1."""
    counts = np.stack([(samples == state).sum(axis=1) for state in range(n_state)])
    return counts.argmax(axis=0)


def _ground(axes: Axes, example: Example, edges: NDArray[np.float64]) -> None:
    acceleration = np.asarray(example.motion.acceleration) * example.factor / STANDARD_GRAVITY
    times = np.arange(acceleration.size) * example.motion.dt
    # Every sample and the value at every edge: the trace stays connected from bin to bin.
    at_edges = np.interp(edges, times, acceleration, right=0.0)
    low = np.minimum(at_edges[:-1], at_edges[1:])
    high = np.maximum(at_edges[:-1], at_edges[1:])
    bins = np.searchsorted(edges, times, side="right") - 1
    inside = (bins >= 0) & (bins < low.size)
    np.minimum.at(low, bins[inside], acceleration[inside])
    np.maximum.at(high, bins[inside], acceleration[inside])
    axes.fill_between(0.5 * (edges[:-1] + edges[1:]), low, high, color=canvas.GREY, linewidth=0.5)
    axes.set_ylabel("ground [g]")
    faint_grid(axes, "y")


def _bar(axes: Axes, low: float, high: float, row: int, look: tuple[str, str]) -> None:
    axes.broken_barh(
        [(low, high - low)], (row - 0.4, 0.8), facecolor=look[0], hatch=look[1],
        edgecolor="white" if look[1] else "none", linewidth=0.0,
    )  # fmt: skip


def _swatch(label: str, look: tuple[str, str]) -> Patch:
    return Patch(label=label, facecolor=look[0], hatch=look[1], edgecolor="white", linewidth=0.0)


def _headline(example: Example) -> str:
    response = example.response
    if response.collapsed:
        return (
            f"{example.level}: contact lost at {response.collapse_time:.2f} s, joint "
            f"{response.collapse_joint}"
        )
    return f"{example.level}: {response.status.name.lower().replace('_', ' ')}"


def _caption(
    example: Example, changes: Sequence[MechanismChange], edges: NDArray[np.float64]
) -> str:
    width = float(edges[1] - edges[0])
    times = np.array([change.time for change in changes])
    brief = np.count_nonzero(np.diff(times) < width)
    text = (
        f"Log of the mechanism under {example.motion.id} at {example.level}, {example.reason}. "
        "Joint 0 is the left springing, or the base of a free-standing chain; joints without a "
        "bar are closed and stick."
    )
    if example.response.collapsed:
        text += " Dashed: contact lost for good."
    if brief:
        text += (
            f" {brief} of {len(changes)} states last less than the {1e3 * width:.2g} ms of a "
            "column of the figure, which shows what lasted longest in it."
        )
    if not example.same:
        text += (
            " This repetition did not end as the run in the cube did: versions or machine differ "
            "from those that made the cube."
        )
    return text
