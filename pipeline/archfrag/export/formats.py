"""Curves in the formats of other programs: OpenQuake's NRML 0.5, pelicun, IN-CORE's DFR3."""

import csv
import io
import json
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterable
from dataclasses import asdict
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from archfrag.errors import InputError
from archfrag.export import CurveSet
from archfrag.files import write_csv
from archfrag.fragility.curve import Fragility
from archfrag.motions.measures import parse_measure
from archfrag.motions.motion import STANDARD_GRAVITY

NAMESPACE = "http://openquake.org/xmlns/nrml/0.5"
# OpenQuake holds a curve constant above its highest level: 4 dispersions above the median that
# costs 3.2e-5 of probability.
_REACH = 4.0
_GRID = np.linspace(-_REACH, _REACH, 201)  # levels of a discrete curve, in dispersions
_MOST = 4  # limit states in IN-CORE
_PER_G = 1.0 / STANDARD_GRAVITY
# Receivers' units over those of SI.
_FACTORS = {
    "g": _PER_G, "g s": _PER_G, "cm/s": 100.0, "cmps": 100.0, "cm": 100.0, "m": 1.0, "m/s": 1.0,
}  # fmt: skip
# What receivers call the kinds of measures (OpenQuake: hazardlib's imt.py).
with open(Path(__file__).with_name("receivers.csv"), newline="", encoding="utf-8") as _file:
    _KNOWN = list(csv.DictReader(_file))


class Named(NamedTuple):
    """An intensity measure as a receiver calls it."""

    name: str
    unit: str
    factor: float  # times a value in SI gives one in `unit`
    note: str  # what the receiver's measure must be for the curve to hold, or empty

    @property
    def remark(self) -> str:
        """The note as the end of a description."""
        return f" Note: {self.note}." if self.note else ""


def named_measure(receiver: str, measure: str) -> Named:
    """Name and unit of a measure in ``"OpenQuake"``, ``"pelicun"`` or ``"IN-CORE"``."""
    parsed = parse_measure(measure)
    known = {row["kind"]: row for row in _KNOWN if row["receiver"] == receiver}
    if (receiver, parsed.kind) == ("pelicun", "PGD"):
        raise InputError(
            "pelicun has no demand type for PGD, the peak displacement of the ground: its PGD is "
            "permanent ground deformation"
        )
    if parsed.kind not in known:
        raise InputError(
            f"{receiver} has no name for the intensity measure {measure}; it knows "
            f"{', '.join(known)}; csv and parquet take any"
        )
    name, unit = known[parsed.kind]["name"], known[parsed.kind]["unit"]
    notes = []
    if parsed.kind == "AvgSA":
        first, last = parsed.periods
        notes.append(
            "OpenQuake's AvgSA must be the geometric mean of spectral accelerations from "
            f"{first:g} to {last:g} s, as {measure} is; its periods are set with the "
            "ground-motion model"
        )
    if parsed.rotated:
        must = f"must be {parsed.rotated} of two horizontal components"
        notes.append(f"the values of {parsed.kind} {must}")
    return Named(name.format(*parsed.periods), unit, _FACTORS[unit], "; ".join(notes))


def nrml_continuous(curves: CurveSet) -> str:
    """Lognormal curves by mean and standard deviation of the intensity.

    OpenQuake wants those of the capacity itself, not of its logarithm: with median theta and
    dispersion beta, mean = theta exp(beta^2 / 2) and stddev = mean sqrt(exp(beta^2) - 1).
    ``minIML`` is 0, since below it OpenQuake would hold the curve constant; above ``maxIML``,
    4 dispersions above the highest median, it does so at 0.99997.
    """
    imt, root, functions = _nrml(curves, {"format": "continuous", "shape": "logncdf"}, "")
    for function, states in functions:
        top = imt.factor * max(fit.theta * np.exp(_REACH * fit.beta) for fit in states.values())
        _add(function, "imls", imt=imt.name, noDamageLimit="0.0", minIML="0.0", maxIML=_row([top]))
        for state, fit in states.items():
            mean = imt.factor * fit.theta * np.exp(0.5 * fit.beta**2)
            stddev = mean * np.sqrt(np.expm1(fit.beta**2))
            _add(function, "params", ls=state, mean=_row([mean]), stddev=_row([stddev]))
    return _xml(root)


