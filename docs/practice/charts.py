"""Charts and tables for the practitioner, each from runs that the page makes."""

import json
from collections.abc import Sequence
from pathlib import Path

import look
import numpy as np
import pandas as pd
from IPython.display import HTML
from matplotlib.figure import Figure
from showing import ROOT, table

import archfrag as af
from archfrag.arch import STANDARD_GRAVITY as G
from archfrag.report.svg import BLUE, GREY, INK, VERMILION
from archfrag.study.file.schema import load_study

STEP = 0.005  # of motions [s]
MOST = 12.0  # times the onset, up to which pulses are tried
ENTRY = load_study(ROOT / "configs" / "shipped.yaml").members[0].entry


def shipped(**changes: object) -> af.Arch:
    """The arch of the shipped study with some of its keys changed."""
    return ENTRY.model_copy(update=changes).build()


def pulse(duration: float) -> af.Motion:
    """One period of a sine of 1 g."""
    time = np.arange(0.0, duration + 0.5, STEP)
    wave = np.sin(2.0 * np.pi * time / duration) * (time < duration)
    return af.Motion(G * wave, dt=STEP)


def collapses_from(arch: af.Arch, duration: float, count: int = 40) -> float:
    """Least peak of a pulse that causes collapse, of peaks 7 % apart from the onset on [g]."""
    peaks = af.onset(arch).plus * np.geomspace(1.0, MOST, count)
    collapsed = af.simulate_many(arch, pulse(duration), peaks).collapsed.values
    return float(peaks[collapsed.argmax()]) if collapsed.any() else np.nan


def _axes(height: float = 3.2) -> tuple[Figure, object]:
    figure = Figure((look.WIDTH, height), layout="constrained")
    axes = figure.subplots()
    axes.grid(True)
    axes.set_axisbelow(True)
    return figure, axes


def resistance() -> HTML:
    """How the resistance of a block falls as it tilts."""
    figure, axes = _axes(2.8)
    angle = np.arctan(0.2)  # of the diagonal of a block five times as high as wide
    tilt = np.linspace(0.0, 1.15, 50)
    axes.plot(100.0 * tilt, np.tan(angle * (1.0 - tilt)), color=BLUE, lw=2.0)
    axes.plot([0.0], [np.tan(angle)], "o", color=VERMILION)
    axes.annotate("onset: it begins to rock", (0.0, np.tan(angle)), (10, 2),
                  textcoords="offset points", color=VERMILION)  # fmt: skip
    axes.plot([100.0], [0.0], "o", color=INK)
    axes.annotate("it falls by itself", (100.0, 0.0), (6, 8), textcoords="offset points")
    axes.axhline(0.0, color=GREY, lw=0.7)
    axes.set(xlabel="rotation (% of that at which it falls by itself)",
             ylabel="steady acceleration it resists (g)")  # fmt: skip
    return look.picture(
        look.svg_of(figure),
        "A block five times as high as wide. Its resistance is largest at the start and falls as "
        "it tilts.",
    )


def rocking(peak: float = 0.4) -> HTML:
    """Rotation of a block that a pulse sets off and that comes to rest by impacts."""
    block = af.Block(width=0.6, height=3.0, friction=0.8)
    history = af.simulate(block, pulse(0.5), scale=peak, history=True).history
    time, angle = history.time.values, np.degrees(history.rotation.values[:, 0])
    figure, axes = _axes(2.8)
    axes.plot(time, angle, color=BLUE)
    axes.axhline(0.0, color=GREY, lw=0.7)
    axes.set(xlabel="time (s)", ylabel="rotation (degrees)", xlim=(0.0, min(time[-1], 8.0)))
    return look.picture(
        look.svg_of(figure),
        f"A block of 0.6 by 3.0 m after one sine pulse of 0.5 s and {peak:g} g. At each "
        "zero it changes the edge on which it stands and loses energy by an impact.",
    )


