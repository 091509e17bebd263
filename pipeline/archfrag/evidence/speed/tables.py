"""What the points say: exponents, auto against the cheapest, ours against peers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pandas as pd

from archfrag.evidence.speed.horizon import slope_interval
from archfrag.methods.registry import AUTO

ALLOWED = 1.5
# What auto chooses among. The baselines are there to be compared with: a model that is cheap
# because it leaves things out is no way to the right answer, however seldom it overlaps.
OWN = ("time_stepping", "event_driven", AUTO)
# Errors that lie closer together than this say nothing of how cost grows.
LEAST_SPAN = 2.0
AUTO_COLUMNS = (
    "scene", "quantity", "level", "cheapest", "cheapest_cost", "auto", "auto_cost", "ratio",
    "least_ratio", "flag",
)  # fmt: skip
EXPONENT_COLUMNS = (
    "method", "quantity", "scenes", "points", "at_floor", "exponent", "low", "high",
)  # fmt: skip
# By which limits of auto are weighed: what users ask for, and what no chaos blurs.
WEIGHED = ("amplitude", "peak", "verdicts")
LIMIT_COLUMNS = (
    "way", "quantity", "scenes", "cost_ratio", "cost_least", "cost_most", "error_ratio",
    "error_least", "error_most",
)  # fmt: skip
AGAINST_COLUMNS = (
    "scene", "quantity", "peer", "level", "peer_cost", "cheapest", "cheapest_cost", "auto_cost",
    "peer_over_cheapest", "peer_over_auto",
)  # fmt: skip


def kept_errors(points: pd.DataFrame) -> pd.DataFrame:
    """Charted points with the error that a line keeps: the largest at this or a finer setting.

    A coarse setting that is right by luck, where its error changes sign, is thereby no way to
    that error. Errors below the floor stand at the floor.

    Parameters
    ----------
    points : DataFrame

    Returns
    -------
    DataFrame
        The charted ones, with a column `kept`.
    """
    frame = _floored(points).sort_values(["scene", "quantity", "line", "place"])
    finer = frame.iloc[::-1].groupby(["scene", "quantity", "line"], sort=False)["kept"].cummax()
    frame["kept"] = finer.iloc[::-1]
    return frame.reset_index(drop=True)


def _floored(points: pd.DataFrame) -> pd.DataFrame:
    """Charted points, with their errors at the floor where they lie below it as `kept`."""
    frame = points[points["charted"].astype(bool)]
    return frame.assign(kept=np.maximum(frame["error"], frame["floor"]))


def cheapest_at(points: pd.DataFrame, level: float, cost: str = "cost") -> tuple[str, float]:
    """Cheapest way to an error of at most `level`, and its cost [s]; infinite if there is none.

    Parameters
    ----------
    points : DataFrame
        Of one scene and quantity, with `kept`.
    level : float
    cost : str
        "cost" for medians, "least_cost" for the least of the runs.
    """
    enough = points[points["kept"] <= level * (1.0 + 1e-9)]
    if enough.empty:
        return "", math.inf
    best: Any = enough.iloc[int(enough[cost].to_numpy().argmin())]
    way = str(best["way"])
    return (way if best["who"] == "peer" else f"{best['line']}: {way}"), float(best[cost])


def own_points(points: pd.DataFrame) -> pd.DataFrame:
    """Points of the methods that auto chooses among, limits of auto apart."""
    return points[(points["who"] == "ours") & points["method"].isin(OWN)]


def auto_table(points: pd.DataFrame) -> pd.DataFrame:
    """Cost of auto over the cheapest of our methods, at each decade of error.

    Parameters
    ----------
    points : DataFrame

    Returns
    -------
    DataFrame
        A row for each level that any of ours reaches. `ratio` is that of median times,
        `least_ratio` that of the least; `flag` where both are above 1.5, so that a neighbour on
        the machine flags nothing.
    """
    ours = kept_errors(own_points(points))
    rows: list[tuple[Any, ...]] = []
    for (scene, quantity), group in ours.groupby(["scene", "quantity"], sort=False):
        by_auto = group[group["method"] == AUTO]
        for level in _levels(group["kept"]):
            cheapest, cost = cheapest_at(group, level)
            if math.isinf(cost):
                continue
            auto, auto_cost = cheapest_at(by_auto, level)
            least = cheapest_at(by_auto, level, "least_cost")[1]
            least /= cheapest_at(group, level, "least_cost")[1]
            ratio = auto_cost / cost
            flag = min(ratio, least) > ALLOWED
            rows.append(
                (scene, quantity, level, cheapest, cost, auto, auto_cost, ratio, least, flag)
            )
    return pd.DataFrame(rows, columns=list(AUTO_COLUMNS))


def _levels(errors: pd.Series) -> list[float]:
    """Decades that a chart spans, the coarse ones first."""
    low = math.ceil(math.log10(float(errors.min())) - 1e-9)
    high = min(-1, math.ceil(math.log10(float(errors.max()))))
    return [10.0**k for k in range(max(high, low), low - 1, -1)]


def exponents(points: pd.DataFrame) -> pd.DataFrame:
    """Growth of cost with 1/error: one slope over all scenes, each with its own constant.

    Parameters
    ----------
    points : DataFrame

    Returns
    -------
    DataFrame
        `exponent` p of cost = C error^-p and its 90 % interval by Student's t, for each line and
        quantity; points at the floor (`at_floor` of them) and those with an error above 1 are left
        out, and so is a scene with a single point left; nan where no scene is left.
    """
    frame = points[points["charted"].astype(bool) & (points["who"] != "limit")]
    rows = []
    for (line, quantity), whole in frame.groupby(["line", "quantity"], sort=False):
        group = whole[~whole["at_floor"].astype(bool)]
        group = group[(group["error"] > 0.0) & (group["error"] < 1.0)]
        x, y, scenes = [np.zeros(0)], [np.zeros(0)], 0
        for _, part in group.groupby("scene"):
            if len(part) < 2 or part["error"].max() < LEAST_SPAN * part["error"].min():
                continue
            scenes += 1
            inverse, cost = -np.log(part["error"].to_numpy()), np.log(part["cost"].to_numpy())
            x.append(inverse - inverse.mean())
            y.append(cost - cost.mean())
        flat_x, flat_y = np.concatenate(x), np.concatenate(y)
        slope = slope_interval(flat_x, flat_y, lost=scenes + 1)
        at_floor = int(whole["at_floor"].astype(bool).sum())
        rows.append((line, quantity, scenes, flat_x.size, at_floor, *slope))
    return pd.DataFrame(rows, columns=list(EXPONENT_COLUMNS))


def limits_table(points: pd.DataFrame) -> pd.DataFrame:
    """Each limit of auto changed alone, beside its default at the same tolerance.

    Parameters
    ----------
    points : DataFrame

    Returns
    -------
    DataFrame
        A row for each way and quantity of `WEIGHED`: geometric means over the scenes, and the
        least and the largest, of its cost and of its error over those of the default. Errors
        below the floor stand at the floor.
    """
    frame = _floored(points[points["quantity"].isin(WEIGHED)])
    usual = frame[frame["line"] == AUTO]
    changed = frame[frame["who"] == "limit"]
    rows: list[tuple[Any, ...]] = []
    for (way, quantity), part in changed.groupby(["way", "quantity"], sort=False):
        beside = usual[usual["way"] == str(way).split(",")[0]]
        both = part.merge(beside, on=["scene", "quantity"], suffixes=("", "_usual"))
        if both.empty:
            continue
        row: list[Any] = [way, quantity, len(both)]
        for name in ("cost", "kept"):
            ratio = (both[name] / both[f"{name}_usual"]).to_numpy()
            row += [float(np.exp(np.log(ratio).mean())), float(ratio.min()), float(ratio.max())]
        rows.append(tuple(row))
    return pd.DataFrame(rows, columns=list(LIMIT_COLUMNS))


def against_peers(points: pd.DataFrame) -> pd.DataFrame:
    """At every error that a peer reaches: its cost over that of our cheapest, and of auto.

    Parameters
    ----------
    points : DataFrame

    Returns
    -------
    DataFrame
        A ratio below one is a level at which the peer is faster; zero where none of ours on the
        chart reaches the level.
    """
    kept = []
    for _, part in points.groupby("who"):
        kept.append(kept_errors(part))
    frame = pd.concat(kept) if kept else points
    rows = []
    for (scene, quantity), group in frame.groupby(["scene", "quantity"], sort=False):
        ours = own_points(group)
        theirs: Any = group[group["who"] == "peer"].groupby(["line", "kept"])
        for (peer, level), part in theirs:
            cost = float(part["cost"].min())
            best, best_cost = cheapest_at(ours, float(level))
            auto_cost = cheapest_at(ours[ours["method"] == AUTO], float(level))[1]
            rows.append(
                (scene, quantity, peer, level, cost, best, best_cost, auto_cost,
                 cost / best_cost, cost / auto_cost)
            )  # fmt: skip
    return pd.DataFrame(rows, columns=list(AGAINST_COLUMNS))