def nrml_discrete(curves: CurveSet) -> str:
    """Curves by their probabilities at 201 levels for each limit state.

    They are 0.04 dispersions apart and reach 4 dispersions to both sides of the median and over
    the study's range. OpenQuake interpolates linearly between them, within 1e-4 for dispersions
    up to 1, and holds the curve constant above the highest, here at 0.99997 or more.
    """
    more = "Probabilities hold at the levels and are to be interpolated linearly. "
    imt, root, functions = _nrml(curves, {"format": "discrete"}, more)
    for function, states in functions:
        parts = [fit.theta * np.exp(fit.beta * _GRID) for fit in states.values()]
        levels = np.unique(imt.factor * np.concatenate([*parts, curves.levels]))
        _add(function, "imls", _row(levels), imt=imt.name, noDamageLimit="0.0")
        for state, fit in states.items():
            _add(function, "poes", _row(fit.probability(levels / imt.factor)), ls=state)
    return _xml(root)


Element = ElementTree.Element


def _nrml(
    curves: CurveSet, kind: dict[str, str], more: str
) -> tuple[Named, Element, list[tuple[Element, dict[str, Fragility]]]]:
    """The measure, the root of a file, and the function of each arch with its curves."""
    imt, complete = named_measure("OpenQuake", curves.measure), curves.require_curves("OpenQuake")
    namespaces = {"xmlns": NAMESPACE, "xmlns:gml": "http://www.opengis.net/gml"}
    root = Element("nrml", namespaces)
    name = re.sub(r"[^A-Za-z0-9_:-]", "_", curves.made.study)[:75]
    about = {"id": name, "assetCategory": "masonry arches", "lossCategory": "structural"}
    model = _add(root, "fragilityModel", **about)
    of = "".join(f" {curves.described(name)}." for name in curves.classes)
    left = "".join(f" No curve for {arch}: {why}." for arch, why in curves.left_out.items())
    text = f"Probability of exceeding each limit state against {curves.measure} in {imt.unit}. "
    _add(model, "description", f"{text}{more}{curves.made.text}{imt.remark}{of}{left}")
    _add(model, "limitStates", " ".join(curves.limit_states))
    functions = [
        (_add(model, "fragilityFunction", id=arch, **kind), states)
        for arch, states in complete.items()
    ]
    return imt, root, functions


def _add(parent: Element, tag: str, text: str | None = None, **attributes: str) -> Element:
    element = ElementTree.SubElement(parent, tag, attributes)
    element.text = text
    return element


def _row(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)


def _xml(root: Element) -> str:
    ElementTree.indent(root, " ")
    body = ElementTree.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{body}\n'


def _text(content: dict[str, object]) -> str:
    return json.dumps(content, indent=2, ensure_ascii=False) + "\n"


def pelicun_table(curves: CurveSet) -> str:
    """Parameters of all arches as CSV, a component for each arch.

    ``Theta_0`` is the median in ``Demand-Unit`` (g or cmps), ``Theta_1`` the dispersion.
    ``Demand-Directional`` is 1: with 0 pelicun would multiply the demand by 1.2.
    """
    demand, complete = named_measure("pelicun", curves.measure), curves.require_curves("pelicun")
    rows = []
    for arch, name in _ids(complete).items():
        row = {
            "ID": name, "Incomplete": 0, "Demand-Type": demand.name, "Demand-Unit": demand.unit,
            "Demand-Offset": 0, "Demand-Directional": 1,
        }  # fmt: skip
        for n, fit in enumerate(complete[arch].values(), start=1):
            row |= {
                f"LS{n}-Family": "lognormal", f"LS{n}-Theta_0": float(demand.factor * fit.theta),
                f"LS{n}-Theta_1": float(fit.beta),
            }  # fmt: skip
        rows.append(row)
    text = io.StringIO()
    write_csv(text, [pd.DataFrame(rows)])
    return text.getvalue()


