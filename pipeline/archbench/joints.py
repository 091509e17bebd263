"""Joints that give: what rigid joints and an inset leave out of an elastic face, and their cost.

Borders of half sines, the least amplitudes from which an arch falls, and theta of studies with the
shipped motions, each by rigid joints, by contact points inside their ends, and by faces.
"""

import math
import time
import warnings
from collections.abc import Callable, Mapping
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd

import archfrag as af
from archbench.runner import Bench, Row
from archbench.scene import Array
from archbench.solve import RECORDS
from archfrag.errors import ArchfragError, UnitWarning

# Radius, thickness [m], embrace [degrees], voussoirs, friction, height of piers [m]; 0: none.
ARCHES = (
    (5.125, 0.45, 154.64, 21, 0.6, 0),
    (10.0, 0.9, 120, 21, 0.6, 0),
    (5.0, 0.5, 120, 9, 0.8, 0),
    (3.0, 0.33, 160, 27, 0.8, 0),
    (6.0, 0.66, 100, 31, 0.5, 0),
    (4.0, 0.5, 180, 17, 0.7, 0),
    (5.0, 0.6, 90, 13, 0.6, 0),
    (8.0, 1.04, 157, 11, 0.7, 0),
    (12.0, 1.6, 140, 15, 0.6, 0),
    (10.0, 1.5, 157.5, 7, 0.7, 0),
    (6.0, 0.9, 160, 35, 0.7, 0),
    (7.0, 1.1, 180, 21, 0.8, 0),
    (4.0, 0.7, 80, 9, 0.5, 0),
    (4.0, 0.8, 180, 17, 0.7, 0),
    (6.0, 1.2, 140, 41, 0.7, 0),
    (9.0, 1.9, 170, 13, 0.6, 0),
    (5.0, 1.15, 180, 25, 0.7, 0),
    (8.0, 2.0, 180, 11, 0.5, 0),
    (5.0, 0.8, 150, 13, 0.7, 4.0),
    (4.0, 0.6, 120, 9, 0.6, 3.0),
)
STIFFNESS = (3e9, 1e10, 3e10, 1e11, 3e11)  # [Pa/m]
PULSES = (0.1, 0.25, 0.5)  # [s]
LEAST = 0.5  # of the onset; relative width of a border; [s]
CLOSE = 0.01
FOLLOW = 12.0
# Arches of the studies of theta, their stiffness and levels over the border of the longest pulse.
STUDIED = (0, 3, 9, 13, 16)
QUICK_STUDIED = (9,)
STUDIED_STIFFNESS = (3e10, 1e11)
SETS = 4
LEVELS = {True: 16, False: 48}
NAMES = {0: "shipped bridge", 9: "ring of 7 voussoirs"}
MODELS = ("rigid", "inset", "face")
CORNERS = "two corners"  # a face that bears at its ends alone
BINS = (
    0.0,
    0.01,
    0.05,
    0.1,
    0.15,
    0.25,
    0.4,
    1.0,
)  # of the part of the onset that is lost
# Steps and tolerances by which rigid joints of the named arches are also run; the last is exact.
STEPS: dict[str, Row] = {
    "rtol 0.01": {"rtol": 1e-2},
    "rtol 0.001": {"rtol": 1e-3},
    "steps of 1 ms": {"dt": 1e-3},
    "steps of 0.2 ms": {"dt": 2e-4},
}
EXACT = "face", "steps of 0.2 ms"


def arch_of(number: int) -> af.Arch:
    """Build an arch of the table."""
    radius, thickness, embrace, voussoirs, friction, piers = ARCHES[number]
    ring = af.Arch.circular(radius, thickness, embrace, int(voussoirs), friction)
    if not piers:
        return ring
    pier = {"height": piers, "width": 2.5 * thickness, "courses": 2}
    return af.Bridge([ring], ends=pier)


