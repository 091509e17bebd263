"""Fragility models in NRML 0.5, for OpenQuake."""

import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable

import numpy as np

from archfrag.export.curve_set import CurveSet
from archfrag.export.receivers import Named, named_measure

NAMESPACE = "http://openquake.org/xmlns/nrml/0.5"
# OpenQuake holds a curve constant above its highest level: 4 dispersions above the median that
# costs 3.2e-5 of probability.
_REACH = 4.0
_GRID = np.linspace(-_REACH, _REACH, 201)  # levels of a discrete curve, in dispersions


def nrml_continuous(curves: CurveSet) -> str:
    """Lognormal curves by mean and standard deviation of the intensity.

    OpenQuake wants those of the capacity itself, not of its logarithm: with median theta and
    dispersion beta, mean = theta exp(beta^2 / 2) and stddev = mean sqrt(exp(beta^2) - 1).
    ``minIML`` is 0, since below it OpenQuake would hold the curve constant; above ``maxIML``,
    4 dispersions above the highest median, it does so at 0.99997.

    In a job file: ``structural_fragility_file``, with the ids of the arches as taxonomies;
    `continuous_fragility_discretization` (20 by default) cuts the range into levels in classical
    damage calculations, 100 or more are advised.
    """
    imt = named_measure("OpenQuake", curves.measure)
    complete = curves.require_curves("OpenQuake")
    root, model = _model(curves, imt, "")
    for arch, states in complete.items():
        tops = [fit.theta * float(np.exp(_REACH * fit.beta)) for fit in states.values()]
        function = ElementTree.SubElement(
            model, "fragilityFunction", id=arch, format="continuous", shape="logncdf"
        )
        limits = {"noDamageLimit": "0.0", "minIML": "0.0", "maxIML": _real(imt.factor * max(tops))}
        ElementTree.SubElement(function, "imls", {"imt": imt.name} | limits)
        for state, fit in states.items():
            variance = np.expm1(fit.beta**2)
            mean = imt.factor * fit.theta * np.exp(0.5 * fit.beta**2)
            values = {"ls": state, "mean": _real(mean), "stddev": _real(mean * np.sqrt(variance))}
            ElementTree.SubElement(function, "params", values)
    return _written(root)


def nrml_discrete(curves: CurveSet) -> str:
    """Curves by their probabilities at 201 levels for each limit state.

    Levels are 0.04 dispersions apart, the median among them, and reach from 4 dispersions below
    it to 4 above it and over the study's range: OpenQuake holds a curve constant above its
    highest level, here at 0.99997 or more. Between levels it interpolates linearly, within 1e-4
    for dispersions up to 1.
    """
    imt = named_measure("OpenQuake", curves.measure)
    complete = curves.require_curves("OpenQuake")
    more = "Probabilities hold at the levels and are to be interpolated linearly. "
    root, model = _model(curves, imt, more)
    for arch, states in complete.items():
        function = ElementTree.SubElement(model, "fragilityFunction", id=arch, format="discrete")
        parts = [fit.theta * np.exp(fit.beta * _GRID) for fit in states.values()]
        levels = np.unique(imt.factor * np.concatenate([*parts, curves.levels]))
        imls = ElementTree.SubElement(function, "imls", imt=imt.name, noDamageLimit="0.0")
        imls.text = _row(levels)
        for state, fit in states.items():
            poes = fit.probability(levels / imt.factor)
            ElementTree.SubElement(function, "poes", ls=state).text = _row(poes)
    return _written(root)


def _model(
    curves: CurveSet, imt: Named, more: str
) -> tuple[ElementTree.Element, ElementTree.Element]:
    """The root of a file and its model, with all but the functions."""
    root = ElementTree.Element(
        "nrml", {"xmlns": NAMESPACE, "xmlns:gml": "http://www.opengis.net/gml"}
    )
    name = re.sub(r"[^A-Za-z0-9_:-]", "_", curves.made.study)[:75]
    model = ElementTree.SubElement(
        root, "fragilityModel", id=name, assetCategory="masonry arches",
        lossCategory="structural",
    )  # fmt: skip
    left = "".join(f" No curve for {arch}: {why}." for arch, why in curves.left_out.items())
    note = f" Note: {imt.note}." if imt.note else ""
    ElementTree.SubElement(model, "description").text = (
        f"Probability of exceeding each limit state against {curves.measure} in {imt.unit}. {more}"
        f"{curves.made.text}{note}{left}"
    )
    ElementTree.SubElement(model, "limitStates").text = " ".join(curves.limit_states)
    return root, model


def _real(value: float) -> str:
    return repr(float(value))


def _row(values: Iterable[float]) -> str:
    return " ".join(map(_real, values))


def _written(root: ElementTree.Element) -> str:
    ElementTree.indent(root, " ")
    body = ElementTree.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{body}\n'
