"""Random scenes by the thousand: how runs end, within what work, and whether energy is made.

Every scene follows from the seed and its index: ``--only INDEX`` builds one again. Finished runs
are kept in a CSV and not run again. Row "never hangs".
"""

import argparse
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from random_scenes import how_contact_ended, random_scene
from resumable import CRASHED, ERROR, HUNG, Row, code_of, run_all
from tables import machine, markdown
from watched import watched

import archfrag
from archfrag.kernel_cache import kernel_hash
from archfrag.mechanics.status import Energy, Status
from archfrag.simulate import warmup

KEYS = ("method", "rtol", "follow", "seed", "index")
SCENE = ("kind", "voussoirs", "friction", "shaking", "vertical", "onset", "level", "duration")
NUMBERS = (
    "collapse_time", "collapse_joint", "collapse_mode", "peak_rotation", "energy_error",
    "end_time", "wall_time",
)  # fmt: skip
MODELS = ("rest", "four_hinges", "mega_voussoirs", "all_voussoirs")
COUNTS = ("events", "hand_overs", "impacts", "steps", "levels", "general", "compliant")
FIELDS = (
    *KEYS, "status", "contact", "gain", "bound", *SCENE, *NUMBERS, *MODELS, *COUNTS, "kernels",
)  # fmt: skip
# A run that names an ordinary end while its final state is not finite.
SILENT = "SILENTLY_NOT_FINITE"
FAILURES = ("NO_CONTACT_SOLUTION", "DOES_NOT_STAND", "NOT_FINITE", SILENT, HUNG, CRASHED, ERROR)
ENDS = ("STANDING", "COLLAPSED", "UNFINISHED", "WORK_BOUND", *FAILURES)
# Energy errors, over the largest kinetic energy, that are counted.
ERRORS = (1e-3, 1e-2, 1e-1, 1.0)


@dataclass(frozen=True)
class Task:
    """One run."""

    method: str
    rtol: float | None
    seed: int
    index: int
    follow: float


def work(task: Task) -> Row:
    """One run, as values by field."""
    scene = random_scene(task.seed, task.index)
    method = watched(task.method)
    settings = {} if task.rtol is None else {"rtol": task.rtol}
    response = archfrag.simulate(
        scene.arch, scene.motion, method=method.name, follow=task.follow, **settings
    )
    energy = method.outcome.diagnostics.energy
    largest = energy[Energy.LARGEST_KINETIC]
    values: Row = {name: getattr(response, name) for name in NUMBERS}
    values |= response.model_time | response.events | response.work
    values |= {
        "status": response.status.name,
        "contact": "",
        "gain": energy[Energy.BALANCE_ERROR] / largest if largest > 0.0 else 0.0,
        "bound": method.options.max_steps,
        "kind": scene.kind,
        "voussoirs": scene.arch.n_voussoir,
        "friction": scene.arch.chain.friction[0],
        "shaking": scene.shaking,
        "vertical": scene.motion.vertical is not None,
        "onset": scene.onset,
        "level": scene.level,
        "duration": scene.motion.duration,
        "kernels": kernel_hash()[:8],
    }
    finite = np.isfinite(method.position).all() and np.isfinite(method.velocity).all()
    if response.status != Status.NOT_FINITE and not finite:
        values["status"] = SILENT
    elif response.status == Status.COLLAPSED:
        chain, joint = scene.arch.chain, response.collapse_joint
        values["contact"] = how_contact_ended(chain, method.position, joint)
    return values


def count_rows(rows: Sequence[Row], name: str) -> list[list[object]]:
    """How runs ended, for each value of a field."""
    groups = sorted({row[name] for row in rows if row[name]})
    table: list[list[object]] = []
    for group in [*groups, "all"]:
        part = [row for row in rows if group in ("all", row[name])]
        ends = Counter(row["status"] for row in part)
        table.append([group, len(part)] + [ends.get(end, 0) for end in ENDS])
    return table


def number(row: Row, name: str) -> float:
    """A cell as a number; nan if it is empty."""
    return float(row[name] or "nan")


def listed(rows: Sequence[Row], wanted: Callable[[Row], bool], most: int) -> list[list[object]]:
    """Runs that are worth a look, each with its index."""
    head = [
        [row["seed"], row["index"], row["status"], row["kind"], row["voussoirs"]]
        + [row["friction"][:5], row["shaking"], f"{number(row, 'level'):.2f}"]
        + [f"{number(row, name):.2e}" for name in ("energy_error", "gain")]
        + [row["contact"], row["hand_overs"], row["steps"], f"{number(row, 'wall_time'):.2f}"]
        for row in rows
        if wanted(row)
    ]
    return head[:most]


HEAD = [
    "seed", "index", "status", "profile", "voussoirs", "friction", "motion", "level over onset",
    "energy error", "stray at the end", "joint", "hand-overs", "steps", "wall (s)",
]  # fmt: skip


