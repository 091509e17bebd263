"""Classes of arches: curves of their members and of the whole, and theta against what differs."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike, NDArray

from archfrag.report import canvas
from archfrag.report.canvas import Picture, faint_grid, legend_above, picture

FloatArray = NDArray[np.float64]
COLOURS = (canvas.BLUE, canvas.VERMILION, canvas.GREEN, canvas.ORANGE, canvas.PURPLE, canvas.SKY)
STROKES = ("-", (0, (5, 2)), (0, (1, 1.2)))
# Beyond them a figure is too heavy for a page, or too full to be read.
MOST_MEMBERS, MOST_POINTS, MOST_PANELS, MOST_TEXTS = 60, 80, 9, 7
_PANEL = 2.4  # least width of a panel [inch]
_LONGEST = 16  # characters of a text below an axis


@dataclass(frozen=True)
class ClassLines:
    """What is drawn of a class.

    Attributes
    ----------
    label : str
    curves : (n_arch, n_im) ndarray
        Probabilities of its arches; nan where one has none.
    mean : (n_im,) ndarray
        Probability of the class.
    low, high : (n_im,) ndarray or None
        Quantiles over its arches.
    """

    label: str
    curves: FloatArray
    mean: FloatArray
    low: FloatArray | None = None
    high: FloatArray | None = None


def class_curves(
    lines: Sequence[ClassLines],
    im: ArrayLike,
    *,
    name: str,
    axis_label: str,
    between: str = "5 and 95 %",
    width: float = canvas.WIDTH,
) -> Picture:
    """Curves of classes, of one or many arches each, in one figure.

    Parameters
    ----------
    lines : sequence of ClassLines
        One for each class; thin lines for its arches where it has several.
    im : (n_im,) array_like
        Intensities in the reader's unit.
    name : str
        Unique on the page.
    axis_label : str
        Measure and unit.
    between : str
        Which quantiles `low` and `high` are.
    width : float
        Of the figure [inch].
    """
    im = np.asarray(im, dtype=float)
    some = np.unique(np.linspace(0, im.size - 1, min(im.size, MOST_POINTS)).astype(int))

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for i, shown in enumerate(lines):
            colour = COLOURS[i % len(COLOURS)]
            stroke = STROKES[i // len(COLOURS) % len(STROKES)]
            chosen = _chosen(shown.curves)
            if len(chosen) > 1:
                axes.plot(*_in_one(im[some], chosen[:, some]), color=colour, lw=0.5, alpha=0.35)
            if shown.low is not None and shown.high is not None:
                axes.fill_between(im, shown.low, shown.high, color=colour, alpha=0.15, linewidth=0)
            axes.plot(im, shown.mean, color=colour, lw=2.0, ls=stroke, label=shown.label)
        axes.set(
            xlim=(float(im[0]), float(im[-1])), ylim=(-0.02, 1.02), xlabel=axis_label,
            ylabel="probability of collapse [1]",
        )  # fmt: skip
        faint_grid(axes)
        legend_above(axes, columns=max(1, int(width / 1.8)))

    labels = ", ".join(shown.label for shown in lines)
    caption = "Thick: probability of collapse of an arch of the class, the mean over its arches."
    most = max((len(shown.curves) for shown in lines), default=0)
    if most > 1:
        caption += " Thin: its arches" + (
            f", {MOST_MEMBERS} of them from the weakest to the strongest."
            if most > MOST_MEMBERS
            else "."
        )
    if any(shown.low is not None for shown in lines):
        caption += f" Shaded: between {between} of the class's arches at each intensity."
    return picture(
        name, (width, 3.7), draw,
        alternative=f"Probability of collapse against {axis_label} of {labels}",
        caption=caption,
    )  # fmt: skip


def _chosen(curves: FloatArray) -> FloatArray:
    """Curves that are drawn: evenly from the weakest arch to the strongest."""
    known = curves[~np.isnan(curves).any(axis=1)]
    if len(known) <= MOST_MEMBERS:
        return known
    order = np.argsort(known.mean(axis=1), kind="stable")
    return known[order[np.linspace(0, len(known) - 1, MOST_MEMBERS).astype(int)]]


def _in_one(x: FloatArray, curves: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Curves as one line with gaps: one element of the page for all."""
    gap = np.full((len(curves), 1), np.nan)
    every = np.hstack([np.broadcast_to(x, curves.shape), gap])
    return every.ravel(), np.hstack([curves, gap]).ravel()


