"""Figures of how far arches move: IDA curves, where they fall apart, what theta depends on."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from archfrag.arch import Arch
from archfrag.fragility.counts import Verdict
from archfrag.fragility.quoted import Answer
from archfrag.report import drawing as look
from archfrag.report.arch import arch_panel
from archfrag.report.drawing import Entry, FloatArray, Panel, Sheet, figure
from archfrag.report.inputs import ArchResults, Scale

_FRACTILES = (0.16, 0.5, 0.84)
MEASURED = {"peak_rotation": "peak rotation [°]", "residual_rotation": "residual rotation [°]"}
_MOST_BARS = 10


@figure
def ida_curves(sheet: Sheet, results: ArchResults) -> str | None:
    """Peak and residual rotation of each record against intensity; None without standing runs.

    A record ends in a flat line at its capacity.
    """
    if results.own_levels is not None or not (results.verdict == Verdict.STANDING).any():
        return None
    entries = [
        Entry("a record", look.GREY, "line"), Entry("median", look.BLUE, "line"),
        Entry("16 and 84 %", look.BLUE, "dash"),
    ]  # fmt: skip
    top = sheet.legend(look.LEFT, 0.0, entries)
    boxes = sheet.grid(len(MEASURED), 2, 260.0, look.BELOW)
    sheet.height += top
    for (name, title), (left, up, right, down) in zip(MEASURED.items(), boxes):
        curves = demand(results, name)
        shown = np.where(np.isfinite(curves), curves, np.nan)
        reach = 1.15 * float(np.nanmax(shown, initial=1e-6))
        box, highest = (left, up + top, right, down + top), 1.05 * float(results.levels.max())
        panel = Panel(sheet, box, (0.0, reach), (0.0, highest))
        panel.axis_x(look.even_ticks(0.0, reach, 5), title, grid=True)
        panel.axis_y(look.even_ticks(0.0, highest), results.scale.label)
        for row, capacity in zip(curves, results.capacities.tolist()):
            panel.line(*ida_line(results.levels, row, capacity, reach), look.GREY, 0.7)
        for part, (row, end) in zip(_FRACTILES, fractiles(curves, results.capacities)):
            width, dash = (2.0, "") if part == 0.5 else (1.3, "5 2.5")
            panel.line(*ida_line(results.levels, row, end, reach), look.BLUE, width, dash)
    return f"Peak and residual rotation of {results.arch} against {results.scale.label}"


def demand(results: ArchResults, name: str) -> FloatArray:
    """Rotations at the levels [degrees], (n_record, n_level); inf above the capacity of a record.

    Between the levels that were run they are interpolated.
    """
    levels, standing = results.levels, results.verdict == Verdict.STANDING
    degrees = np.rad2deg(results[name])
    found = np.full(degrees.shape, np.nan)
    for row, (own, value, capacity) in enumerate(zip(standing, degrees, results.capacities)):
        own = own & (levels < capacity)
        if own.any():
            x, y = np.append(0.0, levels[own]), np.append(0.0, value[own])
            found[row] = np.interp(levels, x, y)
    return np.where(levels > results.capacities[:, None], np.inf, found)


def fractiles(curves: FloatArray, capacities: FloatArray) -> list[tuple[FloatArray, float]]:
    """The 16, 50 and 84 % fractiles of rotations (n_record, n_level), and where each ends."""
    ranked = np.sort(np.where(np.isnan(curves), np.inf, curves), axis=0)
    ends, found, last = np.sort(capacities), [], len(ranked) - 1
    for part in _FRACTILES:
        # The 84 % fractile of demand ends at the 16 % fractile of capacity.
        end = float(ends[min(int((1.0 - part) * len(ranked)), last)])
        found.append((ranked[min(int(part * len(ranked)), last)], end))
    return found


def ida_line(
    levels: FloatArray, row: FloatArray, capacity: float, right: float
) -> tuple[FloatArray, FloatArray]:
    """Rotations and levels of a line from the origin; it is flat up to `right` at the capacity."""
    seen = np.isfinite(row)
    x, y = np.append(0.0, row[seen]), np.append(0.0, levels[seen])
    if np.isfinite(capacity):
        x, y = np.append(x, [x[-1], right]), np.append(y, [capacity, capacity])
    return x, y


@figure
def lost_joints(sheet: Sheet, arch: Arch, results: ArchResults) -> str | None:
    """The arch with a dot at each joint that lost contact, by how often; None without collapse."""
    collapsed = results.verdict == Verdict.COLLAPSED
    joints, counts = np.unique(results["collapse_joint"][collapsed], return_counts=True)
    if not collapsed.any():
        return None
    panel = arch_panel(
        sheet, arch, 0.5 * sheet.width, 28.0, (min(sheet.width, 480.0) - 70.0, 240.0)
    )
    middle, outward = 0.5 * (arch.intrados + arch.extrados), arch.extrados - arch.intrados
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    for joint, count in zip(joints, counts):
        x, y = middle[joint, :, None]
        panel.dots(x, y, look.VERMILION, "hinge", float(2.0 + 8.0 * np.sqrt(count / counts.max())))
        right, up = 24.0 * outward[joint]
        words = f"{100 * count / counts.sum():.0f} %"
        sheet.text(
            float(panel.at_x(x[0])) + right, float(panel.at_y(y[0])) - up + 3.5, words, "s m"
        )
    sheet.height = panel.box[3] + 14.0
    return f"Joints of {results.arch} that lost contact for good, by how often"


@figure
def tornado(
    sheet: Sheet, members: Sequence[Answer], differences: Mapping[str, NDArray], name: str,
    scale: Scale,
) -> str | None:  # fmt: skip
    """Draw `effects_on_theta` as bars, the largest on top; None if arches are too few for it."""
    theta = np.array([np.nan if isinstance(a.curve, str) else a.curve.theta for a in members])
    names = [key for key, values in differences.items() if np.isfinite(values).all()]
    known = np.isfinite(theta)
    if known.sum() < len(names) + 2 or not names:
        return None
    values = np.column_stack([differences[key] for key in names])[known]
    middle, ends = effects_on_theta(scale.factor * theta[known], values)
    order = np.argsort(-np.abs(np.log(ends[:, 1] / middle)))[:_MOST_BARS]
    ends = ends[order]
    margin = 0.05 * float(np.ptp(ends)) or 0.05 * middle
    reach = float(ends.min()) - margin, float(ends.max()) + margin
    left = 170.0 if not sheet.narrow else 110.0
    height = 24.0 * len(order)
    sheet.height = height + look.BELOW + 8.0
    box = (left, 8.0, sheet.width - 60.0, 8.0 + height)
    panel = Panel(sheet, box, reach, (len(order) - 0.5, -0.5))
    panel.axis_x(look.even_ticks(*reach, 6), f"θ [{scale.unit}]", grid=True)
    for row, (key, (low, high)) in enumerate(zip(order, ends)):
        for end, colour in ((low, look.SKY), (high, look.BLUE)):
            near, far = sorted((middle, end))
            panel.boxes([near], [far], [row - 0.35], [row + 0.35], colour)
        label = look.shortened(names[key], left - 12.0)
        sheet.text(left - 8.0, float(panel.at_y(row)) + 4.0, label, "e")
    panel.line([middle, middle], panel.y, look.INK, 1.0)
    return f"Change of the median capacity of {name} with {', '.join(names[k] for k in order)}"


def effects_on_theta(theta: FloatArray, values: FloatArray) -> tuple[float, FloatArray]:
    """Theta of an arch with mean values, and with each value a standard deviation off its mean.

    From a linear regression of ln theta, (n_arch,), on the values, (n_arch, n_value). Returned are
    theta at the means, and at the mean of a value less and plus its deviation, (n_value, 2).
    """
    unit = (values - values.mean(axis=0)) / values.std(axis=0, ddof=1)
    lines = np.column_stack([np.ones(len(unit)), unit])
    middle, *effects = np.linalg.lstsq(lines, np.log(theta), rcond=None)[0]
    return float(np.exp(middle)), np.exp(middle + np.outer(effects, (-1.0, 1.0)))
