"""Curves in the formats of other programs: OpenQuake's NRML 0.5, pelicun, IN-CORE's DFR3.

Units are those that the receiver expects and are named in each file.
"""

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np
import pandas as pd

from archfrag.errors import InputError
from archfrag.files import check_targets, make_folder, write_csv
from archfrag.fragility.curve import Curve
from archfrag.motions.measures import parse_measure
from archfrag.motions.motion import STANDARD_GRAVITY
from archfrag.study.file.schema import StudyKeys
from archfrag.study.provenance import commit, write_text
from archfrag.version import __version__

NAMESPACE = "http://openquake.org/xmlns/nrml/0.5"
# OpenQuake holds a curve constant above its highest level: 4 dispersions above the median that
# costs 3.2e-5 of probability.
_REACH = 4.0
_GRID = np.linspace(-_REACH, _REACH, 201)  # levels of a discrete curve, in dispersions
_MOST = 4  # limit states in IN-CORE
# Receivers' units over those of SI.
_FACTORS = dict.fromkeys(("g", "g s"), 1.0 / STANDARD_GRAVITY)
_FACTORS |= {"cm/s": 100.0, "cmps": 100.0, "cm": 100.0, "m": 1.0, "m/s": 1.0}
# What receivers call the kinds of measures (OpenQuake: hazardlib's imt.py).
_KNOWN = pd.read_csv(Path(__file__).with_name("receivers.csv"))
_VELOCITY = (
    "PGV is in cm/s as in OpenQuake 3.26 and later; earlier engines divide the PGV of fields from "
    "a ShakeMap by 100, so that their losses are wrong; write minimum_engine_version = 3.26"
)
Texts = dict[str, str]
Branches = dict[str, tuple[str, float]]  # arch and weight
Curves = Mapping[str, Curve]  # by arch or limit state
# Format, end of a file's name, and a text or a table in pieces.
Content = tuple[str, str, str | Iterable[pd.DataFrame]]


def made_by(study: StudyKeys) -> Texts:
    """Return entries for files: their study, and version and commit of archfrag."""
    made = {"study": study.id, "title": study.title}
    return made | {"archfrag": __version__, "archfrag_commit": commit()}


def write_files(
    study: StudyKeys, folder: Path | None, content: Sequence[Content]
) -> list[Texts]:
    """Write files into a folder; return the format and the path of each.

    If `folder` is None, it is that of the study's exports. Nothing is written if one file would
    replace a file that archfrag did not make.
    """
    folder = folder or study.folder / "export"
    paths = [folder / f"{study.id}-{ending}" for _, ending, _ in content]
    check_targets(paths)
    make_folder(folder)
    for path, (_, _, each) in zip(paths, content):
        if isinstance(each, str):
            write_text(path, each)
        else:
            write_csv(path, each)
    named = zip(content, paths)
    return [{"format": name, "file": str(path)} for (name, _, _), path in named]


@dataclass(frozen=True)
class CurveSet:
    """Lognormal curves of several arches, each at the same ordered limit states."""

    # By arch and limit state, from the mildest to the severest, theta in the SI unit of the
    # measure.
    curves: Mapping[str, Curves]
    left_out: Mapping[str, str]  # by arch the reason why it has no curve of collapse
    # Intensity measure, as `archfrag.motions.measures.parse_measure` reads it.
    measure: str
    levels: tuple[float, float]  # lowest and highest intensity that was simulated [SI]
    # Study, title, versions and commits of archfrag, SHA-256 of the cube.
    made: Mapping[str, str]
    # Number of arches of each class.
    classes: Mapping[str, int] = field(default_factory=dict)
    # Notes on limit states that are left out or were made consistent.
    remarks: Sequence[str] = ()
    # Arch and weight of each branch.
    branches: Branches = field(default_factory=dict)

    def described(self, name: str) -> str:
        """Return a text that says which arch, class or branch a curve is of."""
        if name in self.branches:
            arch, weight = self.branches[name]
            return f"{self.described(arch)}; branch of weight {weight:.6f}"
        if name not in self.classes:
            return f"Masonry arch {name}"
        return (
            f"Class {name} of {self.classes[name]} masonry arches, each as likely as another; "
            "median and dispersion are those of ln capacity over the class"
        )

    def origin(self, condition: str) -> str:
        """Return a text on how the curves were made, without characters that XML forbids."""
        text = (
            "{title}. Study {study}, exported by archfrag {archfrag} (commit {archfrag_commit}) "
            "from the cube with SHA-256 {cube_sha256} (commit {cube_archfrag_commit})."
        )
        title = "".join(c if c.isprintable() else " " for c in self.made["title"])
        made = text.format_map({**self.made, "title": title.rstrip(".")})
        remarks = filter(None, (condition, *self.remarks))
        return made + "".join(f" Note: {each}." for each in remarks)

    @property
    def limit_states(self) -> tuple[str, ...]:
        """Names of the limit states, from the mildest to the severest."""
        return tuple(next(iter(self.curves.values()), ()))


