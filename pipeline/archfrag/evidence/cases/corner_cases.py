"""Corner cases: scenes in which methods fail, and what a correct one must do in each."""

from __future__ import annotations

import json
import tempfile
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from archfrag.errors import STATUS_MESSAGE, ArchfragError
from archfrag.evidence.cases.closed_forms import Rocking
from archfrag.evidence.cases.facts import Finding, Run, judge_run
from archfrag.evidence.cases.statics import least_friction
from archfrag.evidence.part import Frames, Note, Section, Setup
from archfrag.evidence.run import Way, arch_of, compile_seconds, run_scene
from archfrag.evidence.scene import STANDARD_GRAVITY, Scene
from archfrag.evidence.stability.watch import in_watched_processes
from archfrag.mechanics.status import Status
from archfrag.methods.registry import AUTO, METHODS
from archfrag.motions.read import read_motion
from archfrag.report import canvas
from archfrag.report.canvas import Picture, picture
from archfrag.simulate import onset
from archfrag.simulation.checks import available_methods, default_of

FOLDER = Path(__file__).parent / "files"
Row = dict[str, Any]
OURS = ("time_stepping", "event_driven", AUTO)
# Longest that a case may take a method, all variants together [s].
LIMIT = {True: 45.0, False: 600.0}
HELD, BROKE, NO_ANSWER, NOT_FOR_IT = "held", "broke", "failed", "does not apply"
_COLOURS = {HELD: "#bfe3d5", BROKE: canvas.VERMILION, NO_ANSWER: canvas.INK, NOT_FOR_IT: "#eef1f4"}


@dataclass(frozen=True)
class CornerCase:
    """A file of the folder `files`.

    Attributes
    ----------
    name, title, why : str
        `why` says what makes it hard.
    source : str
    scene : Scene
    expect : dict
        Facts of `archfrag.evidence.cases.facts` with their arguments, of every variant.
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
    >>> from archfrag.evidence.cases.corner_cases import load_case
    >>> len(load_case("thrust_at_a_corner").runs())
    5
    """
    with open(FOLDER / f"{name}.json", encoding="utf-8") as file:
        content = json.load(file)
    own = {key: content.pop(key) for key in ("why", "expect")}
    own |= {key: content.pop(key) for key in ("variants", "history") if key in content}
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
    chain, motion = dict(scene.chain), dict(scene.motion)
    initial = dict(scene.initial or {})
    if chain.pop("of_least_friction", False):
        part = chain["friction"]
        chain["friction"] = part * least_friction(scene)
    scene = Scene(**{**vars(scene), "chain": chain})
    if motion.pop("of_rest_limit", False):
        motion["amplitude"] *= onset(arch_of(scene)).plus
    if "grazing" in initial:
        speed, _ = Rocking.of(scene).grazing(initial["angle"], motion["amplitude"])
        initial["spin"] = -speed * initial.pop("grazing")
    return Scene(**{**vars(scene), "motion": motion, "initial": initial or None})


def default_way(method: str) -> Way:
    """A method as it is without any setting."""
    info = METHODS[method]
    knob = "rtol" if any(p.name == "rtol" for p in info.parameters) else "dt"
    return Way(method, knob, default_of(info, knob))


def run_case(case: CornerCase, method: str) -> list[dict[str, Any]]:
    """All variants of a case by a method at its default settings.

    Parameters
    ----------
    case : CornerCase
    method : str

    Returns
    -------
    list of dict
        A row for each variant: `result` ("held", "broke", "failed": no answer, "does not
        apply"), what `broke`, the measured `figures`, `status` and `seconds`.
    """
    rows = []
    done: dict[str, Run] = {}
    way = default_way(method)
    for variant, scene, expect in case.runs():
        row = {"case": case.name, "variant": variant, "method": method}
        rows.append(row)
        if "refused" in expect:
            row |= _refusal(scene, method, expect["refused"])
            continue
        try:
            scene = resolved(_as_read(scene))
            response = run_scene(scene, way, history=case.history)
        except ArchfragError as reason:
            row |= _row(NOT_FOR_IT, str(reason), "", "refused", 0.0)
            continue
        if response.status is Status.NOT_APPLICABLE:
            sentence = STATUS_MESSAGE[response.status]
            row |= _row(NOT_FOR_IT, sentence, "", "not_applicable", response.wall_time)
            continue
        run = done[variant] = Run(scene, response, done, way.knob)
        findings = judge_run(run, expect)
        row |= _row(
            _result(findings),
            "; ".join(name for name, found in findings.items() if not found.held),
            "; ".join(found.figure for found in findings.values()),
            response.status.name.lower(),
            response.wall_time,
        )
    return rows


def measure(setup: Setup) -> dict[str, pd.DataFrame]:
    """Every case by every registered method; in the quick set each has less time.

    Returns
    -------
    dict
        `runs`: a row for each variant and method; `cases`: what each is.
    """
    names = case_names()
    tasks = [(load_case(name), method) for name in names for method in available_methods()]
    limit = LIMIT[setup.quick]
    prepare = partial(compile_seconds, available_methods())
    found = in_watched_processes(run_case, tasks, setup.workers, limit, prepare)
    rows = [
        row
        for (case, method), part in zip(tasks, found)
        for row in (_too_long(case, method, limit) if part is None else part)
    ]
    cases = [load_case(name) for name in names]
    about = [(c.name, c.title, c.why, c.source, len(c.runs())) for c in cases]
    heads = ["case", "title", "why", "source", "variants"]
    return {"runs": pd.DataFrame(rows), "cases": pd.DataFrame(about, columns=heads)}