def pelicun_description(curves: CurveSet) -> str:
    """What stands beside the table, as JSON in the layout of pelicun's own databases."""
    remark = named_measure("pelicun", curves.measure).remark
    general = {
        "ShortName": curves.made.study, "Description": curves.made.text + remark,
        "Version": curves.made.archfrag, "ComponentGroups": ["Masonry arches"],
        "archfrag": asdict(curves.made), "LeftOut": curves.left_out,
    }  # fmt: skip
    states = {
        f"LS{n}": {f"DS{n}": {"Description": state}}
        for n, state in enumerate(curves.limit_states, start=1)
    }
    components = {
        name: {
            "Description": curves.described(arch), "SuggestedComponentBlockSize": "1 EA",
            "RoundUpToIntegerQuantity": "True", "LimitStates": states,
        }
        for arch, name in _ids(curves.require_curves("pelicun")).items()
    }  # fmt: skip
    return _text({"_GeneralInformation": general, **components})


def _ids(arches: Iterable[str]) -> dict[str, str]:
    """pelicun's id of each arch."""
    names: dict[str, str] = {}
    for arch in arches:
        name = re.sub(r"[^A-Za-z0-9_.]", "_", arch)
        if name in names.values():
            raise InputError(
                f"arch {arch!r} would have the id {name!r} in pelicun, as another arch has; "
                "pelicun's ids hold letters, digits, _ and . only"
            )
        names[arch] = name
    return names


def in_core_sets(curves: CurveSet) -> dict[str, str]:
    """A set for each arch, as JSON.

    IN-CORE takes four curves for a bridge under an earthquake, no more and no fewer: the severest
    four. Where there are fewer limit states, the severest is repeated: the damage states between
    then have probability 0, and the last has that of the severest.
    """
    demand, complete = named_measure("IN-CORE", curves.measure), curves.require_curves("IN-CORE")
    variable = demand.name.rsplit(maxsplit=1)[-1].lower()  # pga, pgv, pgd or sa
    lognormal = "scipy.stats.norm.cdf((math.log({}) - math.log({!r})) / {!r})"
    sets = {}
    for arch, states in complete.items():
        kept = list(states.items())[-_MOST:]
        last, severest = kept[-1]
        repeated = f"{last}, repeated since IN-CORE takes {_MOST} limit states"
        rules = []
        for n, (state, fit) in enumerate(kept + [(repeated, severest)] * (_MOST - len(kept))):
            theta, beta = float(demand.factor * fit.theta), float(fit.beta)
            expression = lognormal.format(variable, theta, beta)
            rules.append({
                "description": f"LS_{n}: {state}",
                "curveParameters": None,
                "returnType": {"type": "Limit State", "unit": "", "description": f"LS_{n}"},
                "rules": [{"condition": [f"{variable} > 0"], "expression": expression}],
            })  # fmt: skip
        sets[arch] = _text({
            "description": f"{curves.described(arch)}. {curves.made.text}{demand.remark}",
            "creator": f"archfrag {curves.made.archfrag}",
            "demandTypes": [demand.name], "demandUnits": [demand.unit],
            "resultType": "Limit State", "resultUnit": "",
            "hazardType": "earthquake", "inventoryType": "bridge",
            "curveParameters": [{
                "name": variable, "unit": demand.unit,
                "description": f"{curves.measure} as {demand.name}",
                "fullName": demand.name, "expression": None,
            }],
            "fragilityCurves": rules,
        })  # fmt: skip
    return sets


# By name of a format: its receiver, and the texts of its files by the ends of their names, with a
# text for each arch where {arch} stands in it.
FORMATS: dict[str, tuple[str, dict[str, Callable[[CurveSet], str | dict[str, str]]]]] = {
    "nrml-continuous": ("OpenQuake", {"fragility-continuous.xml": nrml_continuous}),
    "nrml-discrete": ("OpenQuake", {"fragility-discrete.xml": nrml_discrete}),
    "pelicun": ("pelicun", {"pelicun.csv": pelicun_table, "pelicun.json": pelicun_description}),
    "in-core": ("IN-CORE", {"in-core-{arch}.json": in_core_sets}),
}
