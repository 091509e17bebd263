"""The log of a mechanism as a picture: which joints hinge, slide or are open, and when."""

from collections.abc import Sequence

import numpy as np

from archfrag.mechanics.status import Model
from archfrag.report import picture as look
from archfrag.report.example import Example
from archfrag.report.figures import MODEL_LOOK
from archfrag.report.picture import BELOW, BESIDE, LINE, FloatArray, Picture
from archfrag.report.plot import Entry, Panel, Sheet, picture
from archfrag.report.summary import IntArray
from archfrag.simulation.mechanism import MechanismChange

# What a joint may be seen doing; a sliding hinge is drawn as a hinge, hatched.
LOOK = (
    Entry("hinge at intrados", look.BLUE),
    Entry("hinge at extrados", look.VERMILION),
    Entry("sliding hinge at intrados", look.BLUE, "slash"),
    Entry("sliding hinge at extrados", look.VERMILION, "slash"),
    Entry("slides", look.ORANGE, "cross"),
    Entry("open", look.INK),
)
_STATES = ("closed", *(entry.label for entry in LOOK))
_BINS, _TRACE = 600, 300


def timeline(example: Example) -> Picture | None:
    """Ground motion, joints and model of the ladder over time; None if nothing moved."""
    changes = example.response.mechanism or ()
    if not _moving(changes):
        return None
    start, end = window(changes, example.response.end_time)
    edges = np.linspace(start, end, _BINS + 1)
    n_joint = example.arch.n_joint
    joints, models = sampled(changes, n_joint, edges)
    used = [(k, entry) for k, entry in enumerate(LOOK, start=1) if np.any(joints == k)]
    entries = [entry for _, entry in used]
    for code in np.unique(models):
        model = MODEL_LOOK[Model(code)]
        entries.append(model._replace(label=f"model: {model.label}"))

    def draw(sheet: Sheet) -> None:
        top = sheet.legend(BESIDE, 0.0, entries) + LINE + 4.0
        right, height = sheet.width - 10.0, float(np.clip(15.0 * n_joint, 70.0, 400.0))
        first = Panel(sheet, (BESIDE, top, right, top + 62.0), (start, end), (-1.0, 1.0))
        _ground(first, example)
        sheet.text(BESIDE, top - 6.0, _stated(example), "b")
        box = BESIDE, top + 72.0, right, top + 72.0 + height
        middle = Panel(sheet, box, (start, end), (-0.6, n_joint - 0.4))
        step = max(1, -(-n_joint // int(height / 13.0)))
        middle.axis_y(np.arange(0, n_joint, step), "joint")
        for k, (_, colour, mark) in used:
            middle.cells((joints == k).T, colour, mark, edges, 0.4)
        bottom = middle.box[3] + 8.0
        last = Panel(sheet, (BESIDE, bottom, right, bottom + 14.0), (start, end), (-0.5, 0.5))
        for code in np.unique(models):
            last.cells(models[None] == code, *MODEL_LOOK[Model(code)][1:], edges)
        sheet.text(BESIDE - 5.0, bottom + 11.0, "model", "s e")
        last.axis_x(look.even_ticks(start, end, 5 if sheet.narrow else 9), "time [s]")
        if example.response.collapsed:
            time = float(last.at_x(example.response.collapse_time))
            line = f"M{time:.1f} {top:.1f}V{bottom:.1f}"
            sheet.path(line, stroke=look.INK, stroke_dasharray="4 2")
        sheet.height = bottom + 14.0 + BELOW

    return picture(
        draw,
        alternative=f"Mechanism over time under {example.motion.id}: hinges, sliding and open "
        "joints, and the model of the ladder",
    )


def window(changes: Sequence[MechanismChange], end_time: float) -> tuple[float, float]:
    """Time from just before the first motion to just after the last, or the end of the run [s]."""
    moving = _moving(changes)
    first = moving[0].time
    last = moving[-1].until if np.isfinite(moving[-1].until) else end_time
    margin = 0.03 * max(last - first, 1e-3)
    return max(0.0, first - margin), min(end_time, last + margin)


def sampled(
    changes: Sequence[MechanismChange], n_joint: int, edges: FloatArray
) -> tuple[IntArray, IntArray]:
    """States of the joints and the model at the middle of each bin of time."""
    states = np.zeros((len(changes), n_joint), dtype=np.int64)
    for i, change in enumerate(changes):
        for joint, text in change.joints.items():
            states[i, joint] = state_of(text)
    models = np.array([Model[change.model.upper()] for change in changes], dtype=np.int64)
    middle = 0.5 * (edges[:-1] + edges[1:])
    since = np.searchsorted([change.time for change in changes], middle, side="right") - 1
    return states[np.maximum(since, 0)], models[np.maximum(since, 0)]


def state_of(text: str) -> int:
    """Position in the states of a joint's description in a `MechanismChange`."""
    if text.startswith("hinge"):
        sliding = "sliding " if "sliding" in text else ""
        return _STATES.index(f"{sliding}hinge at {text.split()[1]}")
    return _STATES.index("slides" if text.startswith("slides") else "open")


def _moving(changes: Sequence[MechanismChange]) -> list[MechanismChange]:
    """Entries that last, or last for a time not known, in another model than rest."""
    return [c for c in changes if c.model != "rest" and not c.until <= c.time]


def _ground(panel: Panel, example: Example) -> None:
    times, acceleration = example.ground
    start, end = panel.x
    shown = np.concatenate([[start], times[(times > start) & (times < end)], [end]])
    place, low, high = look.envelope(np.interp(shown, times, acceleration, right=0.0), _TRACE)
    reach = 1.05 * max(float(np.abs([low, high]).max()), 1e-9)
    panel.y = (-reach, reach)
    panel.axis_y(look.even_ticks(-reach, reach, 4), "ground [g]")
    panel.band(np.interp(place, np.arange(shown.size), shown), low, high, look.GREY, 1.0)


def _stated(example: Example) -> str:
    """What ended the run, over the drawing."""
    response = example.response
    if response.collapsed:
        time, joint = response.collapse_time, response.collapse_joint
        return f"{example.level}: contact lost at {time:.2f} s, joint {joint}"
    return f"{example.level}: {response.status.name.lower().replace('_', ' ')}"
