"""What the page says of a class of arches: its curve, its dispersion, and what theta follows."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from archfrag.fragility.curve import Fragility
from archfrag.report import picture as look
from archfrag.report import tables
from archfrag.report.axes import BELOW, BESIDE, axis_x, axis_y, even_ticks, heading
from archfrag.report.curve_figures import (
    MOST_THIN,
    PROBABILITY,
    curve_axes,
    draw_answer,
    draw_thin,
    stated,
    thinned,
)
from archfrag.report.picture import Picture
from archfrag.report.plot import (
    LINE,
    SMALL,
    Entry,
    FloatArray,
    Panel,
    Sheet,
    picture,
    shortened,
)
from archfrag.report.summary import Scale, digits
from archfrag.report.tables import Table

if TYPE_CHECKING:
    import xarray as xr

    from archfrag.report.page import ReportInputs
    from archfrag.study.curves import Answer

MOST_PANELS, MOST_TEXTS = 9, 7
_HIGH = 150.0  # of a panel [px]
_PARTS = {
    "beta_record_to_record": "from record to record",
    "beta_model": "between the arches of the class",
    "beta_numerical": "numerical",
    "combined": "of both together",
}


def class_section(
    inputs: "ReportInputs", cube: "xr.Dataset", name: str, number: int, scale: Scale
) -> dict[str, Any]:
    """Figures, tables and numbers of a class, by the names that the page's template uses."""
    places = np.flatnonzero(cube["arch_class"].values.astype(str) == name)
    names = cube["arch"].values.astype(str)[places]
    members = [inputs.answers[str(each)] for each in names]
    answer = inputs.classes[name]
    split = answer.more.get("dispersion", {})
    return {
        "id": f"class{number}",
        "name": name,
        "n_arch": len(members),
        "answer": tables.answer(answer, scale),
        "curve": class_curve(answer, members, name, scale),
        "dispersion": split.get("message") or split.get("none", ""),
        "dispersion_table": _dispersion(split),
        "panels": theta_panels(members, _differences(cube, places), name, scale),
    }


def class_curve(answer: "Answer", members: Sequence["Answer"], name: str, scale: Scale) -> Picture:
    """Curve of a class with its band, over those of its arches."""
    thin = thinned(members)
    ends = [scale.factor * each.im[-1] for each in (answer, *members) if each.im]
    reach = max(ends, default=1.0)
    percent = f"{100 * answer.confidence:.0f} %"
    entries = [Entry("arches of the class", "#b5bec8", "line")]
    if isinstance(answer.curve, Fragility):
        entries += [
            Entry("an arch of the class", look.BLUE, "line"), Entry(f"{percent} band", "#c9e3f5"),
        ]  # fmt: skip

    def draw(width: float) -> Sheet:
        sheet = Sheet(width)
        top = sheet.legend(BESIDE, 0.0, entries, width - BESIDE - 10.0) + 6.0
        panel = curve_axes(sheet, top, reach, scale.label, PROBABILITY)
        draw_thin(panel, thin, scale, look.GREY)
        draw_answer(panel, answer, scale, look.BLUE)
        return sheet

    which = f", {MOST_THIN} of them from the weakest to the strongest" if (
        len(members) > MOST_THIN
    ) else ""  # fmt: skip
    band = (
        f" Shaded: pointwise band, {answer.method}. {stated(answer.assumptions)}"
        if answer.method
        else ""
    )
    return picture(
        draw,
        alternative=f"Probability of collapse of an arch of the class {name} against "
        f"{scale.label}, and the curves of {len(thin)} of its arches",
        caption="Bold: probability of collapse of an arch of the class of which nothing more is "
        f"known, so that both records and arches differ. Thin: its arches{which}.{band}",
    )


def _dispersion(split: Mapping[str, Any]) -> Table | None:
    rows = [
        [words, f"{float(split[key]):.3f}"]
        for key, words in _PARTS.items()
        if key in split and (key != "beta_numerical" or float(split[key]) > 0.0)
    ]
    return Table(["dispersion β", "value"], rows) if rows else None


def _differences(cube: "xr.Dataset", places: NDArray) -> dict[str, NDArray]:
    """What the arches of a class differ by: numbers as floats, attributes as texts."""
    found: dict[str, NDArray] = {}
    for name in map(str, cube.data_vars):
        if name.startswith(("arch_", "attribute_")) and name != "arch_class":
            values = cube[name].values[places]
            if values.dtype.kind not in "fiu":
                values = values.astype(str)
            if np.unique(values).size > 1:
                found[name.partition("_")[2].replace("_", " ")] = values
    return found