def theta_panels(
    theta: ArrayLike,
    panels: Mapping[str, Sequence[float] | Sequence[str] | FloatArray],
    *,
    name: str,
    theta_label: str,
    classes: Sequence[str] | None = None,
    notes: Mapping[str, str] | None = None,
    width: float = canvas.WIDTH,
) -> Picture:
    """Theta of each arch against what the arches differ by, a panel for each.

    Parameters
    ----------
    theta : (n_arch,) array_like
        In the reader's unit; nan: no curve.
    panels : mapping of str to (n_arch,) sequence
        Numbers (nan where an arch has none) or texts; the first `MOST_PANELS` are drawn.
    name : str
        Unique on the page.
    theta_label : str
        With the unit.
    classes : (n_arch,) sequence of str, optional
        Told apart by colour.
    notes : mapping, optional
        Beside the names of panels, such as a rank correlation.
    width : float
        Of the figure [inch].
    """
    theta = np.asarray(theta, dtype=float)
    groups = np.array(["arches"] * theta.size if classes is None else list(classes))
    shown = dict(list(panels.items())[:MOST_PANELS])
    columns = max(1, min(len(shown), int(width / _PANEL)))
    rows = -(-len(shown) // columns)

    def draw(figure: Figure) -> None:
        grid = figure.subplots(rows, columns, squeeze=False, sharey=True)
        for axes in grid.ravel()[len(shown) :]:
            axes.set_visible(False)
        for i, (axes, (parameter, values)) in enumerate(zip(grid.ravel(), shown.items())):
            _panel(axes, np.asarray(values), theta, groups)
            note = (notes or {}).get(parameter, "")
            axes.set_xlabel(f"{parameter}\n{note}" if note else parameter)
            if i % columns == 0:
                axes.set_ylabel(theta_label)
            faint_grid(axes)
        if classes is not None and len(dict.fromkeys(groups)) > 1:
            legend_above(grid[0, 0], columns=max(1, int(width / 1.8)))

    return picture(
        name, (width, 0.3 + 2.3 * rows), draw,
        alternative=f"{theta_label} of {theta.size} arches against {', '.join(shown)}",
        caption="Points: median capacities of the arches, against what they differ by."
        + (" Bars: median of each group." if any(map(_is_text, shown.values())) else ""),
    )  # fmt: skip


def numbers_or_texts(texts: Sequence[str]) -> Sequence[str] | FloatArray:
    """Attributes as numbers (nan where empty) if all that are given are, such as years."""
    try:
        numbers = np.array([float(text) if text else np.nan for text in texts])
    except ValueError:
        return texts
    return texts if np.isnan(numbers).all() or np.isinf(numbers).any() else numbers


def _is_text(values: Sequence[float] | Sequence[str] | FloatArray) -> bool:
    return np.asarray(values).dtype.kind in "US"


def _panel(axes: Axes, values: NDArray, theta: FloatArray, groups: NDArray) -> None:
    names = list(dict.fromkeys(groups))
    if _is_text(values):
        frequent = [text for text, _ in Counter(values.tolist()).most_common()]
        kept = sorted(frequent[: MOST_TEXTS - (len(frequent) > MOST_TEXTS)])
        texts = kept + (["others"] if len(frequent) > len(kept) else [])
        place = np.array([kept.index(v) if v in kept else len(kept) for v in values], dtype=float)
        for i in range(len(texts)):
            own = theta[(place == i) & np.isfinite(theta)]
            if own.size:
                axes.plot([i - 0.35, i + 0.35], [np.median(own)] * 2, color=canvas.INK, lw=1.4)
        # Points of one text stand beside each other, in the order of the arches.
        for i in range(len(texts)):
            own = np.flatnonzero(place == i)
            place[own] += np.linspace(-0.25, 0.25, own.size) if own.size > 1 else 0.0
        labels = [_short(text) for text in texts]
        upright = sum(map(len, labels)) > 18
        axes.set_xticks(range(len(texts)), labels, rotation=90 if upright else 0)
        values = place
    else:
        axes.xaxis.set_major_locator(MaxNLocator(4))
    for i, group in enumerate(names):
        own = groups == group
        axes.plot(
            values[own], theta[own], "o", color=COLOURS[i % len(COLOURS)], markersize=3.0,
            alpha=0.7, markeredgewidth=0, label=str(group),
        )  # fmt: skip


def _short(text: str) -> str:
    if not text:
        return "not stated"
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 1]}…"