def with_joints(arch: af.Arch, model: Any, stiffness: float) -> af.Arch:
    """Return the arch with joints of one of the models."""
    if model == CORNERS:
        return af.jointed(arch, stiffness, model="face", points=2)
    return arch if model == "rigid" else af.jointed(arch, stiffness, model=model)


def border_of(falls: Callable[[float], bool], start: float) -> float:
    """Return the least level from which an arch falls; nan if none up to 100 times `start`."""
    low = start
    high = start
    while not falls(high):
        low = high
        high = 1.3 * high
        if high > 100.0 * start:
            return math.nan
    if high == start:
        return math.nan
    while high > (1.0 + CLOSE) * low:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if falls(middle) else (middle, high)
    return math.sqrt(low * high)


def half_sine(duration: float) -> af.Motion:
    """Half a sine of 1 g."""
    time = np.arange(0.0, duration + 0.25e-3, 5e-4)
    return af.Motion(9.80665 * np.sin(np.pi * np.minimum(time / duration, 1.0)), 5e-4)


def _falls(arch: af.Arch, motion: af.Motion, level: float) -> bool:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UnitWarning)
        return bool(af.simulate(arch, motion, level, follow=FOLLOW).collapsed)


def border_under(arch: af.Arch, motion: af.Motion, onset: float) -> float:
    """Return the least multiple of a motion from which an arch falls."""
    return border_of(partial(_falls, arch, motion), LEAST * onset)


def borders_of(number: int) -> list[Row]:
    """Measure the borders of one arch."""
    arch = arch_of(number)
    rows = list[Row]()
    onset = af.onset(arch)
    least = min(onset.plus, onset.minus)
    for stiffness in (math.inf, *STIFFNESS):
        for model in MODELS[1:] if math.isfinite(stiffness) else MODELS[:1]:
            row: Row = {"arch": number, "stiffness": stiffness, "model": model}
            try:
                given = with_joints(arch, model, stiffness)
                now = af.onset(given)
            except ArchfragError as reason:
                rows.append({**row, "status": str(reason)[:80]})
                continue
            row["onset_loss"] = 1.0 - min(now.plus, now.minus) / least
            for pulse in PULSES:
                motion = half_sine(pulse)
                began = time.process_time()
                border = border_under(given, motion, min(now.plus, now.minus))
                spent = time.process_time() - began
                rows.append({**row, "pulse": pulse, "border": border, "seconds": spent})
    return rows


def studies_of(
    arches: Mapping[str, tuple[af.Arch, Row]], levels: Array, head: Row
) -> list[Row]:
    """Fit theta of arches under the shipped motions at the same levels, all in turn.

    Each name has an arch and options of `simulate_many`.
    """
    motions = list(af.read_motions(f"{RECORDS}/synthetic/*"))
    collapsed: dict[str, list[int]] = {name: [] for name in arches}
    failed = dict.fromkeys(arches, 0)
    spent = dict.fromkeys(arches, 0.0)
    for level in levels:
        factors = [level * 9.80665 / motion.pga for motion in motions]
        for name, (arch, options) in arches.items():
            began = time.process_time()
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UnitWarning)
                runs = af.simulate_many(arch, motions, factors, **options)
            status = runs["status"].values
            spent[name] += time.process_time() - began
            collapsed[name].append(int((status == "collapsed").sum()))
            failed[name] += int((~np.isin(status, ("collapsed", "standing"))).sum())
    rows = list[Row]()
    for name in arches:
        curve = af.fit_stripes(levels, collapsed[name], len(motions))
        found: Row = {"theta": curve.theta, "beta": curve.beta, "failed": failed[name]}
        found["seconds"] = spent[name] / (len(levels) * len(motions))
        rows.append({**head, "model": name, **found})
    return rows


def levels_of(arch: af.Arch, part: int, quick: bool) -> Array:
    """One of `SETS` of levels about the border of the longest pulse [g]."""
    middle = border_under(arch, half_sine(PULSES[-1]), af.onset(arch).plus)
    return middle * np.geomspace(0.5, 3.0, LEVELS[quick])[part::SETS]


