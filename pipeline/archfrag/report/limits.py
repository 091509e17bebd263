"""What a study models and what not, and how large its errors are."""

import math
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.special import ndtri

from archfrag.arch import Arch
from archfrag.arch.bridge import fill_weighs
from archfrag.fragility.curve import Curve, tails
from archfrag.physics.methods.registry import known_methods
from archfrag.properties import value_of
from archfrag.report.html import ERRORS, TEXTS, rounded
from archfrag.report.inputs import ReportInputs, several
from archfrag.report.svg import (
    BLUE,
    GREEN,
    INK,
    PURPLE,
    VERMILION,
    Entry,
    Panel,
    Sheet,
    Words,
    figure,
    panel_below,
)
from archfrag.simulation.arguments import default_of
from archfrag.study.answer.curves import arch_classes

_LISTED = 3  # names of arches in a sentence
# Kinds of errors that `ERRORS` has.
_KINDS = {
    "auto": Entry("steps of auto, by rtol", GREEN, "dot"),
    "time_stepping": Entry("equal steps [s]", BLUE, "dot"),
    "joints": Entry("joints", VERMILION, "dot"),
    "spans": Entry("spans", PURPLE, "dot"),
}
ONE_SPAN = "1 of 3 spans"
_AXES = ["cost", "percent"]
_MORE = np.array([1 / 3, 1.0, 3.0, 10.0])  # records over those of the study
Given = Mapping[
    str, Sequence[Mapping[str, Any]]
]  # keys of the arches, by name of arch or class


class Aspect(NamedTuple):
    """Something that a model of an arch may have or lack."""

    modelled: bool
    name: str  #: for a list of aspects; may be empty
    sentence: str


def aspects(
    given: Given,
    vertical: str = "not used",
    method: Mapping[str, Any] = MappingProxyType({}),
    spanning: bool = True,
) -> list[Aspect]:
    """Return what is modelled and what is not, each with its sentence.

    `given` has the keys of the arches. `vertical` is the attribute ``vertical_component`` of a
    cube, `method` the keys of the method; `spanning` is false if all arches are free-standing.
    """
    arches = [arch for members in given.values() for arch in members]
    keys = "friction", "piers.friction", "ends.friction", "spans.friction"
    coefficients = [value_of(arch, key) for arch in arches for key in keys]
    finite = any(np.isfinite(np.array(each, float)).any() for each in coefficients)
    some = tuple(
        filter(None, [vertical.removeprefix("used").strip()])
    )  # records that have one
    counts = sorted({arch.get("several", 0) for arch in arches} - {0})
    speed = method.get("wave_speed")
    later = method.get("bases") or {}
    apart = f"a wave of {speed:g} m/s passes along them" if speed else ""
    apart += ", ".join(f"{name} {delay:g} s later" for name, delay in later.items())
    others = {
        "always": (),
        "never": None,
        "apart": () if apart else None,
        "vertical": None if vertical == "not used" else some,
        "sliding": () if finite else None,
    }
    result = []
    for text in TEXTS["limits"]:
        key = text["key"]
        if spanning or not text.get("spanning"):
            whose = others[key] if key in others else _having(given, key)
            words = f" ({', '.join(whose)})" if whose else ""
            kind = "no" if whose is None else "yes"
            name = text.get(f"{kind}_name", "")
            many = " to ".join(map(str, {*counts[:1], *counts[-1:]}))
            sentence = text[kind].format(of=words, apart=apart, spans=many)
            result.append(Aspect(kind == "yes", name + words * bool(name), sentence))
    return result


def study_aspects(inputs: ReportInputs) -> list[Aspect]:
    """Return the aspects that the study of a report models, and those that it does not."""
    of_class = arch_classes(inputs.cube)
    given = inputs.given
    if not given:  # a report without a study file
        given = {
            of_class[name]: [each.arch.parameters | several(len(each.arch.spans))]
            for name, each in inputs.arches.items()
        }
    return aspects(
        given,
        inputs.cube.attrs.get("vertical_component", "not used"),
        inputs.config.get("method", {}),
        not all(each.arch.free_end for each in inputs.arches.values()),
    )


def short(found: Iterable[Aspect]) -> str:
    """Return a line of text on what is modelled and what is not."""
    names = {True: list[str](), False: list[str]()}
    for aspect in found:
        names[aspect.modelled] += [aspect.name] * bool(aspect.name)
    return (
        f"Modelled: {', '.join(names[True])}. Not modelled: {', '.join(names[False])}"
    )


def base_of(arch: Arch) -> str:
    """Return the words for joint 0 of an arch, or of each part of a bridge."""
    if arch.free_end:
        return "the base"
    springing = "the left springing"
    return f"{springing} of a span, the base of a pier" if arch.places else springing


def errors_of(inputs: ReportInputs, arch: Arch, answer: Curve) -> pd.DataFrame:
    """Return known errors of theta with costs over those of the study; `own` says which it has.

    Rows of `report/templates/errors.csv` that do not apply are left out: of other methods, of
    steps with elastic faces, and, for what stands alone, of joints and spans. The last rows are
    of more and fewer records, if the interval of theta is finite.
    """
    table = pd.read_csv(ERRORS)
    own = table["kind"].map(_chosen(inputs, arch))
    table = table.assign(own=table["what"] == own)[own.notna()]
    table = pd.concat([table, _by_records(inputs, answer)], ignore_index=True)
    unit = table[table["own"]].set_index("kind")["cost"]
    return table.assign(cost=table["cost"] / table["kind"].map(unit).fillna(1.0))


