"""Figures of record files: acceleration, velocity and spectra."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from archfrag.arch import STANDARD_GRAVITY
from archfrag.errors import InputError
from archfrag.motions.measures import spectral_acceleration
from archfrag.motions.motion import Motion
from archfrag.motions.process import velocity
from archfrag.report import picture as look
from archfrag.report.curve_figures import COLOURS
from archfrag.report.motion_figures import PERIODS, envelope, spectra, spectral_panel
from archfrag.report.picture import BESIDE, Picture
from archfrag.report.plot import Entry, Panel, Sheet, picture

MOST = 24
_COLOURS = (*COLOURS, look.INK)
_DECADES = 1e-4  # of the largest ordinate, below which a spectrum is not shown
_HIGH = 70.0  # of a history [px]


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


def measured(found: Mapping[float, NDArray[np.float64]]) -> Picture:
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