def theta_of(number: int, stiffness: float, part: int, quick: bool) -> list[Row]:
    """Fit theta of one arch by each model, or of rigid joints by other steps."""
    arch = arch_of(number)
    ways = (
        {
            model: (with_joints(arch, model, stiffness), {})
            for model in (*MODELS, CORNERS)
        }
        if math.isfinite(stiffness)
        else {name: (arch, options) for name, options in STEPS.items()}
    )
    head = {"arch": number, "stiffness": stiffness, "set": part}
    return studies_of(ways, levels_of(arch, part, quick), head)


def measure(bench: Bench) -> dict[str, pd.DataFrame]:
    """Borders and theta of all arches, and how far each model is from the face."""
    numbers = range(0, len(ARCHES), 4 if bench.quick else 1)
    borders = bench.rows("joints", borders_of, {(n,): (n,) for n in numbers}, 0.4)
    quick = bench.quick
    tasks = {
        (number, stiffness, part): (number, stiffness, part, quick)
        for part in range(SETS)
        for number in (QUICK_STUDIED if quick else STUDIED)
        for stiffness in (*STUDIED_STIFFNESS, math.inf)
        if math.isfinite(stiffness) or number in NAMES
    }
    theta = bench.rows("joints_theta", theta_of, tasks)
    return {
        "errors": errors_table(borders) if len(borders) else borders,
        "models": models_table(theta) if len(theta) else theta,
    }


def models_table(theta: pd.DataFrame) -> pd.DataFrame:
    """Error of ln theta of each model and step, over sets, with the cost of a run."""
    keys = ["arch", "stiffness", "set"]
    exact = theta[theta["model"].isin(EXACT)].set_index(keys)["theta"]
    rows = []
    for (arch, stiffness, model), group in theta.groupby(
        ["arch", "stiffness", "model"], sort=False
    ):
        ratio = (group.set_index(keys)["theta"] / exact).dropna()
        off = np.log(ratio.to_numpy())
        rows.append(
            {
                "arch": arch,
                "stiffness": stiffness,
                "model": model,
                "error": off.mean(),
                "standard_error": off.std(ddof=1) / off.size**0.5,
                "theta": group["theta"].mean(),
                "seconds": group["seconds"].mean(),
                "failed": group["failed"].max(),
            }
        )
    return pd.DataFrame(rows)


def errors_table(borders: pd.DataFrame) -> pd.DataFrame:
    """Compare the borders of rigid joints and of the inset with those of the face."""
    keys = ["arch", "stiffness", "pulse"]
    of = {model: borders[borders["model"] == model] for model in MODELS}
    table = of["face"][[*keys, "border", "seconds"]].merge(
        of["inset"][[*keys, "border", "onset_loss", "seconds"]],
        "left",
        keys,
        suffixes=("_face", "_inset"),
    )
    rigid = of["rigid"][["arch", "pulse", "border", "seconds"]]
    table = table.merge(rigid, "left", ["arch", "pulse"])
    for model, name in (("rigid", "border"), ("inset", "border_inset")):
        table[f"error_{model}"] = table[name] / table["border_face"] - 1.0
    return table.dropna(subset=["border_face"])


def left_out_bins(errors: pd.DataFrame) -> pd.DataFrame:
    """Count by the part of the onset that the inset takes how often each model is close enough."""
    rows = []
    for low, high in pairwise(BINS):
        part = errors[(errors["onset_loss"] > low) & (errors["onset_loss"] <= high)]
        rigid = part["error_rigid"].abs()
        inset = part["error_inset"].abs()
        rows.append(
            {
                "onset lost from": low,
                "to": high,
                "cases": len(part),
                "rigid within 2 %": int((rigid <= 0.02).sum()),
                "rigid within 5 %": int((rigid <= 0.05).sum()),
                "inset within 5 %": int((inset <= 0.05).sum()),
                "worst of inset": inset.max(),
            }
        )
    return pd.DataFrame(rows)