class MeasureName(NamedTuple):
    """An intensity measure as a receiver calls it."""

    name: str
    unit: str
    factor: float  # value in `unit` over value in SI
    condition: (
        str  # what the receiver's measure must be for the curve to hold, or empty
    )


def named_measure(receiver: str, measure: str) -> MeasureName:
    """Return the name and the unit of a measure in a receiver.

    `receiver` is ``"OpenQuake"``, ``"pelicun"`` or ``"IN-CORE"``. InputError if it has no name for
    the measure.
    """
    parsed = parse_measure(measure)
    known = {kind: names for of, kind, *names in _KNOWN.values if of == receiver}
    if parsed.kind not in known:
        permanent = ""
        if receiver == "pelicun":
            permanent = " (its PGD is permanent ground deformation)"
        raise InputError(
            f"{receiver} has no name for the intensity measure {measure}; it knows "
            f"{', '.join(known)}{permanent}; csv takes any"
        )
    name, unit = known[parsed.kind]
    messages = []
    if (receiver, parsed.kind) == ("OpenQuake", "PGV"):
        messages.append(_VELOCITY)
    if parsed.kind == "AvgSA":
        first, last = parsed.periods
        messages.append(
            "OpenQuake's AvgSA must be the geometric mean of spectral accelerations from "
            f"{first:g} to {last:g} s, as {measure} is; its periods are set with the "
            "ground-motion model"
        )
    if parsed.rotated:
        messages.append(
            f"{parsed.kind} must be {parsed.rotated} of two horizontal components"
        )
    return MeasureName(
        name.format(*parsed.periods), unit, _FACTORS[unit], "; ".join(messages)
    )


def nrml_continuous(curves: CurveSet) -> str:
    """Return lognormal curves as NRML, by the mean and the standard deviation of capacity.

    mean = theta exp(beta^2 / 2) and stddev = mean sqrt(exp(beta^2) - 1). OpenQuake holds a curve
    constant below ``minIML``, which is 0, and above ``maxIML``, 4 dispersions above the highest
    median, where it is 0.99997.
    """
    imt, root, functions = _nrml(curves, "", format="continuous", shape="logncdf")
    for function, states in functions:
        tops = (fit.theta * np.exp(_REACH * fit.beta) for fit in states.values())
        top = _row([imt.factor * max(tops)])
        ends = {"noDamageLimit": "0.0", "minIML": "0.0", "maxIML": top}
        _add(function, "imls", imt=imt.name, **ends)
        for state, fit in states.items():
            mean = imt.factor * fit.theta * np.exp(0.5 * fit.beta**2)
            stddev = mean * np.sqrt(np.expm1(fit.beta**2))
            _add(function, "params", ls=state, mean=_row([mean]), stddev=_row([stddev]))
    return _xml(root)


def nrml_discrete(curves: CurveSet) -> str:
    """Return curves as NRML, by their probabilities at levels 0.04 dispersions apart.

    The levels reach over 4 dispersions to both sides of each median and over the study's range.
    OpenQuake interpolates linearly between them, within 1e-4 for dispersions up to 1, and holds
    the curve constant above the highest, here at 0.99997 or more.
    """
    more = "Probabilities hold at the levels and are to be interpolated linearly. "
    imt, root, functions = _nrml(curves, more, format="discrete")
    for function, states in functions:
        parts = [fit.theta * np.exp(fit.beta * _GRID) for fit in states.values()]
        levels = np.unique(imt.factor * np.concatenate([*parts, curves.levels]))
        _add(function, "imls", _row(levels), imt=imt.name, noDamageLimit="0.0")
        for state, fit in states.items():
            _add(function, "poes", _row(fit.probability(levels / imt.factor)), ls=state)
    return _xml(root)


