"""Figures of ground motions."""

from collections import Counter
from collections.abc import Iterator, Sequence
from html import escape
from itertools import pairwise
from typing import Any

import numpy as np
from markupsafe import Markup

from archfrag.arch import STANDARD_GRAVITY
from archfrag.fragility.curve import Fragility
from archfrag.motions.measures import measure, spectral_acceleration
from archfrag.motions.motion import Motion
from archfrag.report import drawing as look
from archfrag.report.drawing import Entry, FloatArray, Sheet, figure, log_ticks, panel_below
from archfrag.report.html import TEXTS, Picture, digits, measured, paragraph, table
from archfrag.report.inputs import ReportInputs

_FEW_PERIODS = np.geomspace(0.03, 4.0, 32)  # of the report's figure
_BINS = 110  # of a thumbnail
_MOST_THUMBNAILS = 60
_NAME = 180.0  # of a record under its thumbnail [px]
_MOST_SPECTRA = 80


def envelope(values: FloatArray, bins: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Place among the samples and range of a trace in bins as wide as a line."""
    # Each bin starts with the last sample of the one before it: the trace stays connected.
    edges = np.unique(np.linspace(0, values.size - 1, min(bins, values.size - 1) + 1, dtype=int))
    pieces = [values[a : b + 1] for a, b in pairwise(edges)]
    low, high = (np.array([end(piece) for piece in pieces]) for end in (np.min, np.max))
    return 0.5 * (edges[:-1] + edges[1:]), low, high


def thumbnails(motions: Sequence[Motion]) -> Picture:
    """Accelerograms, each divided by its own peak, as many in a row as the page is wide for."""
    shown, pieces = motions[:_MOST_THUMBNAILS], []
    for motion in shown:
        values = np.asarray(motion.acceleration, dtype=float)
        _, low, high = envelope(values / (np.abs(values).max() or 1.0), _BINS)
        across = np.linspace(0.5, 109.5, low.size)
        ends = np.append(20.0 - 19.5 * high - 0.25, (20.0 - 19.5 * low + 0.25)[::-1])
        outline = look.trace(np.append(across, across[::-1]), ends)
        pieces.append(
            f'<div><svg viewBox="0 0 110 40" preserveAspectRatio="none" aria-hidden="true">'
            f'<path d="{outline}z" fill="{look.BLUE}"/></svg>'
            f"<span>{escape(look.shortened(motion.id, _NAME))}</span>"
            f"<span>{motion.duration:.0f} s</span></div>"
        )
    label = f"Accelerograms of {len(shown)} of {len(motions)} ground motions"
    return Picture(
        f'<div class="thumbnails" role="img" aria-label="{label}">{"".join(pieces)}</div>',
        f"{label}: horizontal acceleration divided by its own PGA, entire duration.",
    )


@figure
def spectra(sheet: Sheet, periods: FloatArray, scaled: FloatArray, level: str) -> tuple[str, str]:
    """Spectra at 5 % damping, (n_record, n_period) [g], with their median and 16 to 84 %."""
    low, median, high = np.nanquantile(scaled, [0.16, 0.5, 0.84], axis=0)
    floor = max(median.max() / 1000.0, 0.7 * float(np.nanmin(scaled[scaled > 0])))
    entries = [
        Entry("records", look.GREY, "line"), Entry("16 to 84 %", "#b9dcf2"),
        Entry("median", look.BLUE, "line"),
    ]  # fmt: skip
    x, y = (float(periods[0]), float(periods[-1])), (floor, 1.3 * float(np.nanmax(scaled)))
    panel = panel_below(sheet, entries, 240.0, x, y, log=True)
    panel.axis_x(log_ticks(*x), "period [s]", grid=True)
    panel.axis_y(log_ticks(*y), "Sa, 5 % damping [g]")
    every, shown = 2 if sheet.narrow else 1, scaled[:_MOST_SPECTRA]
    for row in np.where(shown >= floor, shown, np.nan):
        panel.line(periods[::every], row[::every], look.GREY, 0.5, opacity=0.6)
    panel.band(periods, np.maximum(low, floor), np.maximum(high, floor), look.SKY, 0.35)
    panel.line(periods, np.where(median >= floor, median, np.nan), look.BLUE, 2.0)
    return (
        f"Response spectra of {len(scaled)} records {level}",
        f"Pseudo-acceleration spectra at 5 % damping of {len(shown)} of {len(scaled)} records, "
        f"{level}.",
    )


def motion_parts(inputs: ReportInputs) -> Iterator[Any]:
    """Figures and table of the ground motions."""
    cube = inputs.cube
    yield thumbnails(inputs.motions)
    yield _scaled_spectra(inputs)
    yield _motion_table(inputs)
    events = Counter(sorted(filter(None, cube["event"].values.astype(str).tolist())))
    if events:
        yield paragraph(TEXTS["notes"]["events"], "note")
        yield table("Earthquakes", ["earthquake", "records"], events.items(), "compact")
    waivers = cube["accepted"].values.astype(str) if "accepted" in cube else ()
    named = [f"{name!s} ({words})" for name, words in zip(cube["record"].values, waivers) if words]
    if named:
        yield paragraph(f"Records accepted despite a warning: {', '.join(named)}.", "caution")


def _motion_table(inputs: ReportInputs) -> Markup:
    rows = []
    for motion in inputs.motions:
        own = inputs.cube.sel(record=motion.id)
        factor = own["scale_factor"].values[np.isfinite(own["scale_factor"].values)]
        rows.append([
            motion.id, measured(own["magnitude"].item(), ".2f"),
            measured(own["distance"].item(), ".1f"), f"{motion.duration:.1f}", f"{motion.dt:g}",
            f"{measure(motion, 'PGA') / STANDARD_GRAVITY:.4f}",
            f"{100 * measure(motion, 'PGV'):.2f}", measured(measure(motion, "Arias")),
            f"{measure(motion, 'D5_95'):.1f}", "no" if motion.vertical is None else "yes",
            f"{digits(factor.min())} – {digits(factor.max())}" if factor.size else "not run",
        ])  # fmt: skip
    heads = [
        "record", "M", "distance [km]", "duration [s]", "dt [s]", "PGA [g]", "PGV [cm/s]",
        "Arias [m/s]", "D5\u2060–\u206095 [s]", "vertical", "scale factors",
    ]  # fmt: skip
    return table("Ground motions as recorded, and their scale factors", heads, rows, "dense")


def _scaled_spectra(inputs: ReportInputs) -> Picture:
    """Spectra at the level nearest to the median capacity, or at the middle level if no arch has
    a curve; as in the runs if each run has a level of its own.
    """
    cube, scale, level, words = inputs.cube, inputs.scale, 0, "scaled as in the runs"
    intensity = cube["intensity"].values
    if intensity.ndim == 1:
        fits = [answer.curve for answer in inputs.answers.values()]
        medians = [fit.theta for fit in fits if isinstance(fit, Fragility)]
        level, why = intensity.size // 2, "the middle level"
        if medians:
            level = int(np.abs(np.log(intensity) - np.log(np.median(medians))).argmin())
            why = "the level nearest to the median capacity"
        words = f"scaled to {scale.measure} = {scale.text(float(intensity[level]))}, {why}"
    chosen = cube["scale_factor"].isel(level=level, arch=0, missing_dims="ignore").values
    spectra_g = [
        spectral_acceleration(motion, _FEW_PERIODS) * factor / STANDARD_GRAVITY
        for motion, factor in zip(inputs.motions, chosen.tolist()) if np.isfinite(factor)
    ]  # fmt: skip
    return spectra(_FEW_PERIODS, np.stack(spectra_g), words)
