"""Spectra of the shipped synthetic motions beside published ground-motion models.

``python -m archfrag.motions.compare records`` draws ``records/spectra.svg`` and
``records/scatter.svg``, writes ``records/spectra.csv`` and puts the tables into
``records/README.md``. It needs pygmm, an independent implementation of the ground-motion models,
which nothing else here uses.
"""

import csv
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from archfrag.errors import InputError
from archfrag.motions.index import IndexEntry, load_index
from archfrag.motions.measures import spectral_acceleration
from archfrag.motions.read import load_motion
from archfrag.motions.synthetic import VS30, Options, make_motion
from archfrag.motions.units import STANDARD_GRAVITY

PERIODS = (0.1, 0.2, 0.5, 1.0, 2.0)
MODELS = ("CY14", "ASK14", "BSSA14")
_CLASSES = {
    "CY14": "ChiouYoungs2014",
    "ASK14": "AbrahamsonSilvaKamai2014",
    "BSSA14": "BooreStewartSeyhanAtkinson2014",
    "CB14": "CampbellBozorgnia2014",
}
MAGNITUDE_BINS = ((5.5, 6.0), (6.5, 6.5), (7.0, 7.5))
DISTANCE_BINS = ((0.0, 10.0), (15.0, 30.0), (40.0, 100.0))
SCENARIOS = tuple((m, r) for m in (5.5, 6.5, 7.5) for r in (10.0, 30.0, 100.0))
REALISATIONS = 40
_BEGIN, _END = "<!-- spectra: begin -->", "<!-- spectra: end -->"


def predicted_spectrum(
    model: str, magnitude: float, distance: float, vs30: float, periods: ArrayLike
) -> NDArray[np.float64]:
    """Median Sa of a ground-motion model, shape (n_period,) [m/s2].

    A vertical strike-slip fault in California whose top lies at the depth that Chiou and Youngs
    (2014) expect for the magnitude; `distance` [km] is to the rupture.

    Raises
    ------
    InputError
        If pygmm is not installed.
    """
    prediction = ground_motion_model(model, magnitude, distance, vs30)
    return prediction.interp_spec_accels(np.asarray(periods)) * STANDARD_GRAVITY


def ground_motion_model(model: str, magnitude: float, distance: float, vs30: float) -> Any:
    """The model of pygmm for the scenario of `predicted_spectrum`.

    Raises
    ------
    InputError
        If pygmm is not installed.
    """
    try:
        import pygmm
    except ImportError:
        raise InputError(
            "comparing spectra needs pygmm; install it with: pip install pygmm"
        ) from None
    top = max(2.673 - 1.136 * max(magnitude - 4.970, 0.0), 0.0) ** 2
    surface = float(np.sqrt(max(distance**2 - top**2, 0.0)))
    scenario = pygmm.Scenario(
        mag=magnitude, dist_rup=distance, dist_jb=surface, dist_x=surface, v_s30=vs30, dip=90.0,
        mechanism="SS", depth_tor=top, on_hanging_wall=False, region="california",
    )  # fmt: skip
    return getattr(pygmm, _CLASSES[model])(scenario)


def suite_ratios(entries: Sequence[IndexEntry], model: str) -> dict[str, NDArray[np.float64]]:
    """Sa of each shipped motion over the median of a model, by id, shape (n_period,)."""
    return {
        entry.id: spectral_acceleration(load_motion(entry), PERIODS)
        / predicted_spectrum(
            model,
            entry.metadata["Mw"],
            entry.metadata["distance_km"],
            entry.metadata["Vs30_mps"],
            PERIODS,
        )
        for entry in entries
    }


def method_ratios(model: str, realisations: int = REALISATIONS) -> list[NDArray[np.float64]]:
    """Median Sa of many realisations over the median of a model, for each of ``SCENARIOS``."""
    ratios = []
    for magnitude, distance in SCENARIOS:
        spectra = [
            spectral_acceleration(
                make_motion(magnitude, distance, seed, Options(vary=False)), PERIODS
            )
            for seed in range(realisations)
        ]
        predicted = predicted_spectrum(model, magnitude, distance, 760.0, PERIODS)
        ratios.append(np.exp(np.log(spectra).mean(axis=0)) / predicted)
    return ratios