def nrml_vulnerability(points: pd.DataFrame, study: StudyKeys) -> str:
    """Return mean loss ratios as NRML.

    Coefficients of variation are 0, since only the mean is known.
    """
    measure = study.intensity.measure
    imt = named_measure("OpenQuake", measure)
    root = Element("nrml", {"xmlns": NAMESPACE})
    about = {"assetCategory": "masonry arches", "id": _nrml_id(study.id)}
    model = _add(root, "vulnerabilityModel", **about, lossCategory="structural")
    text = f"Mean loss ratio against {measure} in {imt.unit}; study {study.id}."
    text += f" Note: {imt.condition}." * bool(imt.condition)
    _add(model, "description", text)
    for arch, rows in points[points["im"] > 0.0].groupby("arch", sort=False):
        function = _add(model, "vulnerabilityFunction", id=str(arch), dist="LN")
        levels = rows["im"] * study.intensity.factor * imt.factor
        _add(function, "imls", _row(levels), imt=imt.name)
        _add(function, "meanLRs", _row(rows["loss_ratio"]))
        _add(function, "covLRs", _row(0.0 * rows["loss_ratio"]))
    return _xml(root)


def _nrml_id(name: str) -> str:
    return re.sub(r"[^A-Za-z0-9_:-]", "_", name)[:75]


def _nrml(
    curves: CurveSet, more: str, **kind: str
) -> tuple[MeasureName, Element, list[tuple[Element, Curves]]]:
    """Return the measure, the root of an NRML file, and each arch's function and curves."""
    imt = named_measure("OpenQuake", curves.measure)
    gml = {"xmlns:gml": "http://www.opengis.net/gml"}
    root = Element("nrml", {"xmlns": NAMESPACE} | gml)
    about = {"id": _nrml_id(curves.made["study"]), "assetCategory": "masonry arches"}
    model = _add(root, "fragilityModel", **about, lossCategory="structural")
    texts = [
        f"Probability of exceeding each limit state against {curves.measure} in {imt.unit}. "
        f"{more}{curves.origin(imt.condition)}"
    ]
    texts += [f" {curves.described(name)}." for name in curves.classes]
    texts += [f" {name}: {curves.described(name)}." for name in curves.branches]
    texts += [f" No curve for {a}: {why}." for a, why in curves.left_out.items()]
    _add(model, "description", "".join(texts))
    _add(model, "limitStates", " ".join(curves.limit_states))
    functions = [
        (_add(model, "fragilityFunction", id=arch, **kind), states)
        for arch, states in curves.curves.items()
    ]
    return imt, root, functions


def _add(
    parent: Element, tag: str, text: str | None = None, **attributes: str
) -> Element:
    element = SubElement(parent, tag, attributes)
    element.text = text
    return element


def _row(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)


def _xml(root: Element) -> str:
    indent(root, " ")
    body = tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{body}\n'


def _text(content: dict[str, object]) -> str:
    return json.dumps(content, indent=2, ensure_ascii=False) + "\n"


def branch_weights(curves: CurveSet) -> str:
    """Return the weights of branches as CSV, in OpenQuake's mapping of taxonomies.

    The taxonomies are the arches.
    """
    rows = [(arch, name, weight) for name, (arch, weight) in curves.branches.items()]
    table = pd.DataFrame(rows, columns=["taxonomy", "risk_id", "weight"])
    return table.to_csv(index=False, lineterminator="\n")


