"""Convergence of both methods up to the first impact and beyond it, against one reference.

The arch of seven voussoirs (radius 10 m, thickness 1.5 m, embrace 157.5 degrees, friction 0.7)
under +0.5 g for 0.3 s and -0.25 g for 0.6 s. Errors are the largest difference of any centroid's
displacement from event-driven integration at rtol 1e-12, over the largest displacement, at an
instant before the first impact, at one between it and the second, and at one after several.
"""

import argparse
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from amplitudes import two_part_pulse
from matplotlib.ticker import FuncFormatter, NullFormatter
from numpy.typing import NDArray
from tables import machine, markdown, write_csv

import archfrag as af
from archfrag.report import canvas

AMPLITUDE, DURATION = 0.5, 0.3
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10)
REFERENCE = 1e-12
# Below the sampling of the motion frames are its multiples: so are these steps its parts.
STEPS = (4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4, 1e-4, 5e-5, 2.5e-5, 1.25e-5)
FINEST = 5  # settings to which exponents are fitted
BEFORE, BETWEEN, BEYOND = 0.4, 0.412, 0.44  # [s], multiples of the longest step
NAMES = ("before the first impact", "after it", "after several")


class Run(NamedTuple):
    """What is compared of one run."""

    places: NDArray[np.float64]  # (3, n_voussoir, 2) displacements at the three instants [m]
    first_impact: float  # [s]
    steps: int


def run(**options: Any) -> Run:
    """History of the scene up to the end of the pulse."""
    arch = af.Arch.circular(10.0, 1.5, 157.5, 7, friction=0.7)
    response = af.simulate(
        arch, two_part_pulse(DURATION), scale=AMPLITUDE, history=True, follow=0.0, **options
    )
    assert response.history is not None
    assert response.mechanism is not None
    history = response.history.drop_duplicates("time")
    places = []
    for instant in (BEFORE, BETWEEN, BEYOND):
        frame = history.displacement.sel(time=instant, method="nearest")
        if abs(float(frame.time) - instant) > 1e-9:
            raise RuntimeError(f"no frame at {instant} s with {options}")
        places.append(frame.values)
    impact = next(change.time for change in response.mechanism if change.cause == "impact")
    return Run(np.array(places), impact, response.steps)


def errors(result: Run, exact: Run) -> list[float]:
    """At the three instants [1], and of the instant of the first impact [s]."""
    apart = np.abs(result.places - exact.places).max(axis=(1, 2))
    size = np.abs(exact.places).max(axis=(1, 2))
    return [*(apart / size), abs(result.first_impact - exact.first_impact)]


def slope(settings: NDArray[np.float64], values: NDArray[np.float64]) -> str:
    """Exponent of the error in the setting over the finest ones, and its 95 % interval."""
    (exponent, _), covariance = np.polyfit(
        np.log(settings[-FINEST:]), np.log(values[-FINEST:]), 1, cov=True
    )
    return f"{exponent:.2f} ± {1.96 * np.sqrt(covariance[0, 0]):.2f}"


def power(value: float, _: int) -> str:
    """Tick label of a power of ten."""
    return f"1e{round(np.log10(value))}"


def draw(figure: Any, steps: Any, stepping: Any, tolerances: Any, driven: Any) -> None:
    """Error against step, and error against tolerance."""
    left, right = figure.subplots(1, 2, sharey=True)
    colours = (canvas.BLUE, canvas.ORANGE, canvas.GREEN)
    for axes, settings, table, label in (
        (left, steps, stepping, "time step (s)"),
        (right, tolerances, driven, "relative tolerance"),
    ):
        for k, (name, colour) in enumerate(zip(NAMES, colours)):
            axes.loglog(settings, table[:, k], "o-", ms=3.5, color=colour, label=name)
        axes.set_xlabel(label)
        axes.set_ylim(1e-13, 1.0)
        canvas.faint_grid(axes)
    guide = np.array([steps[-1], steps[0]])
    square = stepping[0, 0] * (guide / guide[1]) ** 2
    left.loglog(guide, square, "--", lw=0.8, color=canvas.GREY, label="second order")
    left.legend(loc="upper left", fontsize=7, ncols=2)
    for axis in (left.xaxis, right.xaxis, left.yaxis):
        axis.set_major_formatter(FuncFormatter(power))
        axis.set_minor_formatter(NullFormatter())
    left.set_title("Time stepping")
    right.set_title("Event-driven")
    left.set_ylabel("error over largest displacement")


def main() -> None:
    """Print the tables and, if asked, draw the figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--figure", type=Path, help="SVG to write")
    parser.add_argument("--csv", type=Path, help="folder for the tables as CSV")
    arguments = parser.parse_args()
    exact = run(method="event_driven", rtol=REFERENCE)
    print(f"{machine()}\n\nFirst impact at {exact.first_impact:.12f} s.\n")
    tables = []
    for title, method, key, settings in (
        ("Time stepping: error against step", "time_stepping", "dt", STEPS),
        ("Event-driven: error against tolerance", "event_driven", "rtol", TOLERANCES),
    ):
        results = [run(method=method, **{key: setting}) for setting in settings]
        table = np.array([errors(result, exact) for result in results])
        tables.append(table)
        rows: list[list[object]] = [
            [
                f"{setting:.4g}",
                result.steps,
                *(f"{value:.1e}" for value in row),
                f"{result.places[1, 3, 0]:.12f}",
            ]
            for setting, result, row in zip(settings, results, table)
        ]
        exponents = [slope(np.array(settings), table[:, k]) for k in range(4)]
        rows.append([f"exponent, {FINEST} finest", "", *exponents, ""])
        head = [
            "step (s)" if key == "dt" else "rtol",
            "steps",
            f"{NAMES[0]}, {BEFORE} s",
            f"{NAMES[1]}, {BETWEEN} s",
            f"{NAMES[2]}, {BEYOND} s",
            "instant of the first impact (s)",
            f"keystone at {BETWEEN} s (m)",
        ]
        print(markdown(title, head, rows))
        if arguments.csv:
            write_csv(arguments.csv / f"convergence_{method}.csv", head, rows)
    if arguments.figure:
        write_figure(arguments.figure, *tables)


def write_figure(path: Path, stepping: Any, driven: Any) -> None:
    """Draw both panels in the house's style."""
    drawn = canvas.picture(
        "convergence",
        (canvas.WIDTH, 3.1),
        lambda figure: draw(
            figure, np.array(STEPS), stepping, np.array(TOLERANCES), driven
        ),
        alternative="Error of both methods against step and tolerance",
        caption="",
    )  # fmt: skip
    spaces = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(drawn.svg.replace("<svg ", f"<svg {spaces} ", 1), encoding="utf-8")


if __name__ == "__main__":
    main()
