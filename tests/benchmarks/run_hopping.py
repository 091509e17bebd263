"""Arches thrown up by a vertical component: what the limit of collapse is worth.

First a ballistic hop by every method of the registry. Then fragility studies with a vertical at
two thirds of the horizontal, run until a joint gapes by 2, 10 and 50 % of its length: theta and
beta for each, and how many that pass the first limit stand by the last. Two studies without a
vertical are there to stay as they are. Row "hopping".

Motions: record k is the horizontal component; the vertical is record k + 1 of the same sorted
list (the first after the last) on the samples of record k, cut or followed by zeros, its largest
value 0.67 times that of the horizontal. Levels are the PGA of the horizontal. Verdicts after
impacts are chaotic: ``--repeats N`` runs motions 1e-6 larger each time as well, and pools.
"""

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from resumable import Row, code_of, run_all
from run_ladder import code, settings_of, warm_up
from tables import machine, markdown

import archfrag as af
from archfrag.arch import STANDARD_GRAVITY as G
from archfrag.errors import FitError
from archfrag.fragility.curve import Fragility
from archfrag.motions.index import load_index
from archfrag.motions.read import load_motion
from archfrag.simulate import warmup
from archfrag.simulation.checks import available_methods

SHIPPED = Path(__file__).parents[2] / "records" / "index.csv"
VERTICAL = 0.67
LIMITS = ("0.02", "0.1", "0.5")
DISTURBANCE = 1e-6
KEYS = ("study", "method", "loss_limit", "record", "level")
FIELDS = (
    *KEYS, "status", "collapse_time", "collapse_mode", "end_time", "energy_error",
    "contact_losses", "wall_time", "kernels",
)  # fmt: skip


def seven(thickness: float = 1.5, embrace: float = 157.5) -> af.Arch:
    """Seven voussoirs about a radius of 10 m."""
    return af.Arch.circular(10.0, thickness, embrace, voussoirs=7, friction=0.7)


class Study(NamedTuple):
    """A structure, so many of the shipped records (none: the folder's), and PGA levels [g]."""

    build: Callable[[], af.Arch]
    records: int
    levels: np.ndarray
    vertical: float = VERTICAL


STUDIES = {
    "real": Study(seven, 0, np.geomspace(0.6, 4.5, 12)),
    "shipped": Study(seven, 20, np.geomspace(0.9, 5.0, 12)),
    "slender": Study(
        lambda: af.Arch.circular(2.5, 0.5, 140.0, voussoirs=11, friction=0.7),
        20,
        np.geomspace(1.2, 4.0, 12),
    ),
    "thick": Study(lambda: seven(2.5, 140.0), 20, np.geomspace(2.2, 8.0, 12)),
    "block": Study(lambda: af.Block(0.6, 1.8, friction=0.7), 20, np.geomspace(0.5, 4.0, 12)),
    "shipped, no vertical": Study(seven, 30, np.linspace(0.2, 3.0, 15), 0.0),
    "real, no vertical": Study(seven, 0, np.linspace(0.4, 5.3, 15), 0.0),
}


@dataclass(frozen=True)
class Task:
    """One run; `method` as in `run_ladder.settings_of`."""

    study: str
    method: str
    loss_limit: str
    record: int
    level: str
    folder: Path | None


def hop() -> tuple[af.Arch, af.Motion]:
    """The ground falls away at 3 g for a tenth of a second: a hop of 0.18 m, then a landing."""
    time = np.arange(0.0, 2.0, 1e-3)
    phases = [time < 0.1, time < 0.2, time < 0.4]
    upward = G * np.select(phases, [0.0, -3.0, 1.5], 0.0)
    return seven(), af.Motion(np.zeros_like(time), 1e-3, upward)


def simulate(arch: af.Arch, motion: af.Motion, loss_limit: float, **options) -> af.Response:
    """One run that ends as a collapse once both corners of a joint gape by `loss_limit` [1]."""
    return af.simulate(arch, motion, loss_limit=loss_limit, **options)


@cache
def records_of(number: int, folder: Path | None) -> tuple[af.Motion, ...]:
    """The first so many shipped records, or all AT2 files of a folder, in sorted order."""
    if number:
        return tuple(load_motion(entry) for entry in load_index(SHIPPED)[:number])
    assert folder is not None
    paths = sorted(path for path in folder.iterdir() if path.suffix.lower() == ".at2")
    return tuple(af.read_motion(path) for path in paths)


def peak_of(samples: np.ndarray) -> float:
    """Largest magnitude."""
    return float(np.abs(samples).max())


@cache
def motion_of(study: str, record: int, folder: Path | None) -> af.Motion:
    """Record and its vertical, the horizontal's PGA 1 g."""
    records = records_of(STUDIES[study].records, folder)
    motion, other = records[record], records[(record + 1) % len(records)]
    across = motion.acceleration * G / peak_of(motion.acceleration)
    part = STUDIES[study].vertical
    if part == 0.0:
        return af.Motion(across, motion.dt)
    upward = np.interp(motion.time, other.time, other.acceleration, right=0.0)
    return af.Motion(across, motion.dt, upward * part * G / peak_of(upward))


@cache
def arch_of(study: str) -> af.Arch:
    """Structure of a study."""
    return STUDIES[study].build()


def work(task: Task) -> Row:
    """One run, as values by field."""
    method, options, change = settings_of(task.method)
    response = simulate(
        arch_of(task.study), motion_of(task.study, task.record, task.folder),
        float(task.loss_limit), scale=float(task.level) * (1.0 + change), method=method, **options,
    )  # fmt: skip
    values = {name: getattr(response, name, "") for name in FIELDS}
    values |= {"status": response.status.name, "kernels": code()}
    return values | {"contact_losses": response.events["contact_losses"]}