def pelicun_table(curves: CurveSet) -> str:
    """Return the parameters of all arches as CSV, with a component for each arch.

    ``Theta_0`` is the median in ``Demand-Unit`` (g or cmps), ``Theta_1`` the dispersion.
    ``Demand-Directional`` is 1: with 0 pelicun would multiply the demand by 1.2.
    """
    demand = named_measure("pelicun", curves.measure)
    rows = []
    for name, arch in _by_id(curves).items():
        row = {
            "ID": name,
            "Incomplete": 0,
            "Demand-Type": demand.name,
            "Demand-Unit": demand.unit,
            "Demand-Offset": 0,
            "Demand-Directional": 1,
        }
        for n, fit in enumerate(curves.curves[arch].values(), start=1):
            row[f"LS{n}-Family"] = "lognormal"
            row[f"LS{n}-Theta_0"] = float(demand.factor * fit.theta)
            row[f"LS{n}-Theta_1"] = float(fit.beta)
        rows.append(row)
    return pd.DataFrame(rows).to_csv(index=False, lineterminator="\n")


def pelicun_description(curves: CurveSet) -> str:
    """Return JSON that describes the table, in the layout of pelicun's own databases."""
    condition = named_measure("pelicun", curves.measure).condition
    general = {
        "ShortName": curves.made["study"],
        "Description": curves.origin(condition),
        "Version": curves.made["archfrag"],
        "ComponentGroups": ["Masonry arches"],
        "archfrag": curves.made,
        "LeftOut": curves.left_out,
    }
    states = {
        f"LS{n}": {f"DS{n}": {"Description": state}}
        for n, state in enumerate(curves.limit_states, start=1)
    }
    components = {
        name: {
            "Description": curves.described(arch),
            "SuggestedComponentBlockSize": "1 EA",
            "RoundUpToIntegerQuantity": "True",
            "LimitStates": states,
        }
        for name, arch in _by_id(curves).items()
    }
    return _text({"_GeneralInformation": general, **components})


def _by_id(curves: CurveSet) -> Texts:
    """Return the arches by their ids in pelicun; InputError if two have the same id."""
    arches = Texts()
    for arch in curves.curves:
        name = re.sub(r"[^A-Za-z0-9_.]", "_", arch)
        if name in arches:
            raise InputError(
                f"arch {arch!r} would have the id {name!r} in pelicun, as another arch has; "
                "pelicun's ids hold letters, digits, _ and . only"
            )
        arches[name] = arch
    return arches


def in_core_sets(curves: CurveSet) -> Texts:
    """Return a DFR3 set in JSON for each arch, by arch.

    IN-CORE takes exactly four curves for a bridge under an earthquake. These are the four
    severest. If there are fewer limit states, the severest is repeated. The damage states between
    its copies then have probability 0, and the last one has its probability.
    """
    demand = named_measure("IN-CORE", curves.measure)
    variable = demand.name.rsplit(maxsplit=1)[-1].lower()  # pga, pgv, pgd or sa
    lognormal = "scipy.stats.norm.cdf((math.log({}) - math.log({!r})) / {!r})"
    sets = {}
    for arch, states in curves.curves.items():
        kept = [*states.items()][-_MOST:]
        last, severest = kept[-1]
        repeated = f"{last}, repeated since IN-CORE takes {_MOST} limit states"
        kept += [(repeated, severest)] * (_MOST - len(kept))
        rules = []
        for n, (state, fit) in enumerate(kept):
            theta = float(demand.factor * fit.theta)
            expression = lognormal.format(variable, theta, float(fit.beta))
            name = f"LS_{n}"
            rules.append(
                {
                    "description": f"{name}: {state}",
                    "curveParameters": None,
                    "returnType": {
                        "type": "Limit State",
                        "unit": "",
                        "description": name,
                    },
                    "rules": [
                        {"condition": [f"{variable} > 0"], "expression": expression}
                    ],
                }
            )
        sets[arch] = _text(
            {
                "description": f"{curves.described(arch)}. {curves.origin(demand.condition)}",
                "creator": f"archfrag {curves.made['archfrag']}",
                "demandTypes": [demand.name],
                "demandUnits": [demand.unit],
                "resultType": "Limit State",
                "resultUnit": "",
                "hazardType": "earthquake",
                "inventoryType": "bridge",
                "curveParameters": [
                    {
                        "name": variable,
                        "unit": demand.unit,
                        "description": f"{curves.measure} as {demand.name}",
                        "fullName": demand.name,
                        "expression": None,
                    }
                ],
                "fragilityCurves": rules,
            }
        )
    return sets
