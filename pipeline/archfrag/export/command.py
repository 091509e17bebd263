"""Export of a study: curves in the formats of other programs, and tables."""

import itertools
import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from archfrag.errors import FitError, InputError, from_extra
from archfrag.export import CURVES, FORMATS, writers
from archfrag.export.writers import CurveSet, named_measure
from archfrag.files import (
    check_targets,
    counted,
    make_folder,
    replacing,
    sha256_of,
    write_csv,
)
from archfrag.fragility.curve import Curve
from archfrag.fragility.risk import (
    HazardCurve,
    branches_of,
    collapse_rate,
    predictive,
)
from archfrag.fragility.several import MOST_CROSSING, above
from archfrag.study.answer.curves import Fitted, arch_classes
from archfrag.study.answer.outside import BLANK
from archfrag.study.answer.rates import MOST_MEAN, SEED, vulnerability_table
from archfrag.study.answer.tables import (
    Columns,
    Pieces,
    about_column,
    facts_table,
    runs_table,
)
from archfrag.study.file.members import SHOWN
from archfrag.study.file.schema import StudyKeys
from archfrag.study.provenance import CUBE, commit, write_text
from archfrag.study.steps import finished
from archfrag.version import __version__

_POINTS = 211
TABLES = ("curves", "parameters", "runs", "records", "arches")  # of all runs
# Limit states; their order in files follows from their curves, and collapse is the last.
LIMIT_STATES = ("motion", "impact", "residual", "rotation", "contact_lost", "collapse")
_LOGNORMAL = (
    "the predictive curve is no lognormal one: nrml-discrete and the table of curves hold it; "
    "nrml-continuous, pelicun and in-core the one with its mean and deviation of ln capacity, "
    "whose rate of collapse is not the mean rate"
)
_FALL = 2.5  # exponent of a usual hazard curve
# Columns of the tables of curves; the unit of an intensity is "given" or "si", and {percent} in a
# text is the confidence.
_COLUMNS = pd.read_csv(Path(__file__).with_name("columns.csv"), keep_default_na=False)


def export_study(
    study: StudyKeys,
    formats: Sequence[str],
    folder: Path | None = None,
    members: bool = False,
    limit_states: Sequence[str] = (),
    curve: str = "median",
    fitted: Fitted | None = None,
) -> dict[str, Any]:
    """Write curves and runs of a study whose results are up to date, or of a table if `fitted`.

    `formats` are of `archfrag.export.FORMATS`; `folder` is ``export`` in the study's folder if not
    given. With `members` the arches of classes have curves too. `limit_states` are written besides
    collapse, each by a name of `LIMIT_STATES`; if none is given, all that have curves. `curve` is
    one of `archfrag.export.CURVES`.

    Returned are ``folder``; ``files``, each with its format; ``limit_states`` written;
    ``left_out``, by arch, why it has no curve; ``notes`` on limit states and on the use of the
    files. Nothing is written after an InputError (a receiver has no name for the measure, there
    is no such limit state, pyarrow is not installed) or a FitError (no arch, or a limit state
    asked for, has no curve).
    """
    if curve not in CURVES:
        raise InputError(f"curve is {curve!r}; it is one of {', '.join(CURVES)}")
    fitted = fitted or finished(study)
    answers = fitted.quoted(members)
    with fitted.cube as cube:
        levels = cube["intensity"].values
        number = Counter(arch_classes(cube).values())
        made = {
            "study": study.id,
            "title": study.title,
            "archfrag": __version__,
            "archfrag_commit": commit(),
            "cube_archfrag_commit": str(cube.attrs.get("archfrag_commit", "unknown")),
            "cube_sha256": cube.attrs.get("table_sha256")
            or sha256_of(study.folder / CUBE),
        }
        ends = float(np.nanmin(levels)), float(np.nanmax(levels))
        classes = {name: number[name] for name in answers if number[name] > 1}
        states, messages = _limit_states(study, cube, answers, limit_states)
        states, branches = _with_uncertainty(states, curve)
        if curve == "median":
            messages += _uncertain(answers)
        if curve == "predictive" and {"nrml-continuous", "pelicun", "in-core"} & set(
            formats
        ):
            messages.append(_LOGNORMAL)
        curves = CurveSet(
            states,
            study.intensity.measure,
            ends,
            made,
            classes,
            tuple(messages),
            branches,
        )
        texts = _texts(curves, formats, messages)
        if "parquet" in formats:
            from_extra("pyarrow", "parquet")  # before anything is written
        folder = folder or study.folder / "export"
        files = [(name, folder / f"{study.id}-{ending}") for name, ending, _ in texts]
        tabled = [
            f"{name}.{end}" for name in TABLES for end in formats if not FORMATS[end][1]
        ]
        tabled += ["tables.json"] * ("csv" in formats)
        tables = [folder / f"{study.id}-{end}" for end in tabled]
        check_targets([*(path for _, path in files), *tables])
        make_folder(folder)
        for (_, path), (_, _, text) in zip(files, texts):
            write_text(path, text)
        for name in dict.fromkeys(name for name in formats if not FORMATS[name][1]):
            paths = _write_tables(study, cube, curves, answers, folder, name)
            files += [(name, path) for path in paths]
    return {
        "folder": str(folder),
        "left_out": curves.left_out,
        "notes": messages,
        "limit_states": list(curves.limit_states if curves.complete else ()),
        "files": [{"format": name, "file": str(path)} for name, path in files],
    }


