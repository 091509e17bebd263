"""Real records, many levels, three arches: a method's verdicts beside time-stepping's.

Writes every finished run to a CSV and goes on from it. The records are not ours to ship: name
a folder of them. How far two verdicts can agree at all, a judge beside itself says:
``--methods time_stepping@1e-4 auto time_stepping@1e-4%1e-6 time_stepping@5e-5``, with ``--judges``
naming the three. Rows "ladder" and "shares".
"""

import argparse
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from ladder_tables import (
    MODELS,
    VERDICT,
    Pair,
    agreement_rows,
    decided_rows,
    distance_to_agreement,
    event_rows,
    pairs_of,
    share_rows,
)
from resumable import Row, code_of, run_all
from tables import machine, markdown
from watched import watched

import archfrag
from archfrag.arch import STANDARD_GRAVITY
from archfrag.kernel_cache import kernel_hash
from archfrag.methods.registry import METHODS
from archfrag.motions.scale import scale_factor
from archfrag.simulate import warmup

ARCHES = {
    "seven": lambda: archfrag.Arch.circular(10.0, 1.5, 157.5, 7, 0.7),
    "segmental": lambda: archfrag.Arch.segmental(8.0, 2.5, 0.6, 5, math.inf),
    "pointed": lambda: archfrag.Arch.pointed(6.0, 4.0, 0.6, 16, 0.55),
}
# PGA [g]: from no collapse, or next to none, to collapse under nearly all records.
LEVELS = {
    "seven": np.linspace(0.4, 5.3, 15),
    "segmental": np.linspace(0.8, 5.0, 15),
    "pointed": np.linspace(0.3, 3.1, 15),
}
KEYS = ("method", "arch", "record", "level")
COUNTS = ("steps", "iterations", "levels", "level_iterations", "general", "shortened")
EVENTS = ("events", "hand_overs", "impacts", "openings", "slides", "rests")
NUMBERS = (
    "collapse_time", "collapse_joint", "collapse_mode", "peak_rotation", "peak_displacement",
    "energy_error", "end_time", "wall_time",
)  # fmt: skip
FIELDS = (*KEYS, "status", *NUMBERS, *MODELS, *EVENTS, *COUNTS, "cpu_time", "kernels")
NEARBY = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05)


@dataclass(frozen=True)
class Task:
    """One run.

    `method` may carry its step, its tolerance and a relative change of the amplitude, in this
    order: ``time_stepping@1e-4``, ``auto~1e-4``, ``auto%1e-6``.
    """

    method: str
    arch: str
    record: str
    level: str
    folder: Path


def settings_of(method: str) -> tuple[str, dict[str, float], float]:
    """Name, options and relative change of amplitude that ``name@dt~rtol%change`` stands for."""
    name, _, change = method.partition("%")
    name, _, rtol = name.partition("~")
    name, _, dt = name.partition("@")
    options = {"rtol": rtol, "dt": dt}
    return name, {key: float(value) for key, value in options.items() if value}, float(change or 0)


def step_of(method: str) -> float:
    """Time step that a method takes on all voussoirs [s]."""
    name, options, _ = settings_of(method)
    if "dt" in options:
        return options["dt"]
    own = [p.default for p in METHODS[name].parameters if p.name == "dt"]
    return own[0] if own else step_of("time_stepping")


@cache
def motion_of(folder: Path, record: str) -> archfrag.Motion:
    """A record of the folder."""
    return archfrag.read_motion(folder / record)


@cache
def arch_of(name: str) -> archfrag.Arch:
    """An arch of the comparison."""
    return ARCHES[name]()


@cache
def code() -> str:
    """What tells the kernels' source from another state of it."""
    return kernel_hash()[:8]


def work(task: Task) -> Row:
    """One run, as values by field."""
    method, options, change = settings_of(task.method)
    motion = motion_of(task.folder, task.record)
    factor = scale_factor(motion, "PGA", float(task.level) * STANDARD_GRAVITY) * (1.0 + change)
    run = watched(method)
    response = archfrag.simulate(
        arch_of(task.arch), motion, scale=factor, method=run.name, **options
    )
    values = {"cpu_time": run.cpu_time}
    values |= {name: getattr(response, name) for name in NUMBERS}
    values |= {"status": response.status.name, "kernels": code()}
    values |= response.model_time
    return values | response.events | response.work


def warm_up(methods: Sequence[str]) -> None:
    """Kernels of the methods asked for: compiled once, then from the disk cache."""
    for name in {settings_of(method)[0] for method in methods}:
        warmup(name)


def grid(folder: Path, methods: list[str], arches: list[str], records: int | None) -> list[Task]:
    """All runs: methods by arches by records by levels."""
    files = sorted(p.name for p in folder.iterdir() if p.suffix.lower() == ".at2")
    return [
        Task(method, arch, record, f"{level:.6g}", folder)
        for method in methods
        for arch in arches
        for record in files[:records]
        for level in LEVELS[arch]
    ]


