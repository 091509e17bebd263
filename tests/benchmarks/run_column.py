"""Multi-drum column under a pulse in two parts: least amplitude that overturns it.

The column of Dimitri, De Lorenzis and Zavarise (2011), on which UDEC, LMGC90 and HybriDFEM have
been run by others. Ground acceleration +a for tp, -a/2 for twice as long, then nothing.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
from amplitudes import Sweep, ranges, sweep, two_part_pulse
from tables import machine, markdown, write_csv

import archfrag as af
from archfrag.evidence.part import in_processes
from archfrag.evidence.run import Way

# Duration [s]: UDEC, LMGC90, HybriDFEM [g].
PUBLISHED = {
    0.15: (2.05, 2.20, 2.14),
    0.20: (1.46, 1.48, 1.46),
    0.30: (0.87, 0.88, 0.88),
    0.33: (0.78, 0.79, 0.78),
    0.34: (0.46, 0.44, 0.39),
    0.36: (np.nan, 0.38, 0.34),
    0.40: (0.31, 0.30, 0.29),
    0.60: (0.25, 0.24, 0.23),
}
WIDENED = 0.05
WAYS = (
    Way("time_stepping", "dt", 5e-4),
    Way("time_stepping", "dt", 2.5e-4),
    Way("event_driven", "rtol", 1e-3),
    Way("event_driven", "rtol", 1e-4),
)
SPACING = 0.01  # [g]
WIDTH = 1e-3


def column(friction: float = np.inf) -> af.Arch:
    """Seven drums of 0.82 m and a top block of 0.21 m; 1.11 m wide at the base, 0.90 m on top."""
    height = np.append(np.arange(8) * 0.82, 5.95)
    right = np.column_stack([0.5 * (1.11 - 0.21 * height / 5.95), height])
    return af.Arch.from_joints(
        right, right * [-1.0, 1.0], friction=friction, density=2620.0, free_end=True
    )


def grid(duration: float, spacing: float = SPACING) -> np.ndarray:
    """Amplitudes from the onset to above the largest published [g]."""
    first = np.ceil(af.onset(column()).plus / spacing)
    last = np.ceil(1.12 * np.nanmax(PUBLISHED[duration]) / spacing)
    return np.round(spacing * np.arange(first, last + 1), 6)


def judge(duration: float, way: Way) -> Sweep:
    """Verdicts of one way at one duration."""
    return sweep(column(), two_part_pulse(duration), list(grid(duration)), way, WIDTH)


def row(duration: float, results: list[Sweep]) -> list[object]:
    """Line of the table."""
    values = PUBLISHED[duration]
    low, high = (1 - WIDENED) * np.nanmin(values), (1 + WIDENED) * np.nanmax(values)
    least = [result.least for result in results]
    inside = [bool(low <= value <= high) for value in least]
    above = [
        f"{way}: {ranges(result.standing_above, SPACING)}"
        for way, result in zip(WAYS, results)
        if result.standing_above
    ]
    return [
        f"{duration:g}",
        f"{np.nanmin(values):g}-{np.nanmax(values):g}",
        f"{low:.4f}-{high:.4f}",
        *(f"{value:.4f} ({result.mode})" for value, result in zip(least, results)),
        "yes"
        if all(inside)
        else f"no: {', '.join(str(w) for w, i in zip(WAYS, inside) if not i)}",
        "; ".join(above),
    ]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--duration", type=float, nargs="+", default=list(PUBLISHED))
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--csv", type=Path, help="folder for the table as CSV")
    arguments = parser.parse_args()
    tasks = [(duration, way) for duration in arguments.duration for way in WAYS]
    results = in_processes(judge, tasks, arguments.workers)
    rows = []
    for i, duration in enumerate(arguments.duration):
        part = results[len(WAYS) * i : len(WAYS) * (i + 1)]
        rows.append(row(duration, part))
        for way, result in zip(WAYS, part):
            print(
                f"{duration:g} s, {way}: {result.seconds:.1f} s for {len(result.verdicts)} "
                f"amplitudes, {result.moving} moving at the end, failed: {result.failures}, "
                f"energy error {result.energy_error:.1e}",
                file=sys.stderr,
            )
    head = ["tp (s)", "published (g)", "widened", *map(str, WAYS), "inside", "stands again at (g)"]
    title = "Column: least collapsing amplitude (g), bisected to 0.1 %"
    print(f"{machine()}\n\n{markdown(title, head, rows)}")
    if arguments.csv:
        write_csv(arguments.csv / "column.csv", head, rows)


if __name__ == "__main__":
    main()
