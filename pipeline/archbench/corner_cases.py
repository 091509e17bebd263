"""Corner cases: scenes in which methods fail, and what a correct one must do in each."""

import json
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import pandas as pd

from archbench.exact import Rocking, least_friction
from archbench.facts import Run, judge_run
from archbench.runner import Bench, Row
from archbench.scene import Scene
from archbench.settings import available_methods, default_setting
from archbench.solve import arch_of, solve
from archfrag.errors import ArchfragError
from archfrag.physics.status import Status
from archfrag.simulation.simulate import onset

FOLDER = Path(__file__).parent / "cases"
# Longest that a case may take a method, all variants together [s].
LIMIT = {True: 20.0, False: 120.0}
HELD = "held"
BROKE = "broke"
NO_ANSWER = "failed"
NOT_FOR_IT = "does not apply"


@dataclass(frozen=True)
class CornerCase:
    """A file of the folder `cases`: a scene, and `why` it is hard.

    `expect` are facts of `archbench.facts` with their arguments; `variants` what differs from the
    scene, each with its own `expect` besides. Without a `history` only the answer is judged.
    """

    scene: Scene
    why: str
    expect: dict[str, Any]
    variants: dict[str, dict[str, Any]] = field(default_factory=dict)
    history: bool = True

    def runs(self) -> list[tuple[str, Scene, dict[str, Any]]]:
        """Name, scene and expected facts of each variant."""
        listed = []
        for name, changes in (self.variants or {"": {}}).items():
            own = {**vars(self.scene), "name": f"{self.scene.name} {name}".strip()}
            for key, change in changes.items():
                if key != "expect":
                    old = own[key]
                    own[key] = {**old, **change} if isinstance(old, dict) else change
            expect = {**self.expect, **changes.get("expect", {})}
            listed.append((name, Scene(**own), expect))
        return listed


def load_case(name: str) -> CornerCase:
    """Corner case of a file, by its name."""
    own = json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    content = {
        each.name: own.pop(each.name) for each in fields(Scene) if each.name in own
    }
    return CornerCase(Scene(name=name, **content), **own)


def case_names() -> list[str]:
    """Names of all corner cases."""
    return sorted(path.stem for path in FOLDER.glob("*.json"))


def resolved(scene: Scene) -> Scene:
    """The scene with numbers where its file gives them in parts of a threshold.

    `of_rest_limit`: amplitude over the largest steady acceleration that the chain bears;
    `of_least_friction`: friction over the least that bears the own weight; `grazing`: initial
    speed over that which brings it back without any left.
    """
    chain = dict(scene.chain)
    motion = dict(scene.motion)
    initial = dict(scene.initial or {})
    if chain.pop("of_least_friction", False):
        chain["friction"] *= least_friction(replace(scene, chain=chain))
    scene = replace(scene, chain=chain)
    if motion.pop("of_rest_limit", False):
        motion["amplitude"] *= onset(arch_of(scene)).plus
    if "grazing" in initial:
        speed, _ = Rocking.of(scene).grazing(initial["angle"], motion["amplitude"])
        initial["spin"] = -speed * initial.pop("grazing")
    return replace(scene, motion=motion, initial=initial or None)


def run_case(case: CornerCase, method: str) -> list[Row]:
    """All variants of a case by a method at its default settings."""
    rows: list[Row] = []
    done: dict[str, Run] = {}
    setting = default_setting(method)
    for variant, scene, expect in case.runs():
        head = {"case": case.scene.name, "variant": variant, "method": method}
        refused = {"status": "refused", "seconds": 0.0}
        try:
            scene = resolved(scene)
            run = solve(scene, setting, history=case.history)
        except ArchfragError as reason:
            rows.append(head | _row(NOT_FOR_IT, str(reason)) | refused)
            continue
        assert run.response is not None
        if run.response.status is Status.NOT_APPLICABLE:
            own = _row(NOT_FOR_IT)
        else:
            done[variant] = Run(scene, run.response, done, setting.parameter)
            findings = judge_run(done[variant], expect)
            broke = "; ".join(
                name for name, found in findings.items() if not found.held
            )
            result = (
                NO_ANSWER if not findings["answers"].held else BROKE if broke else HELD
            )
            own = _row(
                result, broke, "; ".join(found.figure for found in findings.values())
            )
        rows.append(head | own | {"status": run.status, "seconds": run.seconds})
    return rows


def measure(bench: Bench) -> dict[str, pd.DataFrame]:
    """Every case by every method of ours: a row for each variant and method."""
    cases = {name: load_case(name) for name in case_names()}
    tasks = {
        (name, method): (case, method)
        for name, case in cases.items()
        for method in available_methods()
    }
    limit = LIMIT[bench.quick]
    rows: list[Row] = []
    for (name, method), found in bench.run(
        "corner_cases", run_case, tasks, limit
    ).items():
        if isinstance(found, str):
            late = _row(NO_ANSWER, found) | {"status": "not ended", "seconds": limit}
            found = [
                {"case": name, "variant": variant, "method": method} | late
                for variant, _, _ in cases[name].runs()
            ]
        rows += found
    return {"runs": pd.DataFrame(rows)}


def _row(result: str, broke: str = "", figures: str = "") -> Row:
    return {"result": result, "broke": broke, "figures": figures}
