"""What a study models and what not, in sentences that follow from its arches."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any

from archfrag.report.html import TEXTS
from archfrag.report.inputs import ReportInputs
from archfrag.study.answer.curves import arch_classes

_LISTED = 3  # names of arches in a sentence
Given = Mapping[str, Sequence[Mapping[str, Any]]]  # keys of the arches, by name of arch or class


@dataclass(frozen=True)
class Aspect:
    """Something that a model of an arch may have or lack."""

    modelled: bool
    name: str  #: in a list; may be empty
    sentence: str


def aspects(
    given: Given, vertical: str = "not used", delay: float | None = None, spanning: bool = True
) -> list[Aspect]:
    """Return what is modelled and what is not, each with its sentence.

    `vertical` is the attribute ``vertical_component`` of a cube, `delay` that of the method in
    seconds; `spanning` is false if all arches are free-standing.
    """
    counted = vertical.removeprefix("used").strip()
    others = {
        "always": (), "never": None, "delay": () if delay else None,
        "vertical": None if vertical == "not used" else (counted,) if counted else (),
        "sliding": () if any(map(_slides, chain.from_iterable(given.values()))) else None,
    }  # fmt: skip
    found = []
    for text in TEXTS["limits"]:
        key = text["key"]
        if text.get("spanning") and not spanning:
            continue
        whose = others[key] if key in others else _having(given, key)
        words = "" if not whose else f" ({', '.join(whose)})"
        kind = "no" if whose is None else "yes"
        sentence = text[kind].format(of=words, delay=delay or 0.0)
        name = text.get(f"{kind}_name", "")
        found.append(Aspect(whose is not None, name + words * bool(name), sentence))
    return found


def study_aspects(inputs: ReportInputs) -> list[Aspect]:
    """Return what the study of a report models and what not."""
    cube, of_class, given = inputs.cube, arch_classes(inputs.cube), inputs.given
    if not given:  # a report without a study file
        given = {of_class[name]: [arch.parameters] for name, arch, _ in inputs.arches}
    return aspects(
        given, cube.attrs.get("vertical_component", "not used"),
        inputs.config.get("method", {}).get("delay"),
        not all(arch.free_end for _, arch, _ in inputs.arches),
    )  # fmt: skip


def short(found: Iterable[Aspect]) -> str:
    """Write a line on what is modelled and what is not."""
    lists = (
        ", ".join(each.name for each in found if each.name and each.modelled == modelled)
        for modelled in (True, False)
    )
    return "Modelled: {}. Not modelled: {}".format(*lists)


def base_of(free_end: bool, parameters: Mapping[str, Any]) -> str:
    """Return the words for joint 0 of an arch."""
    if free_end:
        return "the base"
    return "the base of the left pier" if "piers" in parameters else "the left springing"


def _having(given: Given, key: str) -> tuple[str, ...] | None:
    """Return the arches that have a key: none of their names if all have it; None if none has."""
    counts = {name: sum(_is_set(each.get(key)) for each in own) for name, own in given.items()}
    having = [
        name if count == len(given[name]) else f"some arches of {name}"
        for name, count in counts.items() if count
    ]  # fmt: skip
    if not having:
        return None
    if having == list(given):
        return ()
    return tuple(having) if len(having) <= _LISTED else (f"{len(having)} of {len(given)}",)


def _is_set(value: Any) -> bool:
    """Return whether a key holds a number other than 0, at any depth."""
    if isinstance(value, Mapping):
        return any(map(_is_set, value.values()))
    if isinstance(value, list | tuple):
        return any(map(_is_set, value))
    return isinstance(value, int | float) and value != 0


def _slides(arch: Mapping[str, Any]) -> bool:
    """Return whether a joint can slide, those of piers included."""
    known = [arch.get("friction"), (arch.get("piers") or {}).get("friction")]
    values = [one for each in known for one in (each if isinstance(each, list) else [each])]
    return any(isinstance(one, int | float) and math.isfinite(one) for one in values)