def short_pulses() -> HTML:
    """How many times the onset a pulse must reach to cause collapse."""
    arch, durations = shipped(), [0.2, 0.25, 0.3, 0.4, 0.5, 0.7, 1.0, 1.5, 2.0]
    onset = af.onset(arch).plus
    ratio = np.array([collapses_from(arch, each) for each in durations]) / onset
    figure, axes = _axes()
    axes.plot(durations, ratio, color=VERMILION, marker="o", ms=4.5)
    axes.axhline(1.0, color=INK, ls="--", lw=0.9)
    axes.annotate(f"onset, {onset:.2g} g", (durations[0], 1.0), (0, 4), textcoords="offset points")
    axes.set(xscale="log", xlabel="duration of the pulse (s)", ylim=(0.0, None),
             ylabel="least peak that causes collapse / onset")  # fmt: skip
    axes.set_xticks(durations, [f"{each:g}" for each in durations])
    axes.minorticks_off()
    known = np.isfinite(ratio)
    words = f"from {ratio[known][0]:.1f} times the onset to {ratio[known][-1]:.1f} times"
    return look.picture(
        look.svg_of(figure),
        f"The arch of the shipped study under one period of a sine: {words}, as the "
        "pulse becomes longer.",
    )


def voussoirs(counts: Sequence[int] = (7, 11, 15, 21, 31, 41)) -> HTML:
    """Onset and collapse against the number of voussoirs."""
    arches = [shipped(voussoirs=count) for count in counts]
    return table(pd.DataFrame({
        "voussoirs": counts,
        "onset [g]": [af.onset(arch).plus for arch in arches],
        "collapse under a pulse of 0.5 s from [g]": [collapses_from(arch, 0.5) for arch in arches],
        "of 1 s from [g]": [collapses_from(arch, 1.0) for arch in arches],
    }))  # fmt: skip


def thickness(factors: Sequence[float] = (0.9, 1.0, 1.1)) -> HTML:
    """Onset and collapse against thickness."""
    arches = [shipped(thickness=factor * ENTRY.thickness) for factor in factors]
    return table(pd.DataFrame({
        "thickness [m]": [arch.parameters["thickness"] for arch in arches],
        "onset [g]": [af.onset(arch).plus for arch in arches],
        "collapse under a pulse of 0.5 s from [g]": [collapses_from(arch, 0.5) for arch in arches],
        "of 1 s from [g]": [collapses_from(arch, 1.0) for arch in arches],
    }))  # fmt: skip


def friction() -> HTML:
    """Onset and collapse against friction."""
    values = np.array([0.28, 0.3, 0.32, 0.35, 0.4, 0.5, 0.6, 0.8, 1.0])
    arches = [shipped(friction=float(value)) for value in values]
    stands = np.array([af.onset(arch).stands for arch in arches])
    shown = [arch for arch, good in zip(arches, stands) if good]
    onset = [af.onset(arch).plus for arch in shown]
    collapse = [collapses_from(arch, 0.5) for arch in shown]
    figure, axes = _axes()
    axes.plot(values[stands], collapse, color=VERMILION, marker="o", ms=4.5)
    axes.plot(values[stands], onset, color=BLUE, marker="s", ms=4.5)
    for last, words, colour in ((collapse[-1], "collapse, pulse of 0.5 s", VERMILION),
                                (onset[-1], "onset", BLUE)):  # fmt: skip
        axes.annotate(words, (values[-1], last), (0, 5), textcoords="offset points",
                      ha="right", color=colour)  # fmt: skip
    axes.set(xlabel="friction coefficient of the joints", ylabel="acceleration (g)")
    axes.set_ylim(0.0)
    return look.picture(
        look.svg_of(figure),
        "The arch of the shipped study with other friction. The value matters only where joints "
        "slide before they hinge.",
    )