def _chosen(inputs: ReportInputs, arch: Arch) -> dict[str, str]:
    """Return what the study has of each kind of `_KINDS` in which it may have errors."""
    method = inputs.config.get("method", {"name": "auto"})
    name = method["name"]
    key = "dt" if name == "time_stepping" else "rtol"
    joints = arch.parameters.get("joints") or {"model": "rigid"}
    chosen = dict[str, str]()
    if joints["model"] != "face":
        value = method.get(key) or default_of(known_methods()[name], key)
        chosen[name] = f"{value:g}"
    if not arch.free_end:
        corners = joints.get("points") == 2
        chosen["joints"] = "two corners" if corners else joints["model"]
        chosen["spans"] = "" if arch.spans[1:] else ONE_SPAN
    return chosen


def _by_records(inputs: ReportInputs, answer: Curve) -> pd.DataFrame:
    """Return the standard error of ln theta, which falls with the root of the records."""
    low, high = answer.theta_interval
    if not 0.0 < low < high < np.inf:
        return pd.DataFrame()
    spread = np.log(high / low) / (2.0 * ndtri(tails(answer.confidence)[1]))
    count = inputs.cube.sizes["record"]
    more = _MORE[_MORE * count >= 1.0]
    return pd.DataFrame(
        {
            "kind": "records",
            "what": [f"{n:.0f} records" for n in more * count],
            "cost": more,
            "error": spread * more**-0.5,
            "known_to": 0.0,
            "own": more == 1.0,
        }
    )


@figure
def errors_and_costs(sheet: Sheet, table: pd.DataFrame) -> Words:
    """Draw the rows of `errors_of`."""
    entries = [entry for kind, entry in _KINDS.items() if kind in {*table["kind"]}]
    records = Entry("records, as of this study", INK, "dash")
    entries += [records] * ("records" in {*table["kind"]})
    entries += [Entry("not of this study", INK, "ring")]
    table["percent"] = 100.0 * np.maximum(abs(table["error"]), table["known_to"])
    ends = [(0.6 * table[name].min(), 2.0 * table[name].max()) for name in _AXES]
    panel = panel_below(sheet, entries, 260.0, *ends, log=True)
    panel.axis_x("cost of the runs over those of this study", grid=True)
    panel.axis_y("error of θ [%]")
    line = table.loc[table["kind"] == "records", _AXES]
    panel.line(line["cost"], line["percent"], INK, 1.0, records.dash)
    for row in table.to_dict("records"):
        _draw_error(panel, row, _KINDS.get(row["kind"], records).colour)
    return "Errors of θ against their cost", TEXTS["errors"]["caption"]


def _draw_error(panel: Panel, row: Mapping[Any, Any], colour: str) -> None:
    x, y = row["cost"], row["percent"]
    panel.dots([x], [y], colour, "dot" if row["own"] else "ring", 4.0)
    lower = row["kind"] == "records" or not row["error"]  # else labels overlap
    height = float(panel.at_y(y)) + 16.0 * lower - 4.0
    panel.label(x, height, row["what"], "s", left=lower)


def errors_sentence(table: pd.DataFrame) -> str:
    """Return the errors of the study, the largest first, and that of one span in a bridge."""
    own = table[table["own"]]
    own = own.assign(error=abs(own["error"])).sort_values("error", ascending=False)
    texts = TEXTS["errors"]
    named = {
        row["kind"]: texts[row["kind"]].format_map(
            row | {"percent": f"{rounded(100.0 * row['error'])} %"}
        )
        for row in own.to_dict("records")
    }
    alone = named.pop("spans", "")
    return texts["own"].format(list=", ".join(named.values())) * bool(named) + alone


def _having(given: Given, key: str) -> tuple[str, ...] | None:
    """Return the arches that have a key: no names if all have it, None if none has it."""
    having = []
    for name, arches in given.items():
        values = [value_of(arch, key) for arch in arches]
        if key == "piers":
            values = [
                value or value_of(arch, "ends") or arch.get("several")
                for value, arch in zip(values, arches)
            ]
        if key == "transverse":
            values = [*map(bool, values)]
        if key == "fill":
            values = [bool(value) and fill_weighs(value) for value in values]
        count = sum(map(_is_set, values))
        if count:
            having.append(f"{'some arches of ' * (count < len(values))}{name}")
    if not having or having == list(given):
        return () if having else None
    if len(having) > _LISTED:
        return (f"{len(having)} of {len(given)}",)
    return tuple(having)


def _is_set(value) -> bool:
    """Return whether a key holds a finite number other than 0, at any depth."""
    if isinstance(value, Mapping):
        return any(map(_is_set, value.values()))
    if isinstance(value, list | tuple):
        return any(map(_is_set, value))
    return isinstance(value, int | float) and value != 0 and math.isfinite(value)