def _texts(
    curves: CurveSet, formats: Sequence[str], messages: list[str]
) -> list[tuple[str, str, str]]:
    """Return format, end of the name and text of each file that is no table; add messages."""
    texts = []
    for name in dict.fromkeys(formats):
        _, receiver, functions = FORMATS[name]
        if functions and not curves.complete:
            reasons = "; ".join(
                f"{arch}: {why}" for arch, why in curves.left_out.items()
            )
            raise FitError(f"there is no curve to export for {receiver}: {reasons}")
        if functions and (message := named_measure(receiver, curves.measure).condition):
            messages.append(f"{name}: {message}")
        for ending, function in functions.items():
            text = getattr(writers, function)(curves)
            each = (
                {"": text} if isinstance(text, str) else text
            )  # one file, or one an arch
            texts += [(name, ending.format(arch), text) for arch, text in each.items()]
    if curves.branches:
        texts.append(("branches", "branches.csv", writers.branch_weights(curves)))
    return texts


def _limit_states(
    study: StudyKeys,
    cube: xr.Dataset,
    answers: Mapping[str, Curve],
    requested: Sequence[str],
) -> tuple[dict[str, dict[str, Curve]], list[str]]:
    """Return the curves of the limit states from mild to collapse, and notes on them.

    Receivers take differences of states and want the same states of all arches in one order: that
    of their medians, on average. So a state is left out if an arch with a curve of collapse has
    none of it, and a curve that crosses a severer one is moved (`above`). A note names each.
    """
    requested = [name.strip().casefold().replace(" ", "_") for name in requested]
    requested = [
        "residual" if name == "residual_displacement" else name for name in requested
    ]
    every: Sequence[str] = LIMIT_STATES
    if "table_sha256" in cube.attrs:  # runs of another program
        names = (
            json.loads(cube["damage"].attrs["states"])[1:-1] if "damage" in cube else ()
        )
        every = [*(name.replace(" ", "_") for name in names), "collapse"]
    for name in sorted(set(requested) - set(every)):
        raise InputError(
            f"there is no limit state {name!r}; they are {', '.join(every)}"
        )
    own = dict[str, dict[str, Curve]]()
    for arch, answer in answers.items():
        own[arch] = {each.state.replace(" ", "_"): each for each in answer.states}
        own[arch]["collapse"] = answer
    # Curves of the next severer state, by arch with a curve of collapse.
    severe = {arch: curve for arch, curve in answers.items() if curve.fitted}
    kept = ["collapse"]
    messages = list[str]()
    left = dict[tuple[str, str], list[str]]()
    place = dict[str, float]()  # mean of ln theta; -inf where there is no curve
    for name in every[:-1]:
        fits = [own[a][name] for a in severe if name in own[a] and own[a][name].fitted]
        place[name] = (
            float(np.mean([np.log(fit.theta) for fit in fits])) if fits else -np.inf
        )
    ordered = [*sorted(place, key=lambda name: place[name]), "collapse"]
    for name in (name for name in reversed(ordered) if name in (requested or every)):
        found = {arch: own[arch].get(name) for arch in severe}
        curves = {
            arch: fit for arch, fit in found.items() if fit is not None and fit.fitted
        }
        if lacking := [arch for arch in found if arch not in curves]:
            without = found[lacking[0]]
            why = without.reason if without else _not_fitted(cube, lacking[0], name)
            remedy = (
                f"a larger limit_states.{name}"
                if name in ("residual", "rotation")
                else ""
            )
            remedy = "design: {kind: stripes}" if study.design.adaptive else remedy
            help_ = f"; try {remedy}" * bool(remedy and without)
            others = (
                f"; {len(curves)} of {len(found)} arches or classes have one"
                * bool(curves)
            )
            left.setdefault((lacking[0], f"{why}{help_}{others}"), []).append(name)
            if requested:
                raise FitError(_left_out(*left.popitem()))
        elif name != "collapse":
            kept.insert(0, name)
            severe = {arch: above(fit, severe[arch]) for arch, fit in curves.items()}
            if moved := [arch for arch in curves if severe[arch] is not curves[arch]]:
                old = curves[moved[0]]
                new = severe[moved[0]]
                messages.append(
                    f"limit state {name!r}: {counted(len(moved), 'curve')} lay below that of a "
                    f"severer state by more than {MOST_CROSSING:g} and took up its dispersion as "
                    f"far as needed (such as {moved[0]}: dispersion {old.beta:.3g} to "
                    f"{new.beta:.3g}, median times {new.theta / old.theta:.3g})"
                )
            for arch, fit in severe.items():
                own[arch][name] = fit
    messages += itertools.starmap(_left_out, left.items())
    none = Curve(reason="none")
    return {
        arch: {k: each.get(k, none) for k in kept} for arch, each in own.items()
    }, messages