def densities() -> HTML:
    """Two densities give nearly the same motion."""
    rows = [(f"{rho:g}", af.onset(shipped(density=rho)).plus,
             collapses_from(shipped(density=rho), 0.5)) for rho in (1500.0, 2500.0)]  # fmt: skip
    names = ["density [kg/m³]", "onset [g]", "collapse under a pulse of 0.5 s from [g]"]
    return table(pd.DataFrame(rows, columns=names))


def filled(height: float = 0.5, unit_weight: float = 18e3) -> tuple[af.Arch, list[float]]:
    """The shipped arch with the weight of a level fill [N/m3] on its back; loads [N]."""
    bare = shipped(joints=None)  # contact points at the very edges
    back = bare.extrados
    top = back[:, 1].max() + height
    width, middle = np.abs(np.diff(back[:, 0])), 0.5 * (back[1:, 1] + back[:-1, 1])
    loads = (unit_weight * bare.parameters["depth"] * width * (top - middle)).tolist()
    return shipped(dead_load=loads), loads


def fill() -> HTML:
    """Bare ring against ring with the weight of a fill."""
    ring, (heavy, loads) = shipped(), filled()
    weight = float(ring.chain.mass.sum()) * G
    both = ("bare ring", ring, 0.0), ("with dead_load", heavy, sum(loads) / weight)
    rows = [(name, added, af.onset(arch).plus, collapses_from(arch, 0.5),
             collapses_from(arch, 1.0)) for name, arch, added in both]  # fmt: skip
    names = ["arch", "added weight / weight of the ring", "onset [g]",
             "collapse under a pulse of 0.5 s from [g]", "of 1 s from [g]"]  # fmt: skip
    return table(pd.DataFrame(rows, columns=names))


def stresses(strengths: Sequence[float] = (1.0, 2.0, 5.0, 10.0)) -> HTML:
    """Depth of a joint that a hinge would crush, for strengths in MPa."""
    arch = shipped()
    peak = 1.5 * af.onset(arch).plus
    reaction = af.simulate(arch, pulse(0.5), scale=peak, history=True).history.reaction.values
    depth = arch.parameters["depth"]
    joint = ENTRY.thickness
    force = float(np.linalg.norm(reaction[0], axis=-1).max())
    crushed = [force / (1e6 * each * depth) for each in strengths]
    rows = [(f"{each:g}", 1e3 * c, 100.0 * c / joint) for each, c in zip(strengths, crushed)]
    names = ["strength [MPa]", "crushed depth at a hinge [mm]", "of the joint [%]"]
    return HTML(
        f"<p>At rest the largest joint force of the shipped arch is {force / 1e3:.0f} kN per "
        f"{depth:g} m of depth, a mean stress of {force / (1e6 * joint * depth):.2f} MPa.</p>"
        + table(pd.DataFrame(rows, columns=names)).data
    )


def measures(results: Path) -> HTML:
    """Dispersion of capacity by intensity measure, that of the study marked."""
    fits = json.loads((results / "fits.json").read_text("utf-8"))
    found = next(iter(fits["arches"].values()))["more"]["measures"]
    rows = sorted(found["rows"], key=lambda row: row["efficiency"])
    figure, axes = _axes(0.8 + 0.21 * len(rows))
    colours = [VERMILION if row["measure"] == found["own"] else BLUE for row in rows]
    axes.barh(range(len(rows)), [row["efficiency"] for row in rows], color=colours, height=0.7)
    axes.set_yticks(range(len(rows)), [row["measure"] for row in rows])
    axes.tick_params(axis="y", length=0.0)
    axes.grid(False, axis="y")
    axes.set_xlabel("dispersion of capacity, as a factor on the motion (smaller is better)")
    axes.set_ylim(len(rows) - 0.4, -0.6)
    return look.picture(
        look.svg_of(figure),
        f"Measures of the shipped study, its own ({found['own']}) in orange. Every "
        "report has this comparison.",
    )