def disagreement_rows(pairs: list[Pair]) -> list[list[object]]:
    """Each pair with unequal verdicts."""
    rows: list[list[object]] = []
    for pair in pairs:
        if pair.agree:
            continue
        cells: list[object] = [pair.arch, pair.record, f"{pair.level:.4g}"]
        for run in (pair.judge, pair.judged):
            verdict = VERDICT.get(run["status"])
            if verdict:
                cells.append(f"collapsed {float(run['collapse_time']):.2f} s")
            else:
                cells.append("stood" if verdict is False else run["status"])
            cells.append(f"{float(run['peak_rotation'] or 'nan'):.3g}")
        cells.append(f"{100 * distance_to_agreement(pair, pairs):.1f} %")
        rows.append(cells)
    return rows


def probe(pairs: list[Pair], folder: Path, methods: list[str], path: Path, **pool) -> list[list]:
    """Amplitudes close to each disagreement: how far both go on to differ.

    Also the judge at half its step: where it disagrees with itself, it is no judge.
    """
    judge, judged = methods[:2]
    name, options, _ = settings_of(judge)
    finer = [judge, judged]
    if "dt" in options:
        finer.append(f"{name}@{0.5 * options['dt']:g}")
    apart = [pair for pair in pairs if not pair.agree]
    steps = (0.0, *(sign * step for step in NEARBY for sign in (-1.0, 1.0)))
    tasks = [
        Task(method, p.arch, p.record, f"{p.level * (1.0 + step):.7g}", folder)
        for p in apart
        for method in finer
        for step in steps
    ]
    rows = run_all(tasks, work, path, FIELDS, KEYS, **pool)
    by_key = {tuple(row[key] for key in KEYS): row for row in rows}
    table: list[list[object]] = []
    for p in apart:
        letters = {
            method: [
                by_key[method, p.arch, p.record, f"{p.level * (1.0 + step):.7g}"]["status"]
                for step in sorted(steps)
            ]
            for method in finer
        }
        agree = [
            abs(step)
            for step, a, b in zip(sorted(steps), letters[judge], letters[judged])
            if a == b and a in VERDICT
        ]
        table.append(
            [p.arch, p.record, f"{p.level:.4g}"]
            + ["".join(status[0] for status in letters[method]) for method in finer]
            + [f"{100 * min(agree):.1f} %" if agree else "> 5 %"]
        )
    return table


def main() -> None:
    """Run what is missing and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("records", type=Path, help="folder of AT2 files")
    parser.add_argument("--methods", nargs="+", default=["time_stepping@1e-4", "auto"])
    parser.add_argument("--judges", nargs="+", default=[], help="of the methods, those that judge")
    parser.add_argument("--arches", nargs="+", default=list(ARCHES), choices=list(ARCHES))
    parser.add_argument("--first", type=int, help="so many records only")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--limit", type=float, default=600.0, help="longest run [s]")
    parser.add_argument("--probe", action="store_true", help="look close to each disagreement")
    parser.add_argument("--out", type=Path, default=Path("ladder.csv"), help="every run")
    arguments = parser.parse_args()
    warm_up(arguments.methods)
    pool: dict[str, Any] = {"workers": arguments.workers, "limit": arguments.limit}
    pool["warm"] = partial(warm_up, arguments.methods)
    tasks = grid(arguments.records, arguments.methods, arguments.arches, arguments.first)
    rows = run_all(tasks, work, arguments.out, FIELDS, KEYS, **pool)
    print(f"{machine()}, {arguments.workers} workers; {code_of(rows)}\n")
    judge = arguments.methods[0]
    for judged in arguments.methods[1:]:
        pairs = pairs_of(rows, judge, judged)
        head = ["arch", "cases", "collapses", "no verdict", "differ", "equal"]
        head += ["falls only by the judge / the other", "theta (g)", "", "", "beta", "", ""]
        print(markdown(f"Verdicts of {judged} beside {judge}", head, agreement_rows(pairs)))
        head = ["arch", "record", "PGA (g)", judge, "peak (rad)", judged, "peak (rad)"]
        head += ["nearest level of equal verdicts"]
        print(markdown("Each disagreement", head, disagreement_rows(pairs)), flush=True)
    if len(arguments.judges) > 1:
        head = ["method", "judges", "cases decided alike", "differ", "equal"]
        title = "Beside the cases that all other judges decide alike"
        print(markdown(title, head, decided_rows(rows, arguments.judges)))
    if arguments.probe and len(arguments.methods) > 1:
        path = arguments.out.with_stem(arguments.out.stem + "_probe")
        pairs = pairs_of(rows, judge, arguments.methods[1])
        table = probe(pairs, arguments.records, arguments.methods, path, **pool)
        head = ["arch", "record", "PGA (g)", judge, arguments.methods[1], "judge at half its step"]
        head += ["nearest equal verdict"]
        title = f"Verdicts (S stands, C collapses) at {NEARBY} below and above"
        print(markdown(title, head, table))
    head = ["arch", "method", "part", "simulated (s)", "of motion", "CPU (s)", "us each"]
    table = share_rows(rows, step_of)
    print(markdown("Shares; seconds spent by regression over the runs' counts", head, table))
    head = ["arch", "method", "events", "a second between hand-overs", "hand-overs"]
    head += ["a second of motion", "impacts", "steps", "levels", "general", "energy error"]
    print(markdown("Events", head, event_rows(rows)))


if __name__ == "__main__":
    main()
