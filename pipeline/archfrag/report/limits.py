"""What a study models and what not, in sentences that follow from its arches."""

import math
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from archfrag.arch import Arch
from archfrag.arch.bridge import fill_weighs
from archfrag.properties import value_of
from archfrag.report.html import TEXTS
from archfrag.report.inputs import ReportInputs, several
from archfrag.study.answer.curves import arch_classes

_LISTED = 3  # names of arches in a sentence
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
