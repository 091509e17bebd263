"""What the page shows of a class of arches: its curve, its dispersion, and what theta follows."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from archfrag.fragility.curve import Fragility
from archfrag.report import curve_figures as curves
from archfrag.report import picture as look
from archfrag.report.filters import percent_of
from archfrag.report.inputs import ReportInputs
from archfrag.report.picture import BELOW, BESIDE, LINE, FloatArray, Picture
from archfrag.report.plot import Entry, Panel, Sheet, picture
from archfrag.report.summary import Scale
from archfrag.study.curves import Answer, arch_classes
from archfrag.study.fits import lost_text

MOST_PANELS, MOST_TEXTS = 9, 7
_HIGH = 150.0  # of a panel [px]


def class_section(inputs: ReportInputs, name: str, number: int, scale: Scale) -> dict[str, Any]:
    """Figures, tables and numbers of a class, by the names that the page's template uses."""
    of_class = arch_classes(inputs.cube)
    members = [inputs.answers[arch] for arch, own in of_class.items() if own == name]
    answer = inputs.classes[name]
    highest = scale.factor * float(inputs.cube["intensity"].max())
    differences = _differences(inputs.cube, np.array(list(of_class.values())) == name)
    return {
        "id": f"class{number}",
        "name": name,
        "n_arch": len(members),
        "answer": answer,
        "band": curves.band_words(answer),
        "lost": lost_text(answer, scale.text),
        "limit_states": curves.limit_states(answer, name, scale, highest),
        "curve": class_curve(answer, members, name, scale),
        "panels": theta_panels(members, differences, name, scale),
    }


def class_curve(answer: Answer, members: Sequence[Answer], name: str, scale: Scale) -> Picture:
    """Curve of a class with its band, over those of its arches."""
    thin = curves.thinned(members)
    ends = [scale.factor * each.im[-1] for each in (answer, *members) if each.im]
    entries = [Entry("arches of the class", curves.THIN, "line")]
    if isinstance(answer.curve, Fragility):
        percent = percent_of(answer.confidence)
        entries += curves.band_entries("an arch of the class", percent)

    def draw(panel: Panel) -> None:
        curves.draw_thin(panel, thin, scale, look.GREY)
        curves.draw_answer(panel, answer, scale, Entry("", look.BLUE, "line"))

    return curves.curve_picture(
        draw, entries, (max(ends, default=1.0), scale.label),
        alternative=f"Probability of collapse of an arch of the class {name} against "
        f"{scale.label}, and the curves of {len(thin)} of its arches",
    )  # fmt: skip


def _differences(cube: xr.Dataset, own: NDArray[np.bool_]) -> dict[str, NDArray]:
    """What the arches of a class differ by: numbers as floats, attributes as texts."""
    found: dict[str, NDArray] = {}
    for name in map(str, cube.data_vars):
        if name.startswith(("arch_", "attribute_")) and name != "arch_class":
            values = cube[name].values[own]
            values = values.astype(float if values.dtype.kind in "fiu" else str)
            if np.unique(values).size > 1:
                found[name.partition("_")[2].replace("_", " ")] = values
    return found


def _thetas(members: Sequence[Answer]) -> FloatArray:
    return np.array([np.nan if isinstance(a.curve, str) else a.curve.theta for a in members])


def theta_panels(
    members: Sequence[Answer], differences: Mapping[str, NDArray], name: str, scale: Scale
) -> Picture | None:
    """Theta of each arch against what the arches differ by, a panel for each; None if nothing."""
    theta = scale.factor * _thetas(members)
    known = np.isfinite(theta)
    shown = dict(list(differences.items())[:MOST_PANELS])
    if not shown or known.sum() < 2:
        return None
    theta = theta[known]
    margin = 0.05 * float(np.ptp(theta)) or 0.05 * float(theta[0])
    ends = float(theta.min()) - margin, float(theta.max()) + margin

    def draw(sheet: Sheet) -> None:
        columns = 1 if sheet.narrow else min(3, len(shown))
        each = (sheet.width - 10.0) / columns
        for i, (title, values) in enumerate(shown.items()):
            row, column = divmod(i, columns)
            top = row * (_HIGH + BELOW + LINE) + LINE
            box = (column * each + BESIDE, top, (column + 1) * each - 8.0, top + _HIGH)
            panel = Panel(sheet, box, (0.0, 1.0), ends)
            (_texts if values.dtype.kind == "U" else _numbers)(panel, values[known], theta)
            panel.axis_y(look.even_ticks(*ends), f"θ [{scale.unit}]", grid=True)
            panel.heading(look.shortened(title, each - BESIDE - 8.0))
        sheet.height = -(-len(shown) // columns) * (_HIGH + BELOW + LINE) + 4.0

    return picture(
        draw,
        alternative=f"Median capacities of {theta.size} arches of {name} against "
        f"{', '.join(shown)}",
    )


def _numbers(panel: Panel, values: NDArray, theta: FloatArray) -> None:
    there = np.isfinite(values)
    low, high = float(values[there].min()), float(values[there].max())
    margin = 0.04 * (high - low) or 1.0
    panel.x = (low - margin, high + margin)
    ticks = look.even_ticks(*panel.x, 4)
    labels = [f"{tick:g}" if abs(tick) < 1e6 else look.digits(tick) for tick in ticks]
    panel.axis_x(ticks, "", labels)
    panel.dots(values[there], theta[there], look.BLUE, radius=2.4)


def _texts(panel: Panel, texts: NDArray, theta: FloatArray) -> None:
    frequent = [text for text, _ in Counter(texts.tolist()).most_common()]
    kept = sorted(frequent[: MOST_TEXTS - (len(frequent) > MOST_TEXTS)])
    labels = kept + (["others"] if len(frequent) > len(kept) else [])
    place = np.array([kept.index(t) if t in kept else len(kept) for t in texts], dtype=float)
    panel.x = (-0.5, len(labels) - 0.5)
    width = (panel.box[2] - panel.box[0]) / len(labels) - 6.0
    words = [look.shortened(label or "not stated", width, look.SMALL) for label in labels]
    panel.axis_x(np.arange(len(labels)), "", words)
    for i in range(len(labels)):
        own = np.flatnonzero(place == i)
        middle = float(np.median(theta[own]))
        panel.line([i - 0.35, i + 0.35], [middle, middle], look.INK, 1.4)
        # Points of one text stand beside each other, in the order of the arches.
        place[own] += np.linspace(-0.25, 0.25, own.size) if own.size > 1 else 0.0
    panel.dots(place, theta, look.BLUE, radius=2.4)
