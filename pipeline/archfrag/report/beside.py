"""A study shown beside another one of the same arches: both curves, and what changed."""

import json
from collections.abc import Sequence
from typing import Any, NamedTuple

import xarray as xr

from archfrag.errors import InputError
from archfrag.mechanics.collapse import NOTED_GAP
from archfrag.report import picture as look
from archfrag.report.curve_figures import curve_picture, draw_answer
from archfrag.report.inputs import ReportInputs
from archfrag.report.picture import Picture
from archfrag.report.plot import Entry, Panel
from archfrag.report.summary import ArchResults, Scale, arch_results, study_config
from archfrag.study.curves import Answer


class _Side(NamedTuple):
    """One study's part in a comparison of an arch."""

    study: str
    vertical: str
    results: ArchResults
    answer: Answer


def beside_section(inputs: ReportInputs, scale: Scale) -> dict[str, Any] | None:
    """What the page shows of another study, by the names that its template uses."""
    if inputs.beside is None:
        return None
    studies = (inputs.cube, inputs.answers), inputs.beside
    cubes = [cube for cube, _ in studies]
    names = [str(cube.attrs["archfrag_study"]) for cube in cubes]
    refused = f"study {names[1]!r} cannot be shown beside {names[0]!r}"
    kinds = ["{measure} [{units}]".format(**cube["intensity"].attrs) for cube in cubes]
    if kinds[0] != kinds[1]:
        raise InputError(f"{refused}: its levels are of {kinds[1]}, not of {kinds[0]}")
    own = [name for name, _, _ in inputs.arches]
    theirs = [str(name) for name in cubes[1]["arch"].values]
    common = [name for name in own if name in theirs]
    if not common:
        raise InputError(f"{refused}: it has no arch {' or '.join(own)}, but {', '.join(theirs)}")
    arches = []
    for arch in common:
        sides = [
            _Side(name, cube.attrs.get("vertical_component", "not stated"),
                  arch_results(cube, arch, scale), answers[arch])
            for name, (cube, answers) in zip(names, studies)
        ]  # fmt: skip
        arches.append({"name": arch, "curves": _curves(sides), "sides": sides})
    records = [set(each["record"].values.tolist()) for each in cubes]
    return {
        "names": names,
        "noted_gap": f"{100 * NOTED_GAP:g} %",
        "arches": arches,
        "records": [len(each) for each in records],
        "common": len(records[0] & records[1]),
        "settings": [_settings(cube, common) for cube in cubes],
    }


def _curves(sides: Sequence[_Side]) -> Picture:
    """Both curves of an arch with their bands, and the observed fractions."""
    scale = sides[0].results.scale
    reach = 1.05 * max(side.results.levels.max() for side in sides)
    strokes = [
        Entry(sides[0].study, look.BLUE, "line"), Entry(sides[1].study, look.VERMILION, "dash"),
    ]  # fmt: skip

    def draw(panel: Panel) -> None:
        for side, stroke, mark in zip(sides, strokes, ("dot", "ring")):
            draw_answer(panel, side.answer, scale, stroke)
            known = side.results.known
            used = known.n > 0
            fraction = known.collapsed[used] / known.n[used]
            panel.dots(side.results.levels[used], fraction, stroke.colour, mark)

    medians = (
        f"{side.study} no curve" if isinstance(side.answer.curve, str)
        else f"{side.study} median {scale.text(side.answer.curve.theta)}"
        for side in sides
    )  # fmt: skip
    return curve_picture(
        draw, strokes, (reach, scale.label),
        alternative=f"Probability of collapse of {sides[0].results.arch} against {scale.label} in "
        f"two studies: {', '.join(medians)}",
    )  # fmt: skip


def _settings(cube: xr.Dataset, arches: Sequence[str]) -> dict[str, str]:
    config = study_config(cube)
    parts = {name: config.get(name, {}) for name in ("intensity", "method")}
    entries = {entry["id"]: entry for entry in config.get("arches", ())}
    parts |= {f"arches.{name}": entries[name] for name in arches if name in entries}
    return {
        f"{part}.{key}": json.dumps(value, ensure_ascii=False)
        for part, values in parts.items()
        for key, value in values.items()
    }
