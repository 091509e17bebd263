"""What the runs of `run_ladder.py` say: verdicts, curves, disagreements, shares of the models."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import nnls
from scipy.stats import binomtest

from archfrag.errors import FitError
from archfrag.fragility.fit import Fragility, fit_stripes

MODELS = ("rest", "four_hinges", "mega_voussoirs", "all_voussoirs")
PARTS = (
    "start and rest",
    "between events",
    "events, by levels",
    "events, general contact problem",
    "all voussoirs",
)
VERDICT = {"COLLAPSED": True, "STANDING": False}
Row = dict[str, Any]


class Pair(NamedTuple):
    """One arch, record and level by the judge and by the method judged."""

    arch: str
    record: str
    level: float  # [g]
    judge: Row
    judged: Row

    @property
    def agree(self) -> bool:
        """Whether both name the same verdict; a run without one agrees with nothing."""
        ours = VERDICT.get(self.judged["status"])
        return ours is not None and ours is VERDICT.get(self.judge["status"])


def pairs_of(rows: Iterable[Row], judge: str, judged: str) -> list[Pair]:
    """Cases that both methods have run, in the order of the judge's rows."""
    found: dict[tuple[str, str, str], dict[str, Row]] = defaultdict(dict)
    for row in rows:
        found[row["arch"], row["record"], row["level"]][row["method"]] = row
    return [
        Pair(arch, record, float(level), runs[judge], runs[judged])
        for (arch, record, level), runs in found.items()
        if judge in runs and judged in runs
    ]


def distance_to_agreement(pair: Pair, pairs: Sequence[Pair]) -> float:
    """Change of amplitude to the nearest tried level of equal verdicts, over this level [1].

    inf if there is no such level of this arch and record.
    """
    same = [p.level for p in pairs if p.agree and p[:2] == pair[:2]]
    return min((abs(level - pair.level) / pair.level for level in same), default=np.inf)


def curve_of(rows: Iterable[Row]) -> Fragility | None:
    """Lognormal curve of runs with a verdict; None where they do not determine one."""
    counts: dict[float, list[int]] = defaultdict(lambda: [0, 0])
    for row in rows:
        verdict = VERDICT.get(row["status"])
        if verdict is not None:
            counts[float(row["level"])][0] += verdict
            counts[float(row["level"])][1] += 1
    levels = sorted(counts)
    try:
        return fit_stripes(levels, [counts[x][0] for x in levels], [counts[x][1] for x in levels])
    except FitError:
        return None


def agreement_rows(pairs: Sequence[Pair]) -> list[list[object]]:
    """Share of equal verdicts and both curves, for each arch and for all.

    Where verdicts differ by chance alone, each method has as many of the collapses that the
    other lacks: `p` is the probability of a division as uneven or more (exact sign test).
    """
    rows: list[list[object]] = []
    for arch in dict.fromkeys(pair.arch for pair in pairs):
        part = [pair for pair in pairs if pair.arch == arch]
        cells = _agreement(arch, part)
        curves = [curve_of(p.judge for p in part), curve_of(p.judged for p in part)]
        if None not in curves:
            a, b = curves
            for x, y in ((a.theta, b.theta), (a.beta, b.beta)):
                cells += [f"{x:.4f}", f"{y:.4f}", f"{100 * (y / x - 1):+.2f} %"]
        else:
            cells += ["no curve"] * 6
        rows.append(cells)
    rows.append(_agreement("all", pairs) + [""] * 6)
    return rows


def decided_rows(rows: Iterable[Row], judges: Sequence[str]) -> list[list[object]]:
    """Each method beside the cases that all judges but itself decide alike.

    Where the judges differ, a change that no accuracy can resolve turns the verdict round: the
    other cases are those by which a method can be judged. A judge's own line is what can be
    asked for.
    """
    cases: dict[tuple[str, ...], dict[str, bool | None]] = defaultdict(dict)
    for row in rows:
        case = row["arch"], row["record"], row["level"]
        cases[case][row["method"]] = VERDICT.get(row["status"])
    table: list[list[object]] = []
    for method in dict.fromkeys(name for runs in cases.values() for name in runs):
        others = [judge for judge in judges if judge != method]
        decided, equal = 0, 0
        for runs in cases.values():
            said = {runs.get(judge) for judge in others}
            if len(said) == 1 and None not in said and method in runs:
                decided += 1
                equal += runs[method] in said
        share = f"{100 * equal / decided:.2f} %" if decided else "-"
        table.append([method, len(others), decided, decided - equal, share])
    return table


def _agreement(name: str, pairs: Sequence[Pair]) -> list[object]:
    equal = sum(pair.agree for pair in pairs)
    falls = sum(pair.judge["status"] == "COLLAPSED" for pair in pairs)
    none = [sum(r["status"] not in VERDICT for r in (p.judge, p.judged)) for p in pairs]
    share = f"{100 * equal / len(pairs):.2f} %" if pairs else "-"
    verdicts = [(VERDICT.get(p.judge["status"]), VERDICT.get(p.judged["status"])) for p in pairs]
    only = verdicts.count((True, False)), verdicts.count((False, True))
    chance = binomtest(only[0], sum(only)).pvalue if sum(only) else 1.0
    lean = f"{only[0]} / {only[1]}, p = {chance:.2f}"
    return [name, len(pairs), falls, sum(none), len(pairs) - equal, share, lean]