def summary_rows(rows: Sequence[Row]) -> list[list[object]]:
    """Figures of the row "never hangs"."""
    ends = Counter(row["status"] for row in rows)
    failed = sum(ends.get(end, 0) for end in FAILURES)
    errors = np.array([number(row, "energy_error") for row in rows])
    gains = np.array([number(row, "gain") for row in rows])
    wall = np.array([number(row, "wall_time") for row in rows])
    used = np.array([number(row, "steps") / number(row, "bound") for row in rows])
    fallen = [row for row in rows if row["status"] == "COLLAPSED"]
    held = sum(row["contact"] == "held" for row in fallen)
    simulated = sum(number(row, name) for row in rows for name in MODELS[1:] if row[name])
    handed = sum(number(row, "all_voussoirs") for row in rows if row["all_voussoirs"])
    ways = ", ".join(f"{way} {n}" for way, n in Counter(row["contact"] for row in fallen).items())
    quantiles = " / ".join(f"{q:.2g}" for q in np.nanquantile(errors, [0.5, 0.9, 0.99, 1.0]))
    beyond = ", ".join(f"{(errors > e).sum()} above {e:g}" for e in ERRORS)
    slowest = " / ".join(f"{q:.3g}" for q in np.nanquantile(wall, [0.5, 0.9, 0.99, 1.0]))
    return [
        ["runs", len(rows)],
        ["solver failures", f"{failed} ({100 * failed / len(rows):.3f} %)"],
        ["work bound reached", ends.get("WORK_BOUND", 0)],
        ["largest part of the work bound used", f"{np.nanmax(used):.3g}"],
        ["still moving at the end", ends.get("UNFINISHED", 0)],
        ["collapses without Signorini loss", f"{held} of {len(fallen)}"],
        ["state of the collapse joint", ways],
        ["energy error: median / 90 % / 99 % / largest", quantiles],
        ["energy errors", beyond],
        ["largest energy gain at the end", f"{np.nanmax(gains):.2e}"],
        ["wall time: median / 90 % / 99 % / largest (s)", slowest],
        ["wall time in all (s)", f"{np.nansum(wall):.0f}"],
        ["moving time (s)", f"{simulated:.0f}"],
        ["of it time-stepping", f"{100 * handed / max(simulated, 1e-9):.2f} %"],
    ]


def show_one(task: Task) -> None:
    """Build one scene again, run it, and print what it did."""
    scene = random_scene(task.seed, task.index)
    motion = scene.motion
    print(scene.arch.parameters)
    print(f"{scene.shaking}, dt {motion.dt} s, duration {motion.duration:.3f} s")
    print(f"onset {scene.onset:.5f} g, level {scene.level:.4f} times that")
    for name, value in work(task).items():
        print(f"{name:18s} {value}")
    settings = {} if task.rtol is None else {"rtol": task.rtol}
    response = archfrag.simulate(
        scene.arch, motion, method=task.method, follow=task.follow, history=True, **settings
    )
    for change in (response.mechanism or ())[-20:]:
        print(change)


def main() -> None:
    """Run what is missing and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--method", default="auto")
    parser.add_argument("--rtol", type=float, help="the method's own if not given")
    parser.add_argument("--follow", type=float, default=20.0, help="past the motion's end [s]")
    parser.add_argument("--only", type=int, metavar="INDEX", help="show this scene alone")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--limit", type=float, default=120.0, help="wall seconds: HUNG beyond")
    parser.add_argument("--listed", type=int, default=25, help="most runs in a list")
    parser.add_argument("--out", type=Path, default=Path("random.csv"), help="every run")
    given = parser.parse_args()
    tasks = [
        Task(given.method, given.rtol, given.seed, index, given.follow)
        for index in (range(given.scenes) if given.only is None else [given.only])
    ]
    warmup(given.method)
    if given.only is not None:
        show_one(tasks[0])
        return
    rows = run_all(
        tasks, work, given.out, FIELDS, KEYS, warm=partial(warmup, given.method),
        workers=given.workers, limit=given.limit,
    )  # fmt: skip
    rtol = given.rtol or "its own"
    print(f"{machine()}, {given.method}, rtol {rtol}, seed {given.seed}; {code_of(rows)}\n")
    print(markdown("Random scenes", ["", ""], summary_rows(rows)))
    for name in ("kind", "shaking"):
        print(markdown(f"Ends by {name}", [name, "runs", *ENDS], count_rows(rows, name)))
    lists: dict[str, Callable[[Row], bool]] = {
        "Failures and work bounds": lambda row: row["status"] in (*FAILURES, "WORK_BOUND"),
        "Energy errors above 1 %": lambda row: number(row, "energy_error") > 1e-2,
        "Collapses with contact held": lambda row: row["contact"] == "held",
    }
    for title, wanted in lists.items():
        table = listed(rows, wanted, given.listed)
        print(markdown(title, HEAD, table) if table else f"### {title}\n\nnone\n")
    slow = sorted(rows, key=lambda row: -np.nan_to_num(number(row, "wall_time")))
    print(markdown("Slowest", HEAD, listed(slow, lambda row: True, 10)))


if __name__ == "__main__":
    main()
