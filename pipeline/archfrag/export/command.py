"""Export a study: its curves and runs, in the formats asked for."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import archfrag
from archfrag.errors import from_extra
from archfrag.export import CurveSet, Made, tables
from archfrag.export.formats import FORMATS, named_measure, written
from archfrag.files import make_folder, sha256_of, write_csv
from archfrag.fragility.curve import Fragility
from archfrag.study.answer.curves import Answer, arch_classes, curve_of_dict, quoted
from archfrag.study.answer.fits import FITS, load_answers, open_cube
from archfrag.study.file.schema import Study
from archfrag.study.files import CUBE, write_text
from archfrag.study.provenance import commit
from archfrag.study.steps import require

FOLDER = "export"
MOST_CROSSING = 0.01  # probability by which curves of two limit states may cross


def export_study(
    study: Study, formats: Sequence[str], folder: Path | None = None, members: bool = False
) -> dict[str, Any]:
    """Write curves and runs of a study in the formats of other programs.

    A class of arches has one curve.

    Parameters
    ----------
    study : Study
        Its cube and fits are there and up to date.
    formats : sequence of str
        Of nrml-continuous, nrml-discrete, pelicun, in-core, csv and parquet.
    folder : Path, optional
        ``export`` in the study's folder if not given. A file is written completely or not at all.
    members : bool
        Write curves of the arches of classes as well.

    Returns
    -------
    dict
        ``folder``; ``files``, each with its format; ``left_out``, by arch, why it has no curve;
        ``notes``, what to know before the files are used.

    Raises
    ------
    InputError
        If cube or fits are missing or out of date, a receiver has no name for the measure, or
        pyarrow is not installed where it is needed. Nothing is written then.
    FitError
        If a format that holds nothing but curves is asked for and no arch has one.
    OutputError
        If a file cannot be written.
    """
    require(study, "cube")
    require(study, "fit")
    requested = list(dict.fromkeys(formats))
    files: list[tuple[str, Path]] = []
    with open_cube(study) as cube:
        arches, classes = (load_answers(study.folder / FITS, of) for of in ("arches", "classes"))
        answers = quoted(cube, arches, classes, members)
        curves, notes = study_curves(study, cube, answers)
        texts = {name: written(curves, name) for name in requested if name in FORMATS}
        if "parquet" in requested:
            from_extra("pyarrow", "parquet")  # before anything is written
        folder = make_folder(folder or study.folder / FOLDER)
        for name, parts in texts.items():
            for ending, text in parts.items():
                files.append((name, folder / f"{study.id}-{ending}"))
                write_text(files[-1][1], text)
        for name in requested:
            if name not in FORMATS:
                paths = _write_tables(study, cube, curves, answers, folder, name)
                files += [(name, path) for path in paths]
    about = {name: named_measure(FORMATS[name][0], curves.measure).note for name in texts}
    notes += sorted(f"{name}: {note}" for name, note in about.items() if note)
    listed = [{"format": name, "file": str(path)} for name, path in files]
    return {
        "folder": str(folder), "files": listed, "left_out": curves.left_out, "notes": notes,
    }  # fmt: skip


def study_curves(
    study: Study, cube: xr.Dataset, answers: Mapping[str, Answer]
) -> tuple[CurveSet, list[str]]:
    """Curves of a finished study, and messages on limit states that were left out.

    A limit state short of collapse is exported where every arch with a curve of collapse has one
    of it too, whose curve does not cross that of a severer one: receivers take differences of
    states, and want the same states of all arches.
    """
    levels = cube["intensity"].values
    made = Made(
        study.id, study.title, archfrag.__version__, commit(),
        str(cube.attrs.get("archfrag_commit", "unknown")), sha256_of(study.folder / CUBE),
    )  # fmt: skip
    states, notes = _limit_states(answers)
    number = Counter(arch_classes(cube).values())
    classes = {name: number[name] for name in answers if number[name] > 1}
    if len(answers) < cube.sizes["arch"] + len(classes):
        notes += [
            f"class {name!r} has one curve for its {count} arches; --members adds one for each"
            for name, count in classes.items()
        ]
    curves = CurveSet(
        {arch: states.get(arch, {}) | {"collapse": a.curve} for arch, a in answers.items()},
        study.intensity.measure,
        (float(np.nanmin(levels)), float(np.nanmax(levels))),
        made,
        classes,
    )
    return curves, notes


def _limit_states(
    answers: Mapping[str, Answer],
) -> tuple[dict[str, dict[str, Fragility | str]], list[str]]:
    """Curves of the limit states that all arches have, mildest first, and why not of others."""
    own = {
        arch: {
            state["name"].replace(" ", "_"): curve_of_dict(state["curve"])
            for state in answer.more.get("limit_states", {}).get("states", ())
        }
        for arch, answer in answers.items()
    }
    # Curves of the next severer state, by arch with a curve of collapse.
    after = {arch: a.curve for arch, a in answers.items() if isinstance(a.curve, Fragility)}
    kept: list[str] = []
    notes = []
    for name in reversed(list(dict.fromkeys(state for each in own.values() for state in each))):
        if name == "collapse":
            continue
        found = {arch: own[arch].get(name, "") for arch in after}
        curves = {arch: fit for arch, fit in found.items() if isinstance(fit, Fragility)}
        if len(curves) < len(after):
            notes.append(f"limit state {name!r} is left out: not every arch has a curve of it")
            continue
        worst = max(after, key=lambda arch: crossing(curves[arch], after[arch]), default="")
        if after and crossing(curves[worst], after[worst]) > MOST_CROSSING:
            notes.append(
                f"limit state {name!r} is left out: its curve lies below that of a severer state "
                f"by up to {crossing(curves[worst], after[worst]):.2g} (arch {worst!r}); more "
                "levels where it begins, or the design stripes, would distinguish them"
            )
            continue
        kept.insert(0, name)
        after = curves
    none = "there is no curve of this limit state"
    return {arch: {k: own[arch].get(k, none) for k in kept} for arch in answers}, notes


def crossing(mild: Fragility, severe: Fragility) -> float:
    """Largest probability by which the curve of the severer state lies above that of the milder.

    Between them lies no probability there: receivers would take a negative one.
    """
    ends = [fit.theta * np.exp(s * 4.0 * fit.beta) for fit in (mild, severe) for s in (-1, 1)]
    im = np.geomspace(min(ends), max(ends), 400)
    return float((severe.probability(im) - mild.probability(im)).max())


def _write_tables(
    study: Study, cube: xr.Dataset, curves: CurveSet, answers: Mapping[str, Answer],
    folder: Path, ending: str,
) -> list[Path]:  # fmt: skip
    """Tables as CSV, with a JSON file that describes their columns; or as Parquet."""
    about = {name: curves.described(name) for name in curves.classes}
    facts = {"made": asdict(curves.made), "classes": about, "left_out": curves.left_out}
    units = study.intensity.unit, str(cube["intensity"].attrs["units"])
    every = {
        **tables.curve_tables(curves, answers, *units, study.intensity.factor),
        "runs": tables.runs_table(cube),
        "records": tables.facts_table(cube, "record"), "arches": tables.facts_table(cube, "arch"),
    }  # fmt: skip
    paths = [folder / f"{study.id}-{name}.{ending}" for name in every]
    for table, path in zip(every.values(), paths):
        if ending == "csv":
            write_csv(path, table.pieces)
        else:
            tables.write_parquet(table, path, facts)
    if ending == "csv":
        paths.append(folder / f"{study.id}-tables.json")
        content = facts | {"tables": {name: table.columns for name, table in every.items()}}
        write_text(paths[-1], json.dumps(content, indent=1, ensure_ascii=False) + "\n")
    return paths
