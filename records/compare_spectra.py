"""Spectra of the shipped synthetic motions beside published ground-motion models.

``python records/compare_spectra.py`` draws ``spectra.svg`` and ``scatter.svg``, writes
``spectra.csv`` and puts its tables into ``README.md``, all beside this file; for maintainers.
"""

import csv
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from archfrag.motions.index import load_index
from archfrag.motions.measures import spectral_acceleration
from archfrag.motions.motion import STANDARD_GRAVITY
from archfrag.motions.read import load_motion
from archfrag.motions.synthetic import VS30, Recipe, make_motion
from archfrag.motions.target import Rupture, predict

FOLDER = Path(__file__).parent
PERIODS = (0.1, 0.2, 0.5, 1.0, 2.0)
MODELS = ("CY14", "ASK14", "BSSA14")
MAGNITUDES = ((5.5, 6.0), (6.5, 6.5), (7.0, 7.5))
DISTANCES = ((0.0, 10.0), (15.0, 30.0), (40.0, 100.0))
SCENARIOS = tuple((m, r) for m in (5.5, 6.5, 7.5) for r in (10.0, 30.0, 100.0))
SEEDS = 40
BEGIN, END = "<!-- spectra: begin -->", "<!-- spectra: end -->"


def predicted(model, magnitude, distance, vs30, periods):
    """ln of the median Sa [ln m/s2] and its standard deviation, of a Californian strike-slip."""
    rupture = Rupture(magnitude, distance, vs30, region="california")
    ln_median, sd, _ = predict(rupture, model, periods)
    return ln_median + np.log(STANDARD_GRAVITY), sd


def beside(entry, model, periods):
    """`predicted` for the earthquake and site of a row of the index."""
    given = (entry.metadata[key] for key in ("Mw", "distance_km", "Vs30_mps"))
    return predicted(model, *given, periods)[0]


def ratios_of_suite(entries):
    """ln of Sa over each model's median by model and id, (n_period,)."""
    spectra = {e.id: np.log(spectral_acceleration(load_motion(e), PERIODS)) for e in entries}
    return {m: {e.id: spectra[e.id] - beside(e, m, PERIODS) for e in entries} for m in MODELS}


def table(first, count, rows):
    """Markdown of a label, a number and, for each model, the ratios at `PERIODS`."""
    titles = [first, count, *(f"{model} {period:g} s" for model in MODELS for period in PERIODS)]
    lines = [f"| {' | '.join(titles)} |", "|---" * len(titles) + "|"]
    for label, number, ratios in rows:
        cells = [label, str(number), *(f"{np.exp(r):.2f}" for row in ratios for r in row)]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def suite_table(entries, ratios):
    """Medians of the shipped motions over each model's, by magnitude and distance."""
    rows = []
    groups = [(m, r) for m in MAGNITUDES for r in DISTANCES]
    for (low, high), (near, far) in [*groups, ((0.0, 10.0), (0.0, 1e3))]:
        inside = [
            e.id for e in entries
            if low <= e.metadata["Mw"] <= high and near <= e.metadata["distance_km"] <= far
        ]  # fmt: skip
        label = f"M {low:g}" if low == high else f"M {low:g}–{high:g}"
        reach = f"≤ {far:g} km" if near == 0.0 else f"{near:g}–{far:g} km"
        means = [np.mean([ratios[model][id] for id in inside], axis=0) for model in MODELS]
        rows.append(("all" if far == 1e3 else f"{label}, {reach}", len(inside), means))
    return table("shipped motions", "motions", rows)


def method_table():
    """Medians of many motions without variation over each model's, by scenario."""
    rows = []
    for magnitude, distance in SCENARIOS:
        made = (
            make_motion(Recipe(magnitude, distance, seed, vary=False)) for seed in range(SEEDS)
        )
        median = np.mean([np.log(spectral_acceleration(each, PERIODS)) for each in made], axis=0)
        means = [median - predicted(m, magnitude, distance, VS30, PERIODS)[0] for m in MODELS]
        rows.append((f"M {magnitude:g}, {distance:g} km", SEEDS, means))
    return table("method, many seeds", "seeds", rows)