def number(row: Row, name: str) -> float:
    """A cell as a number; 0 where a run ended without one."""
    return float(row[name]) if row.get(name) not in (None, "") else 0.0


def parts_of(row: Row, step: float) -> dict[str, float]:
    """What the time of a run goes into, by `PARTS`; `step` is that of time stepping [s].

    A hundredth of its steps is allowed to be halved ones.
    """
    stepped = number(row, "all_voussoirs")
    return {
        "start and rest": 1.0,
        "between events": max(number(row, "steps") - round(1.01 * stepped / step), 0.0),
        "events, by levels": max(number(row, "events") - number(row, "general"), 0.0),
        "events, general contact problem": number(row, "general"),
        "all voussoirs": stepped,
    }


def rates_of(rows: Sequence[Row], step: float) -> tuple[dict[str, float], float]:
    """Seconds for one of each of `PARTS`, by regression.

    Kernels have no clock. Least squares with no negative rate over runs, each weighted by the
    inverse root of its time.

    Returns
    -------
    rates : dict
        Seconds for a run, a step on few mega-voussoirs, an event of either kind, and a second
        of motion stepped on all voussoirs; 0 where there was none.
    misfit : float
        Median relative error of the times it gives [1].
    """
    spent = np.array([number(row, "cpu_time") or number(row, "wall_time") for row in rows])
    parts = np.array([list(parts_of(row, step).values()) for row in rows])
    used = spent > 0.0
    spent, parts = spent[used], parts[used]
    largest = np.where(parts.max(axis=0) > 0.0, parts.max(axis=0), 1.0)
    weight = 1.0 / np.sqrt(spent)
    scaled, _ = nnls(parts / largest * weight[:, None], spent * weight)
    rates = scaled / largest
    return dict(zip(PARTS, rates)), float(np.median(np.abs(parts @ rates / spent - 1.0)))


def share_rows(rows: Sequence[Row], step_of: Callable[[str], float]) -> list[list[object]]:
    """Simulated seconds of each model and seconds spent on each part, by arch and method.

    Runs of the same arch by time stepping at the same step, where there are any, pin its rate.
    """
    table: list[list[object]] = []
    for arch, method in dict.fromkeys((row["arch"], row["method"]) for row in rows):
        step, ours = step_of(method), [r for r in rows if r["arch"] == arch]
        same = f"time_stepping@{step:g}"
        part = [row for row in ours if row["method"] == method]
        pins = [row for row in ours if row["method"] == same and method != same]
        rates, misfit = rates_of(part + pins, step)
        seconds = {name: sum(number(row, name) for row in part) for name in MODELS}
        moving = sum(seconds.values()) - seconds["rest"]
        spent = sum(number(row, "cpu_time") or number(row, "wall_time") for row in part)
        for name in filter(seconds.get, MODELS):
            share = f"{100 * seconds[name] / moving:.1f} %" if name != "rest" and moving else ""
            table.append([arch, method, name, f"{seconds[name]:.0f}", share, "", ""])
        for name in PARTS:
            total = sum(parts_of(row, step)[name] for row in part)
            if total == 0.0:
                continue
            cells = [arch, method, name, f"{total:.0f} times" if name != "all voussoirs" else ""]
            each = f"{1e6 * rates[name]:.1f}"
            table.append([*cells, "", f"{rates[name] * total:.2f}", each])
        note = f"{moving:.0f} moving, {seconds['rest']:.0f} at rest"
        fit = f"regression off by {100 * misfit:.0f} % (median)"
        table.append([arch, method, "measured", note, "", f"{spent:.2f}", fit])
    return table


def event_rows(rows: Sequence[Row]) -> list[list[object]]:
    """Events and hand-overs for each arch and method."""
    table: list[list[object]] = []
    for arch, method in dict.fromkeys((row["arch"], row["method"]) for row in rows):
        part = [row for row in rows if (row["arch"], row["method"]) == (arch, method)]
        moving = sum(number(row, name) for row in part for name in MODELS[1:])
        few = moving - sum(number(row, "all_voussoirs") for row in part)
        names = ("events", "hand_overs", "impacts", "steps", "levels", "general")
        total = {name: sum(number(row, name) for row in part) for name in names}
        table.append(
            [arch, method, f"{total['events']:.0f}"]
            + [f"{total['events'] / few:.1f}" if few else "-", f"{total['hand_overs']:.0f}"]
            + [f"{total['hand_overs'] / moving:.2f}" if moving else "-"]
            + [f"{total[name]:.0f}" for name in ("impacts", "steps", "levels", "general")]
            + [f"{max(number(row, 'energy_error') for row in part):.1e}"]
        )
    return table
