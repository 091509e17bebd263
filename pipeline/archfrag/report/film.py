"""A run of a finished study as a film: found by its record and level, simulated again, written."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from archfrag.errors import InputError
from archfrag.files import make_folder, replacing
from archfrag.report.arch_figure import Chosen, Example, repeat, typical_run
from archfrag.report.html import digits
from archfrag.report.inputs import ArchResults, arch_results, report_inputs
from archfrag.report.moving import film
from archfrag.study.file.schema import Study
from archfrag.study.keys import meant

KINDS = (".gif", ".mp4", ".svg")
_SAME_LEVEL = 0.005  # a level is written with three digits


def check_target(path: Path) -> None:
    """Raise InputError unless a film can be written in the format of this name."""
    kind = path.suffix.lower()
    if kind not in KINDS:
        raise InputError(f"--to {path}: a film is written as {', '.join(KINDS)}")
    if kind == ".mp4":
        from matplotlib.animation import writers

        if not writers.is_available("ffmpeg"):
            raise InputError(f"--to {path}: .mp4 needs ffmpeg, which is not installed; use .gif")


def example_of(study: Study, run: str = "median", arch: str | None = None) -> Example:
    """Simulate one run of a finished study again: `run` and `arch` of `Results.response`.

    InputError if the study is not finished, or has no such arch or run.
    """
    inputs = report_inputs(study)
    shapes = {name: shape for name, shape, _ in inputs.arches}
    name = next(iter(shapes)) if arch is None else arch
    if name not in shapes:
        hint = meant(name, shapes) or f"the report shows {', '.join(shapes)}"
        raise InputError(f"--arch {name}: is not an arch of the report; {hint}")
    results = arch_results(inputs.cube, name, inputs.scale, inputs.fitted.runs[name])
    if run == "median":
        example = typical_run(inputs, results, list(shapes).index(name))
    else:
        example = repeat(inputs, results, shapes[name], _named(results, run))
    if example is None:
        raise InputError(f"--run {run}: no run of {name} moved the arch, so there is no film")
    return example


def _named(results: ArchResults, run: str) -> Chosen:
    """Record and level that RECORD@LEVEL names."""
    name, _, text = run.rpartition("@")
    unit = results.scale.unit
    try:
        level = float(re.sub(rf"\s*{re.escape(unit)}$", "", text))
    except ValueError:
        level = np.nan
    if not (name and level > 0.0):
        example = f"{results.records[0]}@{digits(results.levels[0])}"
        raise InputError(f"--run {run}: must be median or RECORD@LEVEL, such as {example}")
    if name not in results.records:
        hint = meant(name, results.records) or f"it has {', '.join(results.records)}"
        raise InputError(f"--run {run}: the study has no record {name}; {hint}")
    record = results.records.index(name)
    made = np.flatnonzero(results.simulated[record])
    levels = results.levels[made]
    if results.own_levels is not None:
        levels = results.own_levels[[record] * made.size]
    near = np.abs(np.log(levels / level))
    if not (near < _SAME_LEVEL).any():
        known = ", ".join(digits(value) for value in levels) or "none"
        raise InputError(f"--run {run}: {name} was run at {known} {unit}, not at {text}")
    return record, int(made[near.argmin()]), "the run that was asked for"


def save_film(example: Example, path: Path) -> None:
    """Write a film as .gif, .mp4 (where ffmpeg is installed) or .svg, which browsers play.

    InputError if nothing moves, OutputError if the file cannot be written.
    """
    check_target(path)
    shown = film(example, "film", "A collapse" if example.response.collapsed else "A run")
    if shown is None:
        raise InputError(f"{path}: nothing moves in this run, so there is no film")
    make_folder(path.parent)
    picture, _ = shown
    with replacing(path) as part:
        if path.suffix.lower() == ".svg":
            (moving,) = re.findall('<svg class="moving".*?</svg>', str(picture.svg), re.DOTALL)
            part.write_text(replace(picture, svg=moving).file, encoding="utf-8")
            return
        named = part.with_name(part.name + path.suffix.lower())
        try:
            example.response.animate().save(named)
            named.replace(part)
        finally:
            named.unlink(missing_ok=True)
