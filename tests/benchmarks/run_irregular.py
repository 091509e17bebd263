"""Random irregular chains by the thousand, judged from outside: overlap, jumps, energy, ends.

Every scene follows from its seed (`tests/physics/irregular.py`): ``--only SEED`` runs one again.
Finished runs are kept in a CSV and not run again. Row "no overlap": no overlap above 1e-4 of a
joint's length, an energy error of 10 x rtol or less and never above 1e-2; what does not reach it
is refused, at most 3 of 1,000.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from resumable import CRASHED, ERROR, HUNG, Row, code_of, run_all
from tables import machine, markdown

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.physics.irregular import irregular_scene

import archfrag as af
from archfrag.evidence.judge import energy_gain, largest_jump, late_energy_gain, overlaps
from archfrag.kernel_cache import kernel_hash
from archfrag.mechanics.status import Status
from archfrag.methods.registry import METHODS
from archfrag.simulate import warmup

KEYS = ("method", "rtol", "dt", "seed")
MEASURES = ("overlap", "jump", "energy_error", "energy_gain", "late_gain")
FIELDS = (
    *KEYS, "status", *MEASURES, "overlap_time", "overlap_joint", "frames_above", "collapse_mode",
    "collapse_time", "end_time", "peak_rotation", "residual", "hand_overs", "voussoirs",
    "free_end", "friction", "onset", "peak", "wall_time", "kernels",
)  # fmt: skip
# The contract's row.
MOST_OVERLAP, MOST_ERROR, ERROR_OVER_RTOL, MOST_REFUSED = 1e-4, 1e-2, 10.0, 3
ANSWERS = tuple(s.name for s in (Status.STANDING, Status.COLLAPSED, Status.UNFINISHED))
FAILURES = (HUNG, CRASHED, ERROR)
LIMITS = {
    "overlap": (1e-4, 1e-3, 1e-2),
    "jump": (1e-4, 1e-3, 1e-2),
    "energy_error": (1e-2, 1e-1),
    "energy_gain": (1e-2, 1e-1),
    "late_gain": (1e-3, 1e-2, 1e-1),
}


@dataclass(frozen=True)
class Task:
    """One run; empty settings are the method's own."""

    method: str
    rtol: float | None
    dt: float | None
    seed: int


def work(task: Task) -> Row:
    """One run, as values by field."""
    scene = irregular_scene(task.seed)
    arch, motion = scene.arch, scene.motion
    response = af.simulate(
        arch, motion, method=task.method, rtol=task.rtol, dt=task.dt, history=True
    )
    history = response.history
    time, shift, turn = (history[name].values for name in ("time", "displacement", "rotation"))
    speed, spin = history.velocity.values, history.angular_velocity.values
    depth = overlaps(arch, shift, turn)
    frame, joint = np.unravel_index(np.argmax(depth), depth.shape)
    return {
        "status": response.status.name,
        "overlap": depth[frame, joint],
        "jump": largest_jump(arch, time, shift, turn, speed, spin),
        "energy_error": response.energy_error,
        "energy_gain": energy_gain(arch, motion, time, shift, speed, spin),
        "late_gain": late_energy_gain(arch, motion.duration, time, shift, speed, spin),
        "overlap_time": time[frame],
        "overlap_joint": joint,
        "frames_above": int((depth.max(axis=1) > MOST_OVERLAP).sum()),
        "collapse_mode": response.collapse_mode,
        "collapse_time": response.collapse_time,
        "end_time": response.end_time,
        "peak_rotation": response.peak_rotation,
        "residual": response.residual,
        "hand_overs": response.events["hand_overs"],
        "voussoirs": arch.n_voussoir,
        "free_end": arch.free_end,
        "friction": arch.chain.friction[0],
        "onset": scene.onset,
        "peak": scene.peak,
        "wall_time": response.wall_time,
        "kernels": kernel_hash()[:8],
    }


def number(row: Row, name: str) -> float:
    """A cell as a number; nan if it is empty."""
    return float(row[name] or "nan")


