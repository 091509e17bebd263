"""Ground motions: how they look and their response spectra, on the page and of record files."""

from collections import Counter
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

from archfrag.arch import STANDARD_GRAVITY
from archfrag.errors import InputError
from archfrag.fragility.curve import Fragility
from archfrag.motions.measures import measure, spectral_acceleration
from archfrag.motions.motion import Motion
from archfrag.motions.process import velocity
from archfrag.report import picture as look
from archfrag.report.curve_figures import COLOURS
from archfrag.report.inputs import ReportInputs
from archfrag.report.picture import BESIDE, FloatArray, Picture
from archfrag.report.plot import Entry, Panel, Sheet, picture
from archfrag.report.summary import Scale
from archfrag.study.fits import accepted_records

Spectrum = tuple[FloatArray, FloatArray]

PERIODS = np.geomspace(0.02, 5.0, 80)
SHOWN = np.geomspace(0.03, 4.0, 32)  # periods of the report's figure
_BINS = 220
_THUMBNAIL_BINS = 110
_MOST_THUMBNAILS = 60
_NAME = 180.0  # of a record under its thumbnail [px]
_MOST_SPECTRA = 80
MOST = 24  # channels in a figure of a file
_COLOURS = (*COLOURS, look.INK)
_DECADES = 1e-4  # of the largest ordinate, below which a spectrum is not shown
_HIGH = 70.0  # of a history [px]


def thumbnails(motions: Sequence[Motion]) -> Picture:
    """Accelerograms, each divided by its own peak, as many in a row as the page is wide for."""
    shown = motions[:_MOST_THUMBNAILS]
    pieces = [
        f'<div><svg viewBox="0 0 110 40" preserveAspectRatio="none" aria-hidden="true">'
        f'<path d="{_outline(motion)}" fill="{look.BLUE}"/></svg>'
        f"<span>{escape(look.shortened(motion.id, _NAME))}</span>"
        f"<span>{motion.duration:.0f} s</span></div>"
        for motion in shown
    ]
    label = f"Accelerograms of {len(shown)} ground motions, each scaled to its peak"
    some = f" The first {len(shown)} of {len(motions)} are shown." * (len(shown) < len(motions))
    return Picture(
        f'<div class="thumbnails" role="img" aria-label="{label}">{"".join(pieces)}</div>',
        f"Horizontal acceleration of each record divided by its own PGA, entire duration.{some}",
    )


def _outline(motion: Motion) -> str:
    """Filled trace of a record in a box of 110 by 40."""
    _, low, high = envelope(motion, _THUMBNAIL_BINS)
    across = np.linspace(0.5, 109.5, low.size)
    ends = np.append(20.0 - 19.5 * high - 0.25, (20.0 - 19.5 * low + 0.25)[::-1])
    return look.trace(np.append(across, across[::-1]), ends) + "z"


def spectra(
    responses: Mapping[str, Spectrum], factors: Mapping[str, float], level: str
) -> Picture:
    """Spectra at 5 % damping, all scaled to one intensity: each, their median and 16-84 %."""
    periods = np.asarray(next(iter(responses.values()))[0], dtype=float)
    scaled = (
        np.stack([responses[r][1] * factors[r] for r in responses if r in factors])
        / STANDARD_GRAVITY
    )
    low, median, high = np.nanquantile(scaled, [0.16, 0.5, 0.84], axis=0)
    floor = max(median.max() / 1000.0, 0.7 * float(np.nanmin(scaled[scaled > 0])))
    ends = floor, 1.3 * float(np.nanmax(scaled))
    entries = [
        Entry("records", look.GREY, "line"), Entry("16 to 84 %", "#b9dcf2"),
        Entry("median", look.BLUE, "line"),
    ]  # fmt: skip

    def draw(sheet: Sheet) -> None:
        panel = spectral_panel(sheet, entries, periods, ends)
        every = 2 if sheet.narrow else 1
        above = np.where(scaled >= floor, scaled, np.nan)
        for row in above[:_MOST_SPECTRA]:
            panel.line(periods[::every], row[::every], look.GREY, 0.5, opacity=0.6)
        panel.band(periods, np.maximum(low, floor), np.maximum(high, floor), look.SKY, 0.35)
        panel.line(periods, np.where(median >= floor, median, np.nan), look.BLUE, 2.0)

    of = f"{min(len(scaled), _MOST_SPECTRA)} of " if len(scaled) > _MOST_SPECTRA else ""
    return picture(
        draw,
        alternative=f"Response spectra of {len(responses)} records {level}",
        caption=f"Pseudo-acceleration spectra at 5 % damping of {of}all records, {level}.",
    )