def draw_spectra(entries):
    """Spectra of the shipped motions, one panel a magnitude, models dashed."""
    grid = np.geomspace(0.05, 3.0, 40)
    magnitudes = sorted({entry.metadata["Mw"] for entry in entries})
    figure = Figure(figsize=(12, 3.2), layout="tight")
    for axis, magnitude in zip(figure.subplots(1, len(magnitudes), sharey=True), magnitudes):
        group = [entry for entry in entries if entry.metadata["Mw"] == magnitude]
        for number, entry in enumerate(group):
            colour = matplotlib.colormaps["viridis"](0.9 * number / max(len(group) - 1, 1))
            reach = f"{entry.metadata['distance_km']:g} km"
            spectrum = spectral_acceleration(load_motion(entry), grid)
            axis.loglog(grid, spectrum, color=colour, lw=1.0, label=reach)
            for model, style in zip(MODELS, ("--", ":", "-.")):
                axis.loglog(grid, np.exp(beside(entry, model, grid)), style, color=colour, lw=0.8)
        axis.set(title=f"M {magnitude:g}", xlabel="period [s]")
        axis.legend(fontsize=6, loc="lower left")
        axis.grid(True, which="major", lw=0.3)
    figure.axes[0].set_ylabel("Sa, 5 % [m/s²]")
    figure.savefig(FOLDER / "spectra.svg", metadata={"Date": None})


def draw_scatter(entries):
    """Standard deviation of ln Sa: of the suite about the models, of the method, and published."""
    grid = np.geomspace(0.05, 5.0, 25)
    shipped = [
        np.log(spectral_acceleration(load_motion(entry), grid))
        - np.mean([beside(entry, model, grid) for model in MODELS[:2]], axis=0)
        for entry in entries
    ]
    recipes = (Recipe(6.5, 20.0, seed) for seed in range(10 * SEEDS))
    made = [spectral_acceleration(make_motion(recipe), grid) for recipe in recipes]
    figure = Figure(figsize=(5, 3.2), layout="tight")
    axis = figure.subplots()
    axis.semilogx(grid, np.std(shipped, axis=0, ddof=1), "o-", ms=3, label="shipped motions")
    deviation = np.log(made).std(axis=0, ddof=1)
    axis.semilogx(grid, deviation, "k-", label="method, M 6.5, 20 km")
    for model, style in zip((*MODELS, "CB14"), ("--", ":", "-.", (0, (1, 4)))):
        published = predicted(model, 6.5, 20.0, VS30, grid)[1]
        axis.semilogx(grid, published, ls=style, label=f"{model}, total")
    axis.set(ylim=(0.0, 1.1), xlabel="period [s]", ylabel="standard deviation of ln Sa")
    axis.legend(fontsize=6)
    axis.grid(True, which="major", lw=0.3)
    figure.savefig(FOLDER / "scatter.svg", metadata={"Date": None})


def main():
    """Write the table, the figures and the tables of the README."""
    entries = [e for e in load_index(FOLDER) if e.metadata.get("seed") is not None]
    ratios = ratios_of_suite(entries)
    with open(FOLDER / "spectra.csv", "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["id", "model", *(f"ratio_Sa_{period:g}s" for period in PERIODS)])
        for model, rows in ratios.items():
            writer.writerows(
                [id, model, *(f"{r:.3f}" for r in np.exp(row))] for id, row in rows.items()
            )
    with matplotlib.rc_context({"svg.hashsalt": "archfrag", "font.size": 8}):
        draw_spectra(entries)
        draw_scatter(entries)
    readme = FOLDER / "README.md"
    before, after = readme.read_text(encoding="utf-8").split(BEGIN)
    tables = f"{suite_table(entries, ratios)}\n\n{method_table()}"
    text = f"{before}{BEGIN}\n{tables}\n{END}{after.split(END)[1]}"
    readme.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
