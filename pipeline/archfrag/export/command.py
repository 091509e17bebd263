"""Export a study: its curves and runs, in the formats asked for."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import archfrag
from archfrag.errors import FitError, from_extra
from archfrag.export import tables
from archfrag.export.formats import FORMATS, CurveSet, named_measure
from archfrag.files import make_folder, sha256_of, write_csv
from archfrag.fragility.curve import Fragility
from archfrag.fragility.quoted import Answer, curve_of_dict
from archfrag.study.answer.curves import arch_classes, quoted
from archfrag.study.file.schema import Study
from archfrag.study.files import CUBE, commit, write_text
from archfrag.study.steps import finished

MOST_CROSSING = 0.01  # probability by which curves of two limit states may cross


def export_study(
    study: Study, formats: Sequence[str], folder: Path | None = None, members: bool = False
) -> dict[str, Any]:
    """Write curves and runs of a study whose results are up to date.

    `formats` are of nrml-continuous, nrml-discrete, pelicun, in-core, csv and parquet; `folder` is
    ``export`` in the study's folder if not given. With `members` the curves of the arches of
    classes are written too.

    Returned are ``folder``; ``files``, each with its format; ``left_out``, by arch, why it has no
    curve; ``notes`` on the use of the files. Nothing is written after an InputError (a receiver
    has no name for the measure, pyarrow is not installed) or a FitError (no arch has a curve).
    """
    of_arches, of_classes, cube = finished(study)
    answers = quoted(cube, of_arches, of_classes, members)
    with cube:
        levels, number = cube["intensity"].values, Counter(arch_classes(cube).values())
        made = {
            "study": study.id, "title": study.title,
            "archfrag": archfrag.__version__, "archfrag_commit": commit(),
            "cube_archfrag_commit": str(cube.attrs.get("archfrag_commit", "unknown")),
            "cube_sha256": sha256_of(study.folder / CUBE),
        }  # fmt: skip
        ends = float(np.nanmin(levels)), float(np.nanmax(levels))
        classes = {name: number[name] for name in answers if number[name] > 1}
        states, messages = _limit_states(answers)
        curves = CurveSet(states, study.intensity.measure, ends, made, classes)
        texts, files = list[tuple[str, str, str]](), list[tuple[str, Path]]()
        for name in dict.fromkeys(formats):
            receiver, writers = FORMATS.get(name, ("", {}))
            if writers and not curves.complete:
                reasons = "; ".join(f"{arch}: {why}" for arch, why in curves.left_out.items())
                raise FitError(f"there is no curve to export for {receiver}: {reasons}")
            if writers and (message := named_measure(receiver, curves.measure).condition):
                messages.append(f"{name}: {message}")
            for ending, write in writers.items():
                made_of = write(curves)
                parts = {"": made_of} if isinstance(made_of, str) else made_of
                texts += [(name, ending.format(arch=a), text) for a, text in parts.items()]
        if "parquet" in formats:
            from_extra("pyarrow", "parquet")  # before anything is written
        folder = make_folder(folder or study.folder / "export")
        for name, ending, text in texts:
            files.append((name, folder / f"{study.id}-{ending}"))
            write_text(files[-1][1], text)
        for name in dict.fromkeys(formats):
            if name not in FORMATS:
                paths = _write_tables(study, cube, curves, answers, folder, name)
                files += [(name, path) for path in paths]
    return {
        "folder": str(folder), "left_out": curves.left_out, "notes": messages,
        "files": [{"format": name, "file": str(path)} for name, path in files],
    }  # fmt: skip


def _limit_states(
    answers: Mapping[str, Answer],
) -> tuple[dict[str, dict[str, Fragility | str]], list[str]]:
    """Curves of the limit states, mildest first and collapse last, and why not of others.

    Kept are those of which every arch with a curve of collapse has one that does not cross that of
    a severer state: receivers take differences of states, and want the same ones of all arches.
    """
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
    messages = []
    names = dict.fromkeys(state for each in own.values() for state in each if state != "collapse")
    for name in reversed(names):
        found = {arch: own[arch].get(name) for arch in after}
        curves = {arch: fit for arch, fit in found.items() if isinstance(fit, Fragility)}
        above = {arch: crossing(fit, after[arch]) for arch, fit in curves.items()}
        worst = max(above, key=above.__getitem__, default="")
        if len(curves) < len(after):
            why = "not every arch has a curve of it"
        elif above and above[worst] > MOST_CROSSING:
            why = (
                f"its curve lies below that of a severer state by up to {above[worst]:.2g} (arch "
                f"{worst!r}); more levels where it begins, or every record at every level, would "
                "distinguish them"
            )
        else:
            kept.insert(0, name)
            after = curves
            continue
        messages.append(f"limit state {name!r} is left out: {why}")
    none = "there is no curve of this limit state"
    return {
        arch: {k: own[arch].get(k, none) for k in kept} | {"collapse": answer.curve}
        for arch, answer in answers.items()
    }, messages


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
    facts = {"made": curves.made, "classes": about, "left_out": curves.left_out}
    units = study.intensity.unit, str(cube["intensity"].attrs["units"])
    every = {
        **tables.curve_tables(curves, answers, *units, study.intensity.factor),
        "runs": tables.runs_table(cube),
        "records": tables.facts_table(cube, "record"), "arches": tables.facts_table(cube, "arch"),
    }  # fmt: skip
    paths = [folder / f"{study.id}-{name}.{ending}" for name in every]
    for (columns, pieces), path in zip(every.values(), paths):
        if ending == "csv":
            write_csv(path, pieces)
        else:
            tables.write_parquet(path, pieces, facts | {"columns": columns})
    if ending == "csv":
        paths.append(folder / f"{study.id}-tables.json")
        content = facts | {"tables": {name: columns for name, (columns, _) in every.items()}}
        write_text(paths[-1], json.dumps(content, indent=1, ensure_ascii=False) + "\n")
    return paths
