"""How the cost of a simulated second of motion grows with the number of voussoirs.

The pulse of the scene `arch7_pulse` on the same arch cut into more and more equal voussoirs, from
the start to a fixed instant; every method at its defaults, turn and turn about.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator
from scipy import stats

import archfrag as af
from archfrag.errors import InputError
from archfrag.evidence.part import Frames, Note, Section, Setup
from archfrag.evidence.peers.client import Peer, PeerFailed, PeerMissing
from archfrag.evidence.run import arch_of, compile_seconds, motion_of
from archfrag.evidence.scene import Scene, load_scene
from archfrag.report import canvas
from archfrag.report.canvas import faint_grid, picture
from archfrag.report.styles import method_style
from archfrag.simulation.checks import available_methods
from archfrag.simulation.response import Response

NUMBERS = {True: (7, 10, 14, 20, 27, 38, 54), False: (7, 10, 14, 20, 27, 38, 54, 81, 108)}
TURNS = {True: 5, False: 9}
SECONDS = 1.5
PEER_STEP = 1e-3
# A run that by the last two would take longer is not begun [s of CPU].
LONGEST = {True: 2.0, False: 40.0}
CONFIDENCE = 0.9


class Cost(NamedTuple):
    """One timed run."""

    method: str
    voussoirs: int
    turn: int
    cpu_seconds: float
    moving_seconds: float
    steps: int
    ended: str


def scene_of(voussoirs: int) -> Scene:
    """The pulse on the arch cut into so many equal voussoirs."""
    scene = load_scene("arch7_pulse")
    return replace(
        scene,
        name=f"arch{voussoirs}_pulse",
        title=f"Arch of {voussoirs} voussoirs under a pulse",
        chain={**scene.chain, "voussoirs": voussoirs},
        duration=SECONDS,
    )


def timed(method: str, voussoirs: int, turn: int) -> Cost:
    """Run a method at its defaults.

    The CPU time is that of the method: the process's, times the method's part of the wall time,
    so that neither other processes nor the checks around the method count.
    """
    scene = scene_of(voussoirs)
    arch, motion = arch_of(scene), motion_of(scene)
    length = motion.dt * (motion.acceleration.size - 1)
    wall, cpu = time.perf_counter(), time.process_time()
    response: Response = af.simulate(arch, motion, method=method, follow=SECONDS - length)
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    return Cost(
        method,
        voussoirs,
        turn,
        cpu * response.wall_time / wall,
        response.end_time - response.model_time["rest"],
        response.steps,
        response.status.name.lower(),
    )


def timed_peer(peer: Peer, voussoirs: int, turn: int) -> Cost:
    """Run a peer with steps of `PEER_STEP`."""
    found = peer.run(scene_of(voussoirs), PEER_STEP)
    ended = "collapsed" if found.collapsed else "unfinished"
    return Cost(
        peer.name, voussoirs, turn, found.cpu_seconds, found.simulated_seconds, found.steps, ended
    )


def measure(setup: Setup) -> dict[str, pd.DataFrame]:
    """Time all methods, and the peers asked for, in one process.

    Parameters
    ----------
    setup : Setup

    Returns
    -------
    dict of str to DataFrame
        `runs`, every timed run; `exponents`, a row for each method; `left_out`, and why.
    """
    methods = list(available_methods())
    compile_seconds(methods)
    peers: dict[str, Peer] = {}
    left_out: list[tuple[str, str, str]] = []
    for name in setup.peers:
        try:
            peers[name] = Peer(name)
        except PeerMissing as reason:
            left_out.append((name, "all", str(reason)))
    numbers = NUMBERS[setup.quick]
    try:
        costs = _interleaved(methods, peers, numbers, setup.quick, left_out)
    finally:
        for peer in peers.values():
            peer.close()
    runs = pd.DataFrame(costs, columns=Cost._fields)
    return {
        "runs": runs,
        "exponents": exponents_table(runs),
        "left_out": pd.DataFrame(left_out, columns=["method", "voussoirs", "reason"]),
    }


def _interleaved(
    methods: Sequence[str],
    peers: Mapping[str, Peer],
    numbers: Sequence[int],
    quick: bool,
    left_out: list[tuple[str, str, str]],
) -> list[Cost]:
    """All runs, turn about; the first turn warms up and tells what can be afforded."""
    first: dict[str, list[Cost]] = {name: [] for name in (*methods, *peers)}
    costs: list[Cost] = []
    for turn in range(-1, TURNS[quick]):
        for number in numbers:
            for name, seen in first.items():
                if turn < 0:
                    reason = _too_long(seen, number, LONGEST[quick])
                    if reason:
                        left_out.append((name, str(number), reason))
                        continue
                elif number not in [cost.voussoirs for cost in seen]:
                    continue
                try:
                    run = peers.get(name)
                    cost = (
                        timed(name, number, turn)
                        if run is None else timed_peer(run, number, turn)
                    )  # fmt: skip
                except (PeerFailed, InputError) as reason:
                    left_out.append((name, str(number), str(reason)))
                    continue
                if turn < 0:
                    seen.append(cost)
                else:
                    costs.append(cost)
    return costs


def _too_long(seen: Sequence[Cost], number: int, longest: float) -> str:
    """Why a run is not begun; empty if it is."""
    if not seen:
        return ""
    power = 2.0
    if len(seen) > 1 and min(seen[-1].cpu_seconds, seen[-2].cpu_seconds) > 0.0:
        power = max(1.0, math.log(seen[-1].cpu_seconds / seen[-2].cpu_seconds)
                    / math.log(seen[-1].voussoirs / seen[-2].voussoirs))  # fmt: skip
    expected = seen[-1].cpu_seconds * (number / seen[-1].voussoirs) ** power
    return f"would take about {expected:.0f} s, more than {longest:g} s" * (expected > longest)


def exponents_table(runs: pd.DataFrame) -> pd.DataFrame:
    """Exponent of a power law through the medians, with a 90 % interval (Student's t).

    Parameters
    ----------
    runs : DataFrame
        Of `measure`.

    Returns
    -------
    DataFrame
        Columns method, least, most (numbers of voussoirs), numbers (how many), exponent, low,
        high (nan with fewer than three), steps_exponent (of the number of steps), at_least (cost
        of the least) and at_most [CPU s for a second of motion].
    """
    rows = []
    for method, group in runs[runs["moving_seconds"] > 0.0].groupby("method", sort=False):
        cost = medians(group)
        steps = group.groupby("voussoirs")["steps"].median()
        row = {
            "method": method, "least": cost.index[0], "most": cost.index[-1],
            "numbers": len(cost), "exponent": np.nan, "low": np.nan, "high": np.nan,
            "steps_exponent": np.nan,
            "at_least": cost.iloc[0], "at_most": cost.iloc[-1],
        }  # fmt: skip
        if len(cost) > 1:
            numbers = np.log(cost.index.to_numpy(float))
            fit = stats.linregress(numbers, np.log(cost.to_numpy()))
            row["exponent"] = fit.slope
            if steps.min() > 0.0:
                row["steps_exponent"] = stats.linregress(numbers, np.log(steps.to_numpy())).slope
            if len(cost) > 2:
                reach = stats.t.ppf(0.5 + 0.5 * CONFIDENCE, len(cost) - 2) * fit.stderr
                row |= {"low": fit.slope - reach, "high": fit.slope + reach}
        rows.append(row)
    return pd.DataFrame(rows)


def medians(group: pd.DataFrame) -> pd.Series:
    """Median cost of a second of motion by number of voussoirs [CPU s/s]."""
    cost = group["cpu_seconds"] / group["moving_seconds"]
    return cost.groupby(group["voussoirs"]).median()


def show(frames: Frames) -> Section:
    """Section of the guide, made from the tables of `measure`."""
    runs, exponents = frames["runs"], frames["exponents"]
    runs = runs[runs["moving_seconds"] > 0.0]
    numbers = sorted(runs["voussoirs"].unique())

    def draw(figure: Figure) -> None:
        axes: Axes = figure.subplots()
        for method, group in runs.groupby("method", sort=False):
            label, colour, marker, _ = method_style(str(method))
            cost = medians(group)
            row = exponents[exponents["method"] == method].iloc[0]
            axes.plot(cost.index, cost, marker=marker, color=colour, markersize=5,
                      label=f"{label}: {_power(row)}")  # fmt: skip
            each = group["cpu_seconds"] / group["moving_seconds"]
            axes.plot(group["voussoirs"], each, ".", color=colour, markersize=2.5, alpha=0.5)
        axes.axhline(1.0, color=canvas.INK, linestyle=(0, (5, 3)), linewidth=0.9)
        axes.annotate("as fast as it happens", (numbers[0], 1.0), (0, 3), fontsize=7.5,
                      textcoords="offset points")  # fmt: skip
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.xaxis.set_major_locator(FixedLocator([float(number) for number in numbers]))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.set_xlabel("voussoirs")
        axes.set_ylabel("CPU seconds for a second of motion")
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
        faint_grid(axes)

    shown = picture(
        "growth",
        (canvas.WIDTH, 3.2),
        draw,
        alternative="CPU seconds for a second of motion against the number of voussoirs.",
        caption=(
            f"An arch cut into equal voussoirs, pulse of 0.5 g, the first {SECONDS:g} s; each "
            "method at its defaults. Lines: medians; dots: single runs. n to the power of: "
            "slope of the line of least squares, with its 90 % interval."
        ),
    )
    rows = tuple(
        (
            method_style(row["method"]).label, f"{row['least']:g} to {row['most']:g}",
            _power(row), f"n^{round(row['steps_exponent'], 2) + 0.0:.2f}",
            f"{row['at_least']:.3g}", f"{row['at_most']:.3g}",
        )
        for _, row in exponents.iterrows()
    )  # fmt: skip
    turns = runs.groupby(["method", "voussoirs"]).size().min()
    notes = [
        Note(
            "Growth in the number of voussoirs",
            f"Medians of {turns} or more runs, all methods in turn in one process; CPU time. More "
            "voussoirs also move otherwise: more joints open and close, which methods that locate "
            "events pay for in steps; the rest of the exponent is what a step costs.",
            (
                "method",
                "voussoirs",
                "cost",
                "of it steps",
                "at the least (CPU s/s)",
                "at the most (CPU s/s)",
            ),
            rows,
        )
    ]
    if len(frames["left_out"]):
        left = tuple(tuple(map(str, row)) for row in frames["left_out"].to_numpy())
        notes.append(Note("Left out", "What was not run.", ("method", "voussoirs", "why"), left))
    lead = [
        "Cost of a second of motion: "
        + "; ".join(
            f"{method_style(row['method']).label} {_power(row)}" for _, row in exponents.iterrows()
        )
        + "."
    ]
    return Section("Growth with the number of voussoirs", lead, {"growth": shown}, notes)


def _power(row: pd.Series) -> str:
    if not np.isfinite(row["exponent"]):
        return "one number only"
    if not np.isfinite(row["low"]):
        return f"n^{row['exponent']:.2f}"
    return f"n^{row['exponent']:.2f} ± {0.5 * (row['high'] - row['low']):.2f}"