def _too_long(case: CornerCase, method: str, limit: float) -> list[Row]:
    """Rows of a case whose variants took longer than they may."""
    broke = f"no end within {limit:g} s for all variants"
    return [
        {"case": case.name, "variant": variant, "method": method}
        | _row(NO_ANSWER, broke, "", "not ended", limit)
        for variant, _, _ in case.runs()
    ]


def show(frames: Frames) -> Section:
    """Which method holds where, and what broke."""
    runs: list[Row] = _rows(frames["runs"])
    cases: list[Row] = _rows(frames["cases"])
    methods = list(dict.fromkeys(row["method"] for row in runs))
    lines = list(dict.fromkeys((row["case"], row["variant"]) for row in runs))
    lead = [
        f"{len(cases)} corner cases, {len(lines)} runs by each method at its default settings, "
        "judged from outside by laws and closed forms."
    ]
    for method in methods:
        counts = Counter(row["result"] for row in runs if row["method"] == method)
        parts = [f"{counts[kind]} {kind}" for kind in _COLOURS if kind in counts]
        lead.append(f"{method}: {', '.join(parts)}.")
    notes = [
        Note(
            "What broke",
            "Every run in which a law or a fact did not hold, with all that was measured.",
            ("case", "variant", "method", "what", "measured"),
            tuple(
                (row["case"].replace("_", " "), row["variant"], row["method"], row["broke"],
                 row["figures"])
                for row in runs
                if row["result"] in (BROKE, NO_ANSWER)
            ),
            words=True,
        ),
        Note(
            "The cases",
            f"Why each is hard, and the figures of {AUTO}.",
            ("case", "why", AUTO),
            tuple((row["title"], row["why"], _figures_of(runs, row["case"])) for row in cases),
            words=True,
        ),
    ]  # fmt: skip
    return Section("Corner cases", lead, {"corner-cases": _grid(runs, lines, methods)}, notes)


def _rows(frame: pd.DataFrame) -> list[Row]:
    return [{str(key): value for key, value in row.items()} for row in
            frame.fillna("").to_dict("records")]  # fmt: skip


def _figures_of(runs: Sequence[Row], case: str) -> str:
    chosen = [row for row in runs if row["case"] == case and row["method"] == AUTO]
    return " | ".join(
        (f"{row['variant']}: " if row["variant"] else "") + row["figures"] for row in chosen
    )


def _grid(
    runs: Sequence[Row], lines: Sequence[tuple[str, str]], methods: Sequence[str]
) -> Picture:
    place = {line: y for y, line in enumerate(lines)}

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for row in runs:
            x, y = methods.index(row["method"]), place[row["case"], row["variant"]]
            cell = Rectangle((x - 0.46, y - 0.44), 0.92, 0.88, linewidth=0.0)
            cell.set_facecolor(_COLOURS[row["result"]])
            axes.add_patch(cell)
            if row["result"] in (BROKE, NO_ANSWER):
                axes.text(x, y, "×", ha="center", va="center", color="white", fontsize=8.0)
        axes.set(xlim=(-0.5, len(methods) - 0.5), ylim=(len(lines) - 0.5, -0.5))
        axes.set_xticks(range(len(methods)), methods, rotation=30.0, ha="left")
        labels = []
        for k, (case, variant) in enumerate(lines):
            first = k == 0 or lines[k - 1][0] != case
            name = case.replace("_", " ") if first else ""
            labels.append(": ".join(part for part in (name, variant) if part))
            if first and k:
                axes.axhline(k - 0.5, color=canvas.PALE, lw=0.5)
        axes.set_yticks(range(len(lines)), labels)
        axes.xaxis.tick_top()
        axes.tick_params(length=0.0)
        for spine in axes.spines.values():
            spine.set_visible(False)
        handles = [Patch(color=colour, label=kind) for kind, colour in _COLOURS.items()]
        figure.legend(handles=handles, loc="outside lower left", ncols=len(handles))

    return picture(
        "corner-cases", (canvas.WIDTH, 1.3 + 0.19 * len(lines)), draw,
        alternative="Corner cases by method: held, broke, failed, or does not apply",
        caption="Each corner case and its variants by each method at default settings. Broke: it "
        "answers, but a law or a fact of the case is violated; failed: its solver gave up; a "
        "method that refuses a scene does not apply to it.",
    )  # fmt: skip


def _row(result: str, broke: str, figures: str, status: str, seconds: float) -> dict[str, Any]:
    return {
        "result": result, "broke": broke, "figures": figures, "status": status,
        "seconds": seconds,
    }  # fmt: skip


def _result(findings: Mapping[str, Finding]) -> str:
    if not findings["answers"].held:
        return NO_ANSWER
    return HELD if all(found.held for found in findings.values()) else BROKE


def _refusal(scene: Scene, method: str, words: list[str]) -> dict[str, Any]:
    """A record that must be refused in one sentence with these words in it."""
    try:
        response = run_scene(_as_read(scene), default_way(method))
    except ArchfragError as reason:
        sentence = str(reason)
        held = "\n" not in sentence and all(word in sentence for word in words)
        said = sentence.rsplit("/", 1)[-1]
        return _row(HELD if held else BROKE, "" if held else "refused", said, "refused", 0.0)
    return _row(BROKE, "refused", "not refused", response.status.name.lower(), response.wall_time)


def _as_read(scene: Scene) -> Scene:
    """The scene with its motion written to a file, damaged there and read again."""
    damage = scene.motion.get("damage")
    if damage is None:
        return scene
    kept = {key: value for key, value in scene.motion.items() if key != "damage"}
    samples, step = Scene(**{**vars(scene), "motion": kept}).ground_acceleration()
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
    return Scene(**{**vars(scene), "motion": motion})