def write_comparison(records: str | Path) -> Path:
    """Write the table, the figure and the tables of the README of a folder of records."""
    folder = Path(records)
    entries = [entry for entry in load_index(folder) if entry.metadata.get("seed") is not None]
    ratios = {model: suite_ratios(entries, model) for model in MODELS}
    with open(folder / "spectra.csv", "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["id", "model", *(f"ratio_Sa_{period:g}s" for period in PERIODS)])
        for model, table in ratios.items():
            writer.writerows(
                [key, model, *(f"{r:.3f}" for r in row)] for key, row in table.items()
            )
    _draw(entries, folder / "spectra.svg")
    _draw_scatter(entries, folder / "scatter.svg")
    readme = folder / "README.md"
    text = readme.read_text(encoding="utf-8")
    before, rest = text.split(_BEGIN)
    after = rest.split(_END)[1]
    tables = "\n\n".join((_suite_table(entries, ratios), _method_table()))
    readme.write_text(f"{before}{_BEGIN}\n{tables}\n{_END}{after}", encoding="utf-8")
    return readme


def _suite_table(entries: Sequence[IndexEntry], ratios: dict[str, Any]) -> str:
    rows = []
    for low, high in MAGNITUDE_BINS:
        for near, far in DISTANCE_BINS:
            inside = [
                entry.id
                for entry in entries
                if low <= entry.metadata["Mw"] <= high
                and near <= entry.metadata["distance_km"] <= far
            ]
            label = f"M {low:g}" if low == high else f"M {low:g}–{high:g}"
            reach = f"≤ {far:g} km" if near == 0.0 else f"{near:g}–{far:g} km"
            rows.append((f"{label}, {reach}", inside))
    rows.append(("all", [entry.id for entry in entries]))
    lines = [_head("shipped motions", "motions")]
    for label, inside in rows:
        medians = [_median([ratios[model][key] for key in inside]) for model in MODELS]
        lines.append(_row(label, len(inside), medians))
    return "\n".join(lines)


def _method_table() -> str:
    tables = [method_ratios(model) for model in MODELS]
    lines = [_head("method, many seeds", "seeds")]
    for number, (magnitude, distance) in enumerate(SCENARIOS):
        row = [table[number] for table in tables]
        lines.append(_row(f"M {magnitude:g}, {distance:g} km", REALISATIONS, row))
    return "\n".join(lines)


def _median(rows: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    return np.exp(np.log(rows).mean(axis=0))


def _head(first: str, count: str) -> str:
    titles = [f"{model} {period:g} s" for model in MODELS for period in PERIODS]
    return (
        f"| {first} | {count} | " + " | ".join(titles) + " |\n" + "|---" * (2 + len(titles)) + "|"
    )


def _row(label: str, count: int, medians: list[NDArray[np.float64]]) -> str:
    return f"| {label} | {count} | " + " | ".join(f"{r:.2f}" for m in medians for r in m) + " |"


def _draw(entries: Sequence[IndexEntry], path: Path) -> None:
    import matplotlib

    matplotlib.use("svg")
    import matplotlib.pyplot as plt

    grid = np.geomspace(0.05, 3.0, 40)
    magnitudes = sorted({entry.metadata["Mw"] for entry in entries})
    with matplotlib.rc_context({"svg.hashsalt": "archfrag", "font.size": 8}):
        figure, axes = plt.subplots(1, len(magnitudes), figsize=(12, 3.2), sharey=True)
        for axis, magnitude in zip(np.atleast_1d(axes), magnitudes, strict=True):
            group = [entry for entry in entries if entry.metadata["Mw"] == magnitude]
            for number, entry in enumerate(group):
                colour = matplotlib.colormaps["viridis"](0.9 * number / max(len(group) - 1, 1))
                spectrum = spectral_acceleration(load_motion(entry), grid)
                reach = entry.metadata["distance_km"]
                axis.loglog(grid, spectrum, color=colour, lw=1.0, label=f"{reach:g} km")
                for model, style in zip(MODELS, ("--", ":", "-.")):
                    predicted = predicted_spectrum(
                        model, magnitude, reach, entry.metadata["Vs30_mps"], grid
                    )
                    axis.loglog(grid, predicted, style, color=colour, lw=0.8)
            axis.set_title(f"M {magnitude:g}")
            axis.set_xlabel("period [s]")
            axis.legend(fontsize=6, loc="lower left")
            axis.grid(True, which="major", lw=0.3)
        np.atleast_1d(axes)[0].set_ylabel("Sa, 5 % [m/s²]")
        figure.tight_layout()
        figure.savefig(path, format="svg", metadata={"Date": None})
        plt.close(figure)


def _draw_scatter(entries: Sequence[IndexEntry], path: Path) -> None:
    """Standard deviation of ln Sa: of the suite about the models, of the method, and published."""
    import matplotlib

    matplotlib.use("svg")
    import matplotlib.pyplot as plt

    grid = np.geomspace(0.05, 5.0, 25)
    expected = [
        np.mean(
            [
                np.log(
                    predicted_spectrum(
                        model, e.metadata["Mw"], e.metadata["distance_km"], VS30, grid
                    )
                )
                for model in MODELS[:2]
            ],
            axis=0,
        )
        for e in entries
    ]
    shipped = np.log([spectral_acceleration(load_motion(entry), grid) for entry in entries])
    made = [make_motion(6.5, 20.0, seed) for seed in range(10 * REALISATIONS)]
    method = np.log([spectral_acceleration(motion, grid) for motion in made])
    with matplotlib.rc_context({"svg.hashsalt": "archfrag", "font.size": 8}):
        figure, axis = plt.subplots(figsize=(5, 3.2))
        axis.semilogx(
            grid, np.std(shipped - expected, axis=0, ddof=1), "o-", ms=3, label="shipped motions"
        )
        axis.semilogx(grid, method.std(axis=0, ddof=1), "k-", label="method, M 6.5, 20 km")
        for model, style in zip(_CLASSES, ("--", ":", "-.", (0, (1, 4)))):
            published = ground_motion_model(model, 6.5, 20.0, VS30).interp_ln_stds(grid)
            axis.semilogx(grid, published, ls=style, label=f"{model}, total")
        axis.set_ylim(0.0, 1.1)
        axis.set_xlabel("period [s]")
        axis.set_ylabel("standard deviation of ln Sa")
        axis.legend(fontsize=6)
        axis.grid(True, which="major", lw=0.3)
        figure.tight_layout()
        figure.savefig(path, format="svg", metadata={"Date": None})
        plt.close(figure)


if __name__ == "__main__":
    write_comparison(sys.argv[1] if len(sys.argv) > 1 else "records")