def _left_out(of: tuple[str, str], names: Sequence[str]) -> str:
    """Say why an arch has no curve of some limit states."""
    (arch, why), listed = of, ", ".join(map(repr, names))
    if len(names) > 1:
        return f"limit states {listed} are left out: {arch} has no curve of them: {why}"
    return f"limit state {listed} is left out: {arch} has no curve of it: {why}"


def _with_uncertainty(
    states: Mapping[str, Mapping[str, Curve]], kind: str
) -> tuple[dict[str, dict[str, Curve]], dict[str, tuple[str, float]]]:
    """Return the curves of a kind of `CURVES`, and of each branch its arch and its weight.

    The draws are those of the mean rate of collapse. All states of a branch are at the same node,
    and are moved where they cross.
    """
    found = dict[str, dict[str, Curve]]()
    branches = dict[str, tuple[str, float]]()
    for arch, each in states.items():
        if kind == "median" or not each["collapse"].fitted:
            found[arch] = dict(each)
            continue
        if kind == "predictive":
            nodes = [[predictive(f, f.draws(SEED))] for f in each.values()]
            names = [arch]
        else:
            pairs = [branches_of(fit, fit.draws(SEED)) for fit in each.values()]
            nodes = [curves for curves, _ in pairs]
            weights = pairs[-1][1].tolist()
            names = [f"{arch}-b{n + 1}" for n in range(len(weights))]
            branches |= {name: (arch, weight) for name, weight in zip(names, weights)}
        for name, *curves in zip(names, *nodes):
            for n in reversed(range(len(curves) - 1)):  # collapse is the last
                curves[n] = above(curves[n], curves[n + 1])
            found[name] = dict(zip(each, curves))
    return found, branches


def _uncertain(answers: Mapping[str, Curve]) -> list[str]:
    """Return notes on curves whose mean rate of collapse is far above that of their medians."""
    messages = []
    for name, fit in answers.items():
        if not fit.fitted:
            continue
        im = fit.theta * np.array([0.02, 20.0])
        rate = collapse_rate(HazardCurve(im, im**-_FALL), fit, fit.draws(SEED))
        # A rate from outside so wide a hazard curve is of a curve that is hardly known.
        if not rate.mean <= MOST_MEAN * rate.rate:
            messages.append(
                f"{name}: the mean rate of collapse over uncertain theta and beta is more than "
                f"{MOST_MEAN:g} times that of this median curve, for a hazard that falls with the "
                f"power {_FALL:g} of the intensity; curves of the kind predictive or branches "
                "hold that mean, and more runs make it smaller"
            )
    return messages


def _not_fitted(cube: xr.Dataset, arch: str, name: str) -> str:
    """Say why an arch or a class has no fit of a limit state."""
    own = [arch in names for names in arch_classes(cube).items()]
    sliding = (
        np.isnan(cube["static_limit"].values[own])
        if name == "rotation"
        else np.zeros(0)
    )
    if not sliding.any():
        return f"archfrag fits limit states to all of up to {SHOWN} arches, and to three of more"
    whose = f"of {sliding.sum()} of its {sliding.size} arches " * (sliding.size > 1)
    why = "so there is no rotation of unstable equilibrium to compare with"
    return f"the mechanism at onset {whose}slides or does not have four hinges, {why}"


def _write_tables(
    study: StudyKeys,
    cube: xr.Dataset,
    curves: CurveSet,
    answers: Mapping[str, Curve],
    folder: Path,
    ending: str,
) -> list[Path]:
    """Write all tables as CSV with a JSON file on columns, or as Parquet; return the files."""
    about = {name: curves.described(name) for name in curves.classes}
    facts = {
        "made": curves.made,
        "classes": about,
        "left_out": curves.left_out,
        "notes": curves.remarks,
    }
    units = study.intensity.unit, str(cube["intensity"].attrs["units"])
    every = {
        **curve_tables(curves, answers, *units, study.intensity.factor),
        "runs": runs_table(
            cube.drop_vars([*BLANK]) if "table_sha256" in cube.attrs else cube
        ),
        "records": facts_table(cube, "record"),
        "arches": facts_table(cube, "arch"),
    }
    paths = [folder / f"{study.id}-{name}.{ending}" for name in TABLES]
    for name, path in zip(TABLES, paths):
        columns, pieces = every[name]
        if ending == "csv":
            write_csv(path, pieces)
        else:
            write_parquet(path, pieces, facts | {"columns": columns})
    if ending == "csv":
        paths.append(folder / f"{study.id}-tables.json")
        content = facts | {
            "tables": {name: columns for name, (columns, _) in every.items()}
        }
        write_text(paths[-1], json.dumps(content, indent=1, ensure_ascii=False) + "\n")
    return paths


