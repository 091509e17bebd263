"""Corner cases: scenes in which methods fail, and what a correct one must do in each."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from archbench.closed_forms import Rocking
from archbench.facts import Finding, Run, judge_run
from archbench.runner import Bench
from archbench.scene import STANDARD_GRAVITY, Scene
from archbench.settings import default_setting
from archbench.solve import arch_of, solve
from archbench.statics import least_friction
from archfrag.errors import ArchfragError
from archfrag.mechanics.status import Status
from archfrag.motions.read import read_motion
from archfrag.simulate import onset
from archfrag.simulation.checks import available_methods

FOLDER = Path(__file__).parent / "cases"
# Longest that a case may take a method, all variants together [s].
LIMIT = {True: 20.0, False: 600.0}
HELD, BROKE, NO_ANSWER, NOT_FOR_IT = "held", "broke", "failed", "does not apply"
Row = dict[str, Any]


@dataclass(frozen=True)
class CornerCase:
    """A file of the folder `cases`.

    Attributes
    ----------
    name, title, why : str
        `why`: what makes it hard.
    source : str
    scene : Scene
    expect : dict
        Facts of `archbench.facts` with their arguments, of every variant.
    variants : dict of str to dict
        What differs from the scene; each with its own `expect` beside that of the case.
    history : bool
        Whether runs keep one; without it only the answer and its cost are judged.
    """

    name: str
    title: str
    why: str
    source: str
    scene: Scene
    expect: dict[str, Any]
    variants: dict[str, dict[str, Any]] = field(default_factory=dict)
    history: bool = True

    def runs(self) -> list[tuple[str, Scene, dict[str, Any]]]:
        """Name, scene and expected facts of each variant."""
        listed = []
        for name, changes in (self.variants or {"": {}}).items():
            own = {**vars(self.scene), "name": f"{self.name} {name}".strip()}
            for key, change in changes.items():
                if key != "expect":
                    old = own[key]
                    own[key] = {**old, **change} if isinstance(old, dict) else change
            expect = {**self.expect, **changes.get("expect", {})}
            listed.append((name, Scene(**own), expect))
        return listed


def load_case(name: str) -> CornerCase:
    """Corner case of a file, by its name.

    Examples
    --------
    >>> from archbench.corner_cases import load_case
    >>> len(load_case("thrust_at_a_corner").runs())
    5
    """
    content = json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    names = ("why", "expect", "variants", "history")
    own = {key: content.pop(key) for key in names if key in content}
    scene = Scene(name=name, **content)
    return CornerCase(name=name, title=scene.title, source=scene.source, scene=scene, **own)


def case_names() -> list[str]:
    """Names of all corner cases."""
    return sorted(path.stem for path in FOLDER.glob("*.json"))


def resolved(scene: Scene) -> Scene:
    """The scene with numbers where its file gives them in parts of a threshold.

    `of_rest_limit`: its amplitude is in parts of the largest steady acceleration that the chain
    bears; `of_least_friction`: its friction in parts of the least that bears its own weight;
    `grazing`: its initial speed in parts of that which brings it back without any left.
    """
    chain, motion, initial = dict(scene.chain), dict(scene.motion), dict(scene.initial or {})
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
        rows.append({"case": case.name, "variant": variant, "method": method})
        try:
            scene = resolved(_as_read(scene))
            run = solve(scene, setting, history=case.history)
        except ArchfragError as reason:
            rows[-1] |= _refused(str(reason), expect)
            continue
        response = run.response
        assert response is not None
        if response.status is Status.NOT_APPLICABLE:
            rows[-1] |= _row(NOT_FOR_IT, "", "", run.status, run.seconds)
            continue
        done[variant] = Run(scene, response, done, setting.parameter)
        if "refused" in expect:
            findings = {"answers": Finding(True, ""), "refused": Finding(False, "not refused")}
        else:
            findings = judge_run(done[variant], expect)
        broke = "; ".join(name for name, found in findings.items() if not found.held)
        figures = "; ".join(found.figure for found in findings.values())
        rows[-1] |= _row(_result(findings), broke, figures, run.status, run.seconds)
    return rows


def measure(bench: Bench) -> dict[str, pd.DataFrame]:
    """Every case by every method of ours: a row for each variant and method, and the cases."""
    cases = {name: load_case(name) for name in case_names()}
    tasks = {
        (name, method): (case, method)
        for name, case in cases.items()
        for method in available_methods()
    }
    limit = LIMIT[bench.quick]
    rows: list[Row] = []
    for (name, method), found in bench.run("corner_cases", run_case, tasks, limit).items():
        if isinstance(found, str):
            late = _row(NO_ANSWER, found, "", "not ended", limit)
            found = [
                {"case": name, "variant": variant, "method": method} | late
                for variant, _, _ in cases[name].runs()
            ]
        rows += found
    about = [(c.name, c.title, c.why, c.source, len(c.runs())) for c in cases.values()]
    heads = ["case", "title", "why", "source", "variants"]
    return {"runs": pd.DataFrame(rows), "cases": pd.DataFrame(about, columns=heads)}


def _row(result: str, broke: str, figures: str, status: str, seconds: float) -> Row:
    return {
        "result": result, "broke": broke, "figures": figures, "status": status,
        "seconds": seconds,
    }  # fmt: skip


def _result(findings: Mapping[str, Finding]) -> str:
    if not findings["answers"].held:
        return NO_ANSWER
    return HELD if all(found.held for found in findings.values()) else BROKE


def _refused(message: str, expect: Mapping[str, Any]) -> Row:
    """A scene that is refused: right where that is expected, in one line with these words."""
    if "refused" not in expect:
        return _row(NOT_FOR_IT, message, "", "refused", 0.0)
    held = "\n" not in message and all(word in message for word in expect["refused"])
    figure = message.rsplit("/", 1)[-1]
    return _row(HELD if held else BROKE, "" if held else "refused", figure, "refused", 0.0)


def _as_read(scene: Scene) -> Scene:
    """The scene with its motion written to a file, damaged there and read again."""
    damage = scene.motion.get("damage")
    if damage is None:
        return scene
    kept = {key: value for key, value in scene.motion.items() if key != "damage"}
    samples, step = replace(scene, motion=kept).ground_acceleration()
    values = samples / STANDARD_GRAVITY
    worst = int(np.argmax(np.abs(values)))
    if damage == "zero":
        values[worst] = 0.0
    words = [f"{value:.9E}" for value in values]
    if damage == "nan":
        words[worst] = "NaN"
    if damage == "missing":
        del words[worst]
    head = (
        "archfrag corner case", "none, none, none, 0",
        "ACCELERATION TIME SERIES IN UNITS OF G", f"NPTS= {len(values)}, DT= {step:.7f} SEC",
    )  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{damage}.AT2"
        path.write_text("\n".join((*head, *words)) + "\n", encoding="ascii")
        read = read_motion(path)
    motion = {
        "kind": "samples",
        "amplitude": 1.0,
        "sample_step": read.dt,
        "values": (read.acceleration / STANDARD_GRAVITY).tolist(),
    }
    return replace(scene, motion=motion)
