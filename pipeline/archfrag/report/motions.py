"""Figures of ground motions: how they look and their response spectra, also of record files."""

from collections import Counter
from collections.abc import Mapping, Sequence
from html import escape
from itertools import pairwise
from typing import Any

import numpy as np
from markupsafe import Markup

from archfrag.arch import STANDARD_GRAVITY
from archfrag.errors import InputError
from archfrag.fragility.curve import Fragility
from archfrag.motions.measures import measure, spectral_acceleration, velocity
from archfrag.motions.motion import Motion
from archfrag.report import drawing as look
from archfrag.report.axes import Panel, even_ticks, log_ticks, panel_below
from archfrag.report.drawing import BESIDE, Entry, FloatArray, Picture, Sheet, figure
from archfrag.report.inputs import ReportInputs
from archfrag.report.results import Scale, digits, measured, table
from archfrag.study.answer.cautions import accepted_records

Spectrum = tuple[FloatArray, FloatArray]

PERIODS = np.geomspace(0.02, 5.0, 80)
_FEW_PERIODS = np.geomspace(0.03, 4.0, 32)  # of the report's figure
_BINS = 220
_THUMBNAIL_BINS = 110
_MOST_THUMBNAILS = 60
_NAME = 180.0  # of a record under its thumbnail [px]
_MOST_SPECTRA = 80
_NORMAL_975 = 1.959964  # quantile of the standard normal
MOST = 24  # channels in a figure of a file
_COLOURS = (*look.COLOURS, look.INK)
_DECADES = 1e-4  # of the largest ordinate, below which a spectrum is not shown
_HIGH = 70.0  # of a history [px]