def write_parquet(
    path: Path, pieces: Iterable[pd.DataFrame], facts: dict[str, Any]
) -> None:
    """Write a table as Parquet, a row group for each piece; completely or not at all."""
    arrow, parquet = (
        from_extra(name, "parquet") for name in ("pyarrow", "pyarrow.parquet")
    )
    tables = (arrow.Table.from_pandas(each, preserve_index=False) for each in pieces)
    first = next(tables)
    about = json.dumps(facts, ensure_ascii=False)
    schema = first.schema.with_metadata({"archfrag": about})
    with (
        replacing(path) as temporary,
        parquet.ParquetWriter(temporary, schema) as writer,
    ):
        for table in itertools.chain([first], tables):
            writer.write_table(table.cast(schema))


def write_vulnerability(
    path: Path, losses: Mapping[str, Any], study: StudyKeys
) -> None:
    """Write the mean loss of `losses_of` as CSV or NRML, by the ending of the path."""
    table = vulnerability_table(losses, study)
    if path.suffix not in (".csv", ".xml"):
        raise InputError(f"{path}: a table of mean loss is written as .csv or .xml")
    check_targets([path])
    text = table.to_csv(index=False, lineterminator="\n")
    if path.suffix == ".xml":
        text = writers.nrml_vulnerability(table, study)
    write_text(path, text)


def curve_tables(
    curves: CurveSet, answers: Mapping[str, Curve], unit: str, si: str, factor: float
) -> dict[str, Pieces]:
    """Return tables of the points and the parameters of all curves.

    An intensity in `unit` times `factor` is in `si`. Bands are those of the fitted curves, also
    where a curve was moved.
    """
    levels = np.linspace(0.0, 1.05 * curves.levels[1], _POINTS)
    confidence = next(iter(answers.values())).confidence
    units = {"given": unit, "si": si}
    points = []
    parameters = []
    for arch, states in curves.curves.items():
        for state, fit in states.items():
            if not fit.fitted:
                continue
            labels = {
                "arch": arch,
                "limit_state": state,
                "measure": curves.measure,
                "unit": unit,
            }
            found = answers.get(arch, fit)  # a branch has no band
            if state != "collapse" and found is not fit:
                found = next(
                    s for s in found.states if s.state == state.replace("_", " ")
                )
            ends = (found.lower, found.upper)
            lower, upper = (
                np.interp(levels, found.im or [0.0], end or [np.nan]) for end in ends
            )
            points.append(
                pd.DataFrame(
                    labels
                    | {
                        "im": levels / factor,
                        "intensity": levels,
                        "lower": lower,
                        "upper": upper,
                        "probability": fit.probability(levels),
                    }
                )
            )
            likelihood = found.likelihood
            parameters.append(
                labels
                | {
                    "theta": fit.theta / factor,
                    "theta_si": fit.theta,
                    "beta": fit.beta,
                    "theta_lower": found.theta_interval[0] / factor,
                    "theta_upper": found.theta_interval[1] / factor,
                    "beta_lower": found.beta_interval[0],
                    "beta_upper": found.beta_interval[1],
                    "theta_maximum_likelihood": getattr(likelihood, "theta", np.nan)
                    / factor,
                    "beta_maximum_likelihood": getattr(likelihood, "beta", np.nan),
                    "standard_error_ln_theta": fit.standard_errors[0],
                    "standard_error_beta": fit.standard_errors[1],
                    "correlation_ln_theta_beta": fit.correlation,
                    "runs": fit.n_total,
                    "kind": fit.kind,
                    "band": found.method,
                }
            )
    tables: dict[str, Pieces] = {}
    for name, frames in (
        ("curves", points),
        ("parameters", [pd.DataFrame(parameters)]),
    ):
        about = Columns()
        for row in _COLUMNS[_COLUMNS["table"].isin(["", name])].to_dict("records"):
            text = row["about"].format(percent=f"{100 * confidence:g} %")
            about[row["name"]] = about_column(text, units.get(row["unit"], row["unit"]))
        pieces = [
            frame.reindex(columns=list(about)) for frame in frames or [pd.DataFrame()]
        ]
        tables[name] = about, pieces
    return tables