def theta_panels(
    members: Sequence["Answer"], differences: Mapping[str, NDArray], name: str, scale: Scale
) -> Picture | None:
    """Theta of each arch against what the arches differ by, a panel for each; None if nothing."""
    theta = np.array(
        [np.nan if isinstance(a.curve, str) else a.curve.theta * scale.factor for a in members]
    )
    known = np.isfinite(theta)
    shown = dict(list(differences.items())[:MOST_PANELS])
    if not shown or known.sum() < 2:
        return None
    margin = 0.05 * float(np.ptp(theta[known])) or 0.05 * float(theta[known][0])
    ends = float(theta[known].min()) - margin, float(theta[known].max()) + margin

    def draw(width: float) -> Sheet:
        sheet = Sheet(width)
        columns = 1 if sheet.narrow else min(3, len(shown))
        each = (width - 10.0) / columns
        for i, (title, values) in enumerate(shown.items()):
            row, column = divmod(i, columns)
            left = column * each + BESIDE
            top = row * (_HIGH + BELOW + LINE) + LINE
            box = (left, top, column * each + each - 8.0, top + _HIGH)
            if values.dtype.kind in "US":
                _texts(sheet, box, ends, (values[known], theta[known]))
            else:
                _numbers(sheet, box, ends, (values[known].astype(float), theta[known]))
            panel = sheet.panels[-1]
            axis_y(panel, even_ticks(*ends), f"θ [{scale.unit}]", grid=True)
            heading(panel, shortened(title, each - BESIDE - 8.0))
        sheet.height = -(-len(shown) // columns) * (_HIGH + BELOW + LINE) + 4.0
        return sheet

    grouped = any(values.dtype.kind in "US" for values in shown.values())
    ranks = "; ".join(
        f"{title} {_rank_correlation(values[known].astype(float), theta[known]):+.2f}"
        for title, values in shown.items()
        if values.dtype.kind not in "US"
    ).replace("-", "−")
    return picture(
        draw,
        alternative=f"Median capacities of {int(known.sum())} arches of {name} against "
        f"{', '.join(shown)}",
        caption="Points: median capacities of the arches of the class against what they differ "
        "by."
        + (f" Rank correlation (Spearman): {ranks}." if ranks else "")
        + (" Bars: medians of groups." if grouped else ""),
    )  # fmt: skip


def _numbers(
    sheet: Sheet,
    box: tuple[float, float, float, float],
    ends: tuple[float, float],
    points: tuple[FloatArray, FloatArray],
) -> None:
    values, theta = points
    there = np.isfinite(values)
    low, high = (float(end(values[there])) for end in (np.min, np.max))
    margin = 0.04 * (high - low) or 1.0
    panel = Panel(sheet, box, (low - margin, high + margin), ends)
    ticks = even_ticks(*panel.x, 4)
    axis_x(panel, ticks, "", [digits_of(tick) for tick in ticks])
    panel.dots(values[there], theta[there], look.BLUE, radius=2.4)


def digits_of(value: float) -> str:
    """A tick of a parameter: short, never as a power of ten where it is of usual size."""
    return f"{value:g}" if abs(value) < 1e6 else digits(value)


def _texts(
    sheet: Sheet,
    box: tuple[float, float, float, float],
    ends: tuple[float, float],
    points: tuple[NDArray, FloatArray],
) -> None:
    texts, theta = points
    frequent = [text for text, _ in Counter(texts.tolist()).most_common()]
    kept = sorted(frequent[: MOST_TEXTS - (len(frequent) > MOST_TEXTS)])
    labels = kept + (["others"] if len(frequent) > len(kept) else [])
    place = np.array([kept.index(t) if t in kept else len(kept) for t in texts], dtype=float)
    panel = Panel(sheet, box, (-0.5, len(labels) - 0.5), ends)
    width = (box[2] - box[0]) / len(labels)
    words = [shortened(label or "not stated", width - 6.0, SMALL) for label in labels]
    axis_x(panel, np.arange(len(labels)), "", words)
    for i in range(len(labels)):
        own = np.flatnonzero(place == i)
        middle = float(np.median(theta[own]))
        panel.line([i - 0.35, i + 0.35], [middle, middle], look.INK, 1.4)
        # Points of one text stand beside each other, in the order of the arches.
        place[own] += np.linspace(-0.25, 0.25, own.size) if own.size > 1 else 0.0
    panel.dots(place, theta, look.BLUE, radius=2.4)


def _rank_correlation(one: FloatArray, other: FloatArray) -> float:
    there = np.isfinite(one)
    if there.sum() < 3 or np.ptp(one[there]) == 0.0 or np.ptp(other[there]) == 0.0:
        return float("nan")
    ranks = [_ranks(values[there]) for values in (one, other)]
    return float(np.asarray(np.corrcoef(np.stack(ranks)))[0, 1])


def _ranks(values: FloatArray) -> FloatArray:
    """Ranks, the mean one for equal values."""
    _, place, count = np.unique(values, return_inverse=True, return_counts=True)
    return np.asarray((np.cumsum(count) - 0.5 * (count - 1))[place], dtype=float)