def envelope(values: FloatArray, bins: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Place among the samples and range of a trace in bins as wide as a line."""
    # Each bin starts with the last sample of the one before it: the trace stays connected.
    edges = np.unique(np.linspace(0, values.size - 1, min(bins, values.size - 1) + 1, dtype=int))
    pieces = [values[a : b + 1] for a, b in pairwise(edges)]
    low, high = (np.array([end(piece) for piece in pieces]) for end in (np.min, np.max))
    return 0.5 * (edges[:-1] + edges[1:]), low, high


def normalised(motion: Motion, bins: int = _BINS) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Time and range of a record in bins as wide as a line, divided by its PGA."""
    values = np.asarray(motion.acceleration, dtype=float)
    place, low, high = envelope(values / (np.abs(values).max() or 1.0), bins)
    return place * motion.dt, low, high


def thumbnails(motions: Sequence[Motion]) -> Picture:
    """Accelerograms, each divided by its own peak, as many in a row as the page is wide for."""
    shown, pieces = motions[:_MOST_THUMBNAILS], []
    for motion in shown:
        _, low, high = normalised(motion, _THUMBNAIL_BINS)
        across = np.linspace(0.5, 109.5, low.size)
        ends = np.append(20.0 - 19.5 * high - 0.25, (20.0 - 19.5 * low + 0.25)[::-1])
        outline = look.trace(np.append(across, across[::-1]), ends)
        pieces.append(
            f'<div><svg viewBox="0 0 110 40" preserveAspectRatio="none" aria-hidden="true">'
            f'<path d="{outline}z" fill="{look.BLUE}"/></svg>'
            f"<span>{escape(look.shortened(motion.id, _NAME))}</span>"
            f"<span>{motion.duration:.0f} s</span></div>"
        )
    label = f"Accelerograms of {len(shown)} ground motions, each scaled to its peak"
    some = f" The first {len(shown)} of {len(motions)} are shown." * (len(shown) < len(motions))
    return Picture(
        f'<div class="thumbnails" role="img" aria-label="{label}">{"".join(pieces)}</div>',
        f"Horizontal acceleration of each record divided by its own PGA, entire duration.{some}",
    )


def _spectral_panel(
    sheet: Sheet, entries: Sequence[Entry], periods: FloatArray, ends: tuple[float, float],
    top: float = 0.0,
) -> Panel:  # fmt: skip
    """Axes of spectra between two ordinates [g] below their legend, the last of a sheet."""
    x = float(periods[0]), float(periods[-1])
    panel = panel_below(sheet, entries, 240.0, x, ends, top=top, log=True)
    panel.axis_x(log_ticks(*x), "period [s]", grid=True)
    panel.axis_y(log_ticks(*ends), "Sa, 5 % damping [g]")
    return panel


@figure
def spectra(
    sheet: Sheet, responses: Mapping[str, Spectrum], factors: Mapping[str, float], level: str
) -> tuple[str, str]:
    """Spectra at 5 % damping, all scaled to one intensity: each, their median and 16-84 %."""
    periods = np.asarray(next(iter(responses.values()))[0], dtype=float)
    scaled = (
        np.stack([responses[r][1] * factors[r] for r in responses if r in factors])
        / STANDARD_GRAVITY
    )
    low, median, high = np.nanquantile(scaled, [0.16, 0.5, 0.84], axis=0)
    floor = max(median.max() / 1000.0, 0.7 * float(np.nanmin(scaled[scaled > 0])))
    entries = [
        Entry("records", look.GREY, "line"), Entry("16 to 84 %", "#b9dcf2"),
        Entry("median", look.BLUE, "line"),
    ]  # fmt: skip
    panel = _spectral_panel(sheet, entries, periods, (floor, 1.3 * float(np.nanmax(scaled))))
    every = 2 if sheet.narrow else 1
    above = np.where(scaled >= floor, scaled, np.nan)
    for row in above[:_MOST_SPECTRA]:
        panel.line(periods[::every], row[::every], look.GREY, 0.5, opacity=0.6)
    panel.band(periods, np.maximum(low, floor), np.maximum(high, floor), look.SKY, 0.35)
    panel.line(periods, np.where(median >= floor, median, np.nan), look.BLUE, 2.0)
    of = f"{min(len(scaled), _MOST_SPECTRA)} of " if len(scaled) > _MOST_SPECTRA else ""
    return (
        f"Response spectra of {len(responses)} records {level}",
        f"Pseudo-acceleration spectra at 5 % damping of {of}all records, {level}.",
    )


def measured_spectra(found: Mapping[float, FloatArray]) -> Picture:
    """Response spectra of a flatfile, period [s] to Sa [g] (n_record,), at two periods or more."""
    periods = np.array(sorted(found))
    if periods.size < 2:
        raise InputError(f"a figure of spectra needs two periods or more; there is {periods.size}")
    rows = STANDARD_GRAVITY * np.stack([found[period] for period in periods], axis=1)
    given = {str(i): (periods, row) for i, row in enumerate(rows)}
    picture: Picture = spectra(given, dict.fromkeys(given, 1.0), "unscaled")
    return picture


@figure
def selected_spectra(sheet: Sheet, selection: Any) -> tuple[str, str]:
    """Spectra of selected, scaled records beside their target's: medians, 2.5 and 97.5 %."""
    target, rows = selection.target, np.exp(selection.ln_sa)
    entries = [
        Entry(f"{len(rows)} selected, scaled", look.GREY, "line"),
        Entry("selected", look.VERMILION, "line"), Entry("target", look.BLUE, "line"),
    ]  # fmt: skip
    curves = [
        (np.exp(mean + z * np.nan_to_num(sd)), colour, 2.0 if z == 0.0 else 0.8)
        for mean, sd, colour in ((selection.ln_sa.mean(axis=0), selection.sd, look.VERMILION),
                                 (target.ln_mean, target.sd, look.BLUE))
        for z in (0.0, -_NORMAL_975, _NORMAL_975)
    ]  # fmt: skip
    shown = np.vstack([rows, *(curve for curve, _, _ in curves)])
    ends = float(shown.min()), float(shown.max())
    panel = _spectral_panel(sheet, entries, target.periods, ends)
    for row in rows:
        panel.line(target.periods, row, look.GREY, 0.5, opacity=0.6)
    for curve, colour, width in curves:
        panel.line(target.periods, curve, colour, width)
    return (
        f"Response spectra of {len(rows)} selected records and their target",
        "Medians (bold) with 2.5 and 97.5 percentiles of lognormal Sa at 5 % damping.",
    )


@figure
def channels(sheet: Sheet, traces: Sequence[tuple[str, Motion]]) -> tuple[str, str]:
    """Acceleration and velocity of each channel as read, and the response spectra of all.

    Of 1 to 24 labels and channels; InputError if there are others.
    """
    if not 1 <= len(traces) <= MOST:
        raise InputError(
            f"a figure shows 1 to {MOST} channels with a known unit; there are {len(traces)}"
        )
    rows = [spectral_acceleration(motion, PERIODS) / STANDARD_GRAVITY for _, motion in traces]
    entries = [
        Entry(label, _COLOURS[i % 7], "dash" if i >= 7 else "line")
        for i, (label, _) in enumerate(traces)
    ]
    every = np.concatenate(rows)
    top = float(every.max()) or 1.0
    ends = 0.8 * float(every[every > _DECADES * top].min(initial=top)), 1.4 * top
    start, half = 20.0, 0.5 * sheet.width
    for label, motion in traces:
        quantities = (
            (motion, 1.0 / STANDARD_GRAVITY, f"{label}: acceleration [g]"),
            (Motion(velocity(motion), motion.dt), 100.0, "velocity [cm/s]"),
        )
        for i, (series, factor, title) in enumerate(quantities):
            box = (i * half + BESIDE, start, (i + 1) * half - 10.0, start + _HIGH)
            panel = Panel(sheet, box, (0.0, series.duration), (-1.0, 1.0))
            _history(panel, series, factor)
            panel.heading(look.shortened(title, half - BESIDE - 10.0))
        start += _HIGH + 42.0
    panel = _spectral_panel(sheet, entries, PERIODS, ends, start)
    for row, (_, colour, mark) in zip(rows, entries):
        dash = "5 2.5" if mark == "dash" else ""
        panel.line(PERIODS, np.where(row >= ends[0], row, np.nan), colour, 1.3, dash)
    return (
        f"Acceleration, velocity and response spectra of {len(rows)} channels",
        "Each channel as it is read, without filter; velocity, by trapezia, drifts where it needs "
        "one. Spectra: pseudo-acceleration at 5 % damping.",
    )


def _history(panel: Panel, series: Motion, factor: float) -> None:
    time, low, high = normalised(series)
    peak = float(np.abs(series.acceleration).max()) * factor
    reach = 1.1 * peak if peak > 0.0 else 1.0
    panel.y = (-reach, reach)
    panel.axis_y(even_ticks(-reach, reach, 4))
    panel.axis_x(even_ticks(*panel.x, 5), "")
    panel.band(time, low * peak, high * peak, look.BLUE, 1.0)
    panel.sheet.text(panel.box[2], panel.box[1] + 8.0, f"{peak:.3g}", "s e")


def motion_section(inputs: ReportInputs, scale: Scale) -> dict[str, Any]:
    """Figures and table of the ground motions, by the names that the page's template uses."""
    cube = inputs.cube
    named = cube["event"].values if "event" in cube else np.array([])
    events = Counter(sorted(filter(None, named.astype(str).tolist())))
    responses = {
        motion.id: (_FEW_PERIODS, np.asarray(spectral_acceleration(motion, _FEW_PERIODS)))
        for motion in inputs.motions
    }
    return {
        "thumbnails": thumbnails(inputs.motions),
        "spectra": spectra(responses, *_shown_factors(inputs, scale)),
        "table": _motion_table(inputs),
        "events": events
        and table("Earthquakes", ["earthquake", "records"], events.items(), "compact"),
        "accepted": accepted_records(cube),
    }


def _motion_table(inputs: ReportInputs) -> Markup:
    names = inputs.cube["record"].values.astype(str).tolist()
    verticals = any(motion.vertical is not None for motion in inputs.motions)
    rows = []
    for motion in inputs.motions:
        own = inputs.cube.isel(record=names.index(motion.id))
        factor = own["scale_factor"].values[np.isfinite(own["scale_factor"].values)]
        about = [
            measured(own[name].item() if name in own else None, form)
            for name, form in (("magnitude", ".2f"), ("distance", ".1f"))
        ]
        rows.append([
            motion.id, *about, f"{motion.duration:.1f}", f"{motion.dt:g}",
            f"{measure(motion, 'PGA') / STANDARD_GRAVITY:.4f}",
            f"{100 * measure(motion, 'PGV'):.2f}", measured(measure(motion, "Arias")),
            f"{measure(motion, 'D5_95'):.1f}",
            *(["no" if motion.vertical is None else "yes"] if verticals else []),
            f"{digits(factor.min())} – {digits(factor.max())}" if factor.size else "not run",
        ])  # fmt: skip
    heads = [
        "record", "M", "distance [km]", "duration [s]", "dt [s]", "PGA [g]", "PGV [cm/s]",
        "Arias [m/s]", "D5\u2060–\u206095 [s]", *(["vertical"] if verticals else []),
        "scale factors",
    ]  # fmt: skip
    return table("Ground motions as recorded, and their scale factors", heads, rows, "dense")


def _shown_factors(inputs: ReportInputs, scale: Scale) -> tuple[dict[str, float], str]:
    """Factors that spectra are shown with, and in words what they do.

    Those of the level closest to the median capacity, of the middle one where no arch has a
    curve; those of the runs where each has a level of its own.
    """
    cube = inputs.cube
    records = [str(name) for name in cube["record"].values]
    factors = cube["scale_factor"]
    if cube["intensity"].dims != ("level",):
        own = factors.isel(arch=0, level=0) if "arch" in factors.dims else factors.isel(level=0)
        made = {r: float(f) for r, f in zip(records, own.values, strict=True) if np.isfinite(f)}
        return made, "scaled as in the runs"
    intensity = cube["intensity"].values
    fits = [answer.curve for answer in inputs.answers.values()]
    medians = [fit.theta for fit in fits if isinstance(fit, Fragility)]
    level = intensity.size // 2
    if medians:
        level = int(np.abs(np.log(intensity) - np.log(np.median(medians))).argmin())
    chosen = factors.transpose("record", "level").values[:, level]
    words = f"scaled to {scale.measure} = {scale.text(float(intensity[level]))}"
    return dict(zip(records, chosen, strict=True)), words