def spectral_panel(
    sheet: Sheet, entries: Sequence[Entry], periods: FloatArray, ends: tuple[float, float],
    top: float = 0.0,
) -> Panel:  # fmt: skip
    """Axes of spectra between two ordinates [g] below their legend, the last of a sheet."""
    x = float(periods[0]), float(periods[-1])
    panel = sheet.below_legend(entries, 240.0, x, ends, top=top, log=True)
    panel.axis_x(look.log_ticks(*x), "period [s]", grid=True)
    panel.axis_y(look.log_ticks(*ends), "Sa, 5 % damping [g]")
    return panel


def envelope(motion: Motion, bins: int = _BINS) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Time and range of a record in bins as wide as a line, divided by its PGA."""
    values = np.asarray(motion.acceleration, dtype=float)
    place, low, high = look.envelope(values / (np.abs(values).max() or 1.0), bins)
    return place * motion.dt, low, high


def motion_section(inputs: ReportInputs, scale: Scale) -> dict[str, Any]:
    """Figures and table of the ground motions, by the names that the page's template uses."""
    cube, rows = inputs.cube, []
    names = cube["record"].values.astype(str).tolist()
    named = cube["event"].values if "event" in cube else np.array([])
    for motion in inputs.motions:
        at = {"record": names.index(motion.id)}
        factor = cube["scale_factor"].isel(at).values
        rows.append({
            "motion": motion, "factor": factor[np.isfinite(factor)],
            **{name: cube[name].isel(at).item() if name in cube else None
               for name in ("magnitude", "distance")},
            **{name: measure(motion, name) for name in ("PGA", "PGV", "Arias", "D5_95")},
        })  # fmt: skip
    responses = {
        motion.id: (SHOWN, np.asarray(spectral_acceleration(motion, SHOWN, damping=0.05)))
        for motion in inputs.motions
    }
    return {
        "thumbnails": thumbnails(inputs.motions),
        "rows": rows,
        "gravity": STANDARD_GRAVITY,
        "events": Counter(sorted(filter(None, named.astype(str).tolist()))),
        "accepted": accepted_records(cube),
        "spectra": spectra(responses, *_shown_factors(inputs, scale)),
    }


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


def inspected(traces: Sequence[tuple[str, Motion]]) -> Picture:
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

    def draw(sheet: Sheet) -> None:
        start, half = 20.0, 0.5 * sheet.width
        for label, motion in traces:
            quantities = (
                (motion, 1.0 / STANDARD_GRAVITY, f"{label}: acceleration [g]"),
                (Motion(velocity(motion), motion.dt), 100.0, "velocity [cm/s]"),
            )
            for i, (series, factor, title) in enumerate(quantities):
                box = (i * half + BESIDE, start, (i + 1) * half - 10.0, start + _HIGH)
                _history(Panel(sheet, box, (0.0, series.duration), (-1.0, 1.0)), series, factor)
                sheet.panels[-1].heading(look.shortened(title, half - BESIDE - 10.0))
            start += _HIGH + 42.0
        panel = spectral_panel(sheet, entries, PERIODS, ends, start)
        for row, (_, colour, mark) in zip(rows, entries):
            dash = "5 2.5" if mark == "dash" else ""
            panel.line(PERIODS, np.where(row >= ends[0], row, np.nan), colour, 1.3, dash)

    return picture(
        draw,
        narrow=False,
        alternative=f"Acceleration, velocity and response spectra of {len(rows)} channels",
        caption="Each channel as it is read, without filter; velocity, by trapezia, drifts where "
        "it needs one. Spectra: pseudo-acceleration at 5 % damping.",
    )


def measured(found: Mapping[float, FloatArray]) -> Picture:
    """Response spectra of a flatfile, period [s] to Sa [g] (n_record,), at two periods or more."""
    periods = np.array(sorted(found))
    if periods.size < 2:
        raise InputError(f"a figure of spectra needs two periods or more; there is {periods.size}")
    rows = STANDARD_GRAVITY * np.stack([found[period] for period in periods], axis=1)
    given = {str(i): (periods, row) for i, row in enumerate(rows)}
    return spectra(given, dict.fromkeys(given, 1.0), "unscaled")


def _history(panel: Panel, series: Motion, factor: float) -> None:
    time, low, high = envelope(series)
    peak = float(np.abs(series.acceleration).max()) * factor
    reach = 1.1 * peak if peak > 0.0 else 1.0
    panel.y = (-reach, reach)
    panel.axis_y(look.even_ticks(-reach, reach, 4))
    panel.axis_x(look.even_ticks(*panel.x, 5), "")
    panel.band(time, low * peak, high * peak, look.BLUE, 1.0)
    panel.sheet.text(panel.box[2], panel.box[1] + 8.0, f"{peak:.3g}", "s e")