def violates(row: Row, rtol: float | None) -> bool:
    """Whether a run that is reported with an answer breaks the contract's row."""
    if row["status"] not in ANSWERS:
        return False
    error = MOST_ERROR if rtol is None else min(MOST_ERROR, ERROR_OVER_RTOL * rtol)
    within = number(row, "overlap") <= MOST_OVERLAP and number(row, "energy_error") <= error
    return not within


def summary_rows(rows: Sequence[Row], rtol: float | None) -> list[list[object]]:
    """Figures of the row "no overlap", of the runs that have an answer."""
    ends = Counter(row["status"] for row in rows)
    refused = sum(n for end, n in ends.items() if end not in (*ANSWERS, *FAILURES))
    answered = [row for row in rows if row["status"] in ANSWERS]
    table: list[list[object]] = [["runs", len(rows)]]
    table += [[f"ended {end}", count] for end, count in sorted(ends.items())]
    table += [["refused", f"{refused} (at most {MOST_REFUSED} of 1,000)"]]
    for name, limits in LIMITS.items():
        values = np.array([number(row, name) for row in answered])
        if name == "energy_error" and rtol is not None:
            limits = (ERROR_OVER_RTOL * rtol, *limits)
        beyond = ", ".join(f"{(values > x).sum()} above {x:g}" for x in sorted({*limits}))
        table.append([name, f"largest {np.nanmax(values, initial=0.0):.2g}; {beyond}"])
    broken = sum(violates(row, rtol) for row in rows)
    wall = np.array([number(row, "wall_time") for row in answered])
    table.append(["wall time: median / largest (s)", f"{np.median(wall):.3g} / {wall.max():.3g}"])
    table.append(["answers that break the row", broken])
    kept = broken == 0 and refused <= MOST_REFUSED * max(1.0, len(rows) / 1000)
    kept &= not any(ends[end] for end in FAILURES)
    table.append(["row kept", "yes" if kept else "NO"])
    return table


HEAD = ("seed", "status", *MEASURES, "overlap_time", "overlap_joint", "frames_above",
        "collapse_mode", "voussoirs", "friction", "free_end", "peak")  # fmt: skip


def listed(rows: Sequence[Row], rtol: float | None) -> list[list[object]]:
    """Runs that break the row, and those that are refused or failed, worst first."""
    chosen = [row for row in rows if violates(row, rtol) or row["status"] not in ANSWERS]
    chosen.sort(key=lambda row: -np.nan_to_num(number(row, "overlap")))
    return [[_short(row[name]) for name in HEAD] for row in chosen]


def _short(cell: str) -> str:
    try:
        return f"{float(cell):.3g}"
    except ValueError:
        return cell


def main() -> None:
    """Run what is missing and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0, help="seed of the first scene")
    parser.add_argument("--method", default="auto", choices=list(METHODS))
    parser.add_argument("--rtol", type=float, help="the method's own if not given")
    parser.add_argument("--dt", type=float, help="the method's own if not given [s]")
    parser.add_argument("--only", type=int, nargs="+", metavar="SEED", help="these scenes alone")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--limit", type=float, default=120.0, help="wall seconds: HUNG beyond")
    parser.add_argument("--out", type=Path, default=Path("irregular.csv"), help="every run")
    given = parser.parse_args()
    seeds = given.only or range(given.first, given.first + given.scenes)
    tasks = [Task(given.method, given.rtol, given.dt, seed) for seed in seeds]
    if given.only:
        for task in tasks:
            print(*(f"{name:14s} {value}" for name, value in work(task).items()), sep="\n")
        return
    rows = run_all(
        tasks, work, given.out, FIELDS, KEYS, warm=partial(warmup, given.method),
        workers=given.workers, limit=given.limit,
    )  # fmt: skip
    own = {parameter.name: parameter.default for parameter in METHODS[given.method].parameters}
    rtol = given.rtol or own.get("rtol")
    print(f"{machine()}, {given.method}, rtol {rtol}; {code_of(rows)}\n")
    print(markdown("Random irregular scenes", ["", ""], summary_rows(rows, rtol)))
    table = listed(rows, rtol)
    print(markdown("Worst first", HEAD, table) if table else "None breaks the row.")


if __name__ == "__main__":
    main()