def hop_rows() -> list[list[object]]:
    """The ballistic hop by every method that is installed."""
    arch, motion = hop()
    table: list[list[object]] = []
    for name in available_methods():
        warmup(name)
        response = simulate(arch, motion, 0.5, method=name, history=True)
        displacement = response.history.displacement.values
        highest = float(displacement[:, :, 1].max(initial=0.0))
        left = float(np.abs(displacement[-1]).max(initial=0.0)) if displacement.size else np.nan
        table.append([name, response.status.name, response.collapse_mode, f"{highest:.4f}",
                      f"{left:.1e}", f"{response.energy_error:.1e}", response.events["impacts"],
                      f"{response.wall_time:.2f}"])  # fmt: skip
    return table


def run_limits(tasks: list[Task], limits: Sequence[str], path: Path, **pool) -> list[Row]:
    """Rows of all tasks at all limits, lowest first: what stands at one stands at the next."""
    rows: list[Row] = []
    before: dict[tuple[str, ...], Row] = {}
    for limit in limits:
        asked = [
            replace(task, loss_limit=limit)
            for task in tasks
            if not before or before[_case(vars(task))]["status"] == "COLLAPSED"
        ]
        before |= {_case(row): row for row in run_all(asked, work, path, FIELDS, KEYS, **pool)}
        rows += [row | {"loss_limit": limit} for row in before.values()]
    return rows


def curve_of(rows: Sequence[Row]) -> Fragility | None:
    """Curve of runs that collapsed or stood; None where they determine none."""
    levels = sorted({float(row["level"]) for row in rows})
    ends = [[row["status"] for row in rows if float(row["level"]) == level] for level in levels]
    fallen = [end.count("COLLAPSED") for end in ends]
    judged = [fell + end.count("STANDING") for fell, end in zip(fallen, ends)]
    try:
        return af.fit_stripes(levels, fallen, judged)
    except FitError:
        return None


def study_rows(rows: Sequence[Row], limits: Sequence[str]) -> list[list[object]]:
    """A line for each study, method and limit; repeats of a method are pooled."""
    table: list[list[object]] = []
    groups = dict.fromkeys((row["study"], row["method"].partition("%")[0]) for row in rows)
    for study, method in groups:
        here = [r for r in rows if (r["study"], r["method"].partition("%")[0]) == (study, method)]
        by_limit = {limit: [r for r in here if r["loss_limit"] == limit] for limit in limits}
        last = {_case(row): row["status"] for row in by_limit[limits[-1]]}
        reference = curve_of(by_limit[limits[-1]])
        for limit, runs in by_limit.items():
            fallen = [row for row in runs if row["status"] == "COLLAPSED"]
            stand = sum(last[_case(row)] == "STANDING" for row in fallen)
            others = sum(row["status"] not in ("COLLAPSED", "STANDING") for row in runs)
            cells: list[object] = [study, method, f"{100 * float(limit):g} %", len(runs)]
            cells += [len(fallen), stand, others]
            curve = curve_of(runs)
            if curve is None or reference is None:
                table.append([*cells, "no curve", "", ""])
                continue
            change = curve.theta / reference.theta - 1.0
            cells += [f"{curve.theta:.4f} ({curve.standard_errors[0]:.1%})", f"{curve.beta:.4f}"]
            table.append([*cells, f"{change:+.2%}"])
    return table


def _case(row: Row) -> tuple[str, ...]:
    return tuple(str(row[key]) for key in KEYS if key != "loss_limit")


def main() -> None:
    """Run what is missing and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=Path, help="folder of AT2 files")
    parser.add_argument("--studies", nargs="+", default=list(STUDIES), choices=list(STUDIES))
    parser.add_argument("--methods", nargs="+", default=["time_stepping@2.5e-4", "auto"])
    parser.add_argument("--limits", nargs="+", default=list(LIMITS), help="parts of a joint")
    parser.add_argument("--repeats", type=int, default=1)
    parser.add_argument("--no-hop", action="store_true", help="the studies alone")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--limit", type=float, default=600.0, help="longest run [s]")
    parser.add_argument("--out", type=Path, default=Path("hopping.csv"), help="every run")
    given = parser.parse_args()
    if not given.no_hop:
        head = ["method", "end", "mode", "highest (m)", "left (m)", "energy error", "impacts"]
        print(markdown("Ballistic hop", [*head, "wall (s)"], hop_rows()), flush=True)
    methods = [
        f"{method}%{DISTURBANCE * k:g}" if k else method
        for method in given.methods
        for k in range(given.repeats)
    ]
    tasks: list[Task] = []
    for study in given.studies:
        number, levels = STUDIES[study].records, STUDIES[study].levels
        if number == 0 and given.records is None:
            print(f"study {study} is left out: --records names no folder", file=sys.stderr)
            continue
        tasks += [
            Task(study, method, "", record, f"{level:.6g}", given.records)
            for method in methods
            for record in range(len(records_of(number, given.records)))
            for level in levels
        ]
    limits = sorted(given.limits, key=float)
    pool = {"workers": given.workers, "limit": given.limit}
    rows = run_limits(tasks, limits, given.out, warm=partial(warm_up, given.methods), **pool)
    head = ["study", "method", "limit", "runs", "collapses", "of them stand at the last limit"]
    head += ["no verdict", "theta (g)", "beta", "theta against the last limit"]
    print(f"{machine()}, repeats {given.repeats}; {code_of(rows)}\n")
    print(markdown("Limits of collapse", head, study_rows(rows, limits)))


if __name__ == "__main__":
    main()
