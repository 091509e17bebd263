"""Export of a study: curves in the formats of other programs, and tables."""

import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import accumulate, starmap
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from archfrag.errors import FitError, InputError
from archfrag.export import CURVES, FORMATS, writers
from archfrag.export.rdls import metadata
from archfrag.export.writers import (
    Branches,
    Content,
    Curves,
    CurveSet,
    made_by,
    named_measure,
    write_files,
)
from archfrag.files import Named, check_targets, counted, sha256_of
from archfrag.fragility.curve import Curve, FloatArray
from archfrag.fragility.risk import HazardCurve, branches_of, collapse_rate, predictive
from archfrag.fragility.several import MOST_CROSSING, above, states_of
from archfrag.study.answer.compare import part_curves
from archfrag.study.answer.curves import Fitted, arch_classes, runs_of_cube
from archfrag.study.answer.fits import in_unit
from archfrag.study.answer.outside import BLANK
from archfrag.study.answer.rates import MOST_MEAN, SEED, vulnerability_table
from archfrag.study.answer.surface import Surface, surfaces_of
from archfrag.study.answer.tables import Pieces, about_column, facts_table, runs_table
from archfrag.study.file.members import SHOWN
from archfrag.study.file.schema import StudyKeys
from archfrag.study.provenance import CUBE, write_text
from archfrag.study.steps import finished

Names = Sequence[str]
StateCurves = dict[str, dict[str, Curve]]  # by arch and limit state
_POINTS = 211
# Limit states; their order in files follows from their curves, and collapse is the last.
LIMIT_STATES = ("motion", "impact", "residual", "rotation", "contact_lost", "collapse")
_ALSO = {"residual_displacement": "residual"}
_NONE = Curve(reason="none")
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
    formats: Names,
    folder: Path | None = None,
    members: bool = False,
    limit_states: Names = (),
    curve: str = "median",
    fitted: Fitted | None = None,
) -> Named:
    """Write curves and runs of a finished study in the formats of other programs.

    `formats` are of `archfrag.export.FORMATS`; `folder` is ``export`` in the study's folder if not
    given. With `members` the arches of classes have curves too. `limit_states` are written besides
    collapse, each by a name of `LIMIT_STATES`; if none is given, all that have curves. `curve` is
    one of `archfrag.export.CURVES`. `fitted` is given for a table of verdicts, instead of a
    finished study.

    Returns ``folder``; ``files``, each with its format; ``limit_states``, those that are written;
    ``left_out``, the reason for each arch without a curve; and ``notes`` on limit states and on
    the use of the files. Nothing is written after an InputError (a receiver has no name for the
    measure, or there is no such limit state) or a FitError (no arch, or a limit state asked for,
    has no curve).
    """
    if curve not in CURVES:
        raise InputError(f"curve is {curve!r}; it is one of {', '.join(CURVES)}")
    fitted = fitted or finished(study)
    answers = fitted.quoted(members)
    known = {name: each for name, each in answers.items() if each.fitted}
    with fitted.cube as cube:
        states, messages = _limit_states(study, cube, known, limit_states)
        branches = Branches()
        if curve == "median":
            messages += _uncertain(known)
        else:
            states, branches = _with_uncertainty(states, curve)
        if curve == "predictive" and {"nrml-continuous", "pelicun", "in-core"} & set(
            formats
        ):
            messages.append(_LOGNORMAL)
        levels = cube["intensity"].values
        number = Counter(arch_classes(cube).values())
        digest = cube.attrs.get("table_sha256") or sha256_of(study.folder / CUBE)
        made = made_by(study) | {
            "cube_archfrag_commit": str(cube.attrs.get("archfrag_commit", "unknown")),
            "cube_sha256": digest,
        }
        curves = CurveSet(
            states,
            {name: answers[name].reason for name in answers if name not in known},
            study.intensity.measure,
            (float(np.nanmin(levels)), float(np.nanmax(levels))),
            made,
            {name: number[name] for name in answers if number[name] > 1},
            tuple(messages),
            branches,
        )
        content = _texts(curves, formats, messages)
        if "csv" in formats:
            content += _tables(study, fitted, curves, answers)
        names = [f"{study.id}-{ending}" for _, ending, _ in content]
        content.append(("rdls", "rdls.json", metadata(study, cube, curves, names)))
        files = write_files(study, folder, content)
    return {
        "folder": str(folder or study.folder / "export"),
        "left_out": curves.left_out,
        "notes": messages,
        "limit_states": list(curves.limit_states),
        "files": files,
    }


def _texts(curves: CurveSet, formats: Names, messages: list[str]) -> list[Content]:
    """Return the content of each file that is no table, and add to `messages`.

    The messages say what a receiver's measure must be. FitError if there is no curve.
    """
    texts = list[Content]()
    for name in dict.fromkeys(formats):
        _, receiver, functions = FORMATS[name]
        if functions and not curves.curves:
            reasons = "; ".join(
                f"{arch}: {why}" for arch, why in curves.left_out.items()
            )
            raise FitError(f"there is no curve to export for {receiver}: {reasons}")
        if functions:
            condition = named_measure(receiver, curves.measure).condition
            messages += [f"{name}: {condition}"] * bool(condition)
        for ending, function in functions.items():
            made = getattr(writers, function)(curves)
            by_arch = {"": made} if isinstance(made, str) else made
            texts += [(name, ending.format(a), text) for a, text in by_arch.items()]
    if curves.branches:
        texts.append(("branches", "branches.csv", writers.branch_weights(curves)))
    return texts


def _limit_states(
    study: StudyKeys,
    cube: xr.Dataset,
    answers: Curves,
    requested: Names,
) -> tuple[StateCurves, list[str]]:
    """Return the curves of the limit states from mild to collapse, and notes on them.

    Receivers take differences of states and want the same states of all arches in one order: that
    of their medians, on average. So a state is left out if an arch with a curve of collapse has no
    curve of it. A curve that crosses a severer one is moved (`above`). Notes name these states and
    curves. FitError if a requested state would be left out.
    """
    chosen = _chosen(cube, requested)
    own = {a: dict.fromkeys(chosen, _NONE) | states_of(f) for a, f in answers.items()}
    severe = answers  # curves of the next severer state
    kept = ["collapse"]
    messages = list[str]()
    left = dict[tuple[str, str], list[str]]()

    def place(name: str) -> float:  # mean of ln theta; -inf where there is no curve
        medians = [own[a][name].theta for a in severe if own[a][name].fitted]
        return float(np.mean(np.log(medians))) if medians else -np.inf

    for name in sorted(chosen, key=place)[::-1]:
        curves = {a: own[a][name] for a in severe if own[a][name].fitted}
        lacking = [arch for arch in severe if arch not in curves]
        if lacking:
            why = _why_none(study, cube, lacking[0], name, own[lacking[0]][name])
            if curves:
                why += f"; {len(curves)} of {len(severe)} arches or classes have one"
            left.setdefault((lacking[0], why), []).append(name)
            if requested:
                raise FitError(_left_out(*left.popitem()))
            continue
        kept.insert(0, name)
        severe = {arch: above(fit, severe[arch]) for arch, fit in curves.items()}
        moved = [arch for arch in curves if severe[arch] is not curves[arch]]
        for arch in moved[:1]:
            old = curves[arch]
            new = severe[arch]
            messages.append(
                f"limit state {name!r}: {counted(len(moved), 'curve')} lay below that of a "
                f"severer state by more than {MOST_CROSSING:g} and took up its dispersion as "
                f"far as needed (such as {arch}: dispersion {old.beta:.3g} to "
                f"{new.beta:.3g}, median times {new.theta / old.theta:.3g})"
            )
        for arch, fit in severe.items():
            own[arch][name] = fit
    messages += starmap(_left_out, left.items())
    return {a: {name: each[name] for name in kept} for a, each in own.items()}, messages


def _chosen(cube: xr.Dataset, requested: Names) -> list[str]:
    """Return the limit states to write besides collapse; InputError if one is unknown."""
    names = [name.strip().casefold().replace(" ", "_") for name in requested]
    names = [_ALSO.get(name, name) for name in names]
    every = [*LIMIT_STATES]
    if "table_sha256" in cube.attrs:  # runs of another program
        damage = json.loads(cube["damage"].attrs["states"]) if "damage" in cube else ()
        every = [*(name.replace(" ", "_") for name in damage[1:-1]), "collapse"]
    for name in sorted(set(names) - set(every)):
        raise InputError(
            f"there is no limit state {name!r}; they are {', '.join(every)}"
        )
    return [name for name in every[:-1] if name in (names or every)]


def _why_none(
    study: StudyKeys, cube: xr.Dataset, arch: str, name: str, curve: Curve
) -> str:
    """Return the reason why an arch has no curve of a limit state, and what helps."""
    if curve is _NONE:
        return _not_fitted(cube, arch, name)
    if study.design.adaptive:
        return f"{curve.reason}; try design: {{kind: stripes}}"
    if name in ("residual", "rotation"):
        return f"{curve.reason}; try a larger limit_states.{name}"
    return curve.reason


def _left_out(of: tuple[str, str], names: Names) -> str:
    """Return a note on limit states that are left out, since an arch has no curve of them.

    `of` is this arch, and the reason.
    """
    arch, why = of
    return f"limit states left out: {', '.join(names)}, of which {arch} has no curve: {why}"


def _with_uncertainty(
    states: Mapping[str, Curves], kind: str
) -> tuple[StateCurves, Branches]:
    """Return the predictive curves, or the branches with arch and weight of each.

    `kind` is predictive or branches. The draws are those of the mean rate of collapse. All states
    of a branch are at the same node, and are moved where they cross.
    """
    found = StateCurves()
    branches = Branches()
    nodes: dict[str, Sequence[Curve]]
    for arch, each in states.items():
        if kind == "predictive":
            nodes = {arch: [predictive(f, f.draws(SEED)) for f in each.values()]}
        else:
            made = [branches_of(fit, fit.draws(SEED)) for fit in each.values()]
            together = enumerate(zip(*(curves for curves, _ in made)), start=1)
            nodes = {f"{arch}-b{n}": curves for n, curves in together}
            weights = made[-1][1].tolist()
            branches |= {name: (arch, w) for name, w in zip(nodes, weights)}
        for name, curves in nodes.items():
            severe_first = accumulate(
                reversed(curves), lambda one, mild: above(mild, one)
            )
            found[name] = dict(zip(each, reversed([*severe_first])))
    return found, branches


def _uncertain(answers: Curves) -> list[str]:
    """Return notes on curves whose mean rate of collapse is far above that of their medians."""
    messages = []
    for name, fit in answers.items():
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
    """Return the reason why an arch or a class has no fit of a limit state."""
    if name == "rotation":
        own = [arch in names for names in arch_classes(cube).items()]
        sliding = np.isnan(cube["static_limit"].values[own])
        if sliding.any():
            whose = f"of {sliding.sum()} of its {sliding.size} arches "
            return (
                f"the mechanism at onset {whose * (sliding.size > 1)}slides or does not have four "
                "hinges, so there is no rotation of unstable equilibrium to compare with"
            )
    return f"archfrag fits limit states to all of up to {SHOWN} arches, and to three of more"


def _tables(
    study: StudyKeys, fitted: Fitted, curves: CurveSet, answers: Curves
) -> Iterator[Content]:
    """Yield all tables for CSV, and a text in JSON on their columns."""
    cube = fitted.cube
    units = study.intensity.unit, str(cube["intensity"].attrs["units"])
    runs = cube.drop_vars([*BLANK]) if "table_sha256" in cube.attrs else cube
    tables = {
        **curve_tables(
            curves,
            answers,
            *units,
            study.intensity.factor,
            more_frames(study, fitted, answers),
        ),
        "runs": runs_table(runs),
        "records": facts_table(cube, "record"),
        "arches": facts_table(cube, "arch"),
    }
    yield from (("csv", f"{name}.csv", rows) for name, (_, rows) in tables.items())
    facts = {
        "made": curves.made,
        "classes": {name: curves.described(name) for name in curves.classes},
        "left_out": curves.left_out,
        "notes": curves.remarks,
        "tables": {name: columns for name, (columns, _) in tables.items()},
    }
    yield "csv", "tables.json", json.dumps(facts, indent=1, ensure_ascii=False) + "\n"


def write_vulnerability(
    path: Path, losses: Mapping[str, Any], study: StudyKeys
) -> None:
    """Write the mean loss of `losses_of` as CSV (.csv) or NRML (.xml).

    InputError if the path has another ending.
    """
    table = vulnerability_table(losses, study)
    if path.suffix not in (".csv", ".xml"):
        raise InputError(f"{path}: a table of mean loss is written as .csv or .xml")
    check_targets([path])
    text = table.to_csv(index=False, lineterminator="\n")
    if path.suffix == ".xml":
        text = writers.nrml_vulnerability(table, study)
    write_text(path, text)


def curve_tables(
    curves: CurveSet,
    answers: Curves,
    unit: str,
    si: str,
    factor: float,
    more: Mapping[str, pd.DataFrame],
) -> dict[str, Pieces]:
    """Return tables of the points and the parameters of all curves, and the tables `more`.

    An intensity in `unit` times `factor` is in the unit `si`. Bands are those of the fitted
    curves, even if a curve was moved.
    """
    levels = np.linspace(0.0, 1.05 * curves.levels[1], _POINTS)
    percent = f"{100 * next(iter(answers.values())).confidence:g} %"
    units = {"given": unit, "si": si}
    points = []
    parameters = []
    for arch, states in curves.curves.items():
        as_fitted = states_of(answers[arch]) if arch in answers else {}
        for state, fit in states.items():
            labels = {
                "arch": arch,
                "limit_state": state,
                "measure": curves.measure,
                "unit": unit,
            }
            found = as_fitted.get(state, fit)  # a branch has no band
            lower, upper = (
                np.interp(levels, found.im or [0.0], end or [np.nan])
                for end in (found.lower, found.upper)
            )
            of_levels = {
                "im": levels / factor,
                "intensity": levels,
                "lower": lower,
                "upper": upper,
                "probability": fit.probability(levels),
            }
            points.append(pd.DataFrame(labels | of_levels))
            parameters.append(labels | _parameters_of(fit, found, factor))
    tables = dict[str, Pieces]()
    frames = {
        "curves": points or [pd.DataFrame()],
        "parameters": [pd.DataFrame(parameters)],
    }
    frames |= {name: [frame] for name, frame in more.items()}
    for name, pieces in frames.items():
        about = {
            column: about_column(text.format(percent=percent), units.get(of, of))
            for table, column, of, text in _COLUMNS.itertuples(index=False)
            if table in ("", name)
        }
        tables[name] = about, [each.reindex(columns=list(about)) for each in pieces]
    return tables


def _parameters_of(fit: Curve, fitted: Curve, factor: float) -> Named:
    """Return the row of a curve in the table of parameters, without its names.

    `fitted` is the curve before it was moved; `factor` is as for `curve_tables`.
    """
    likelihood = fitted.likelihood or Curve()
    theta_lower, theta_upper = np.divide(fitted.theta_interval, factor)
    beta_lower, beta_upper = fitted.beta_interval
    error_theta, error_beta = fit.standard_errors
    return {
        "theta": fit.theta / factor,
        "theta_si": fit.theta,
        "beta": fit.beta,
        "theta_lower": theta_lower,
        "theta_upper": theta_upper,
        "beta_lower": beta_lower,
        "beta_upper": beta_upper,
        "theta_maximum_likelihood": likelihood.theta / factor,
        "beta_maximum_likelihood": likelihood.beta,
        "standard_error_ln_theta": error_theta,
        "standard_error_beta": error_beta,
        "correlation_ln_theta_beta": fit.correlation,
        "runs": fit.n_total,
        "kind": fit.kind,
        "band": fitted.method,
    }


def more_frames(
    study: StudyKeys, fitted: Fitted, answers: Curves
) -> dict[str, pd.DataFrame]:
    """Return the tables of parts of bridges and of surfaces that a study has."""
    given = study.intensity
    im = np.linspace(0.0, 1.05 * max(given.given), _POINTS)
    parts = [
        part_curves(own, in_unit(answers[name], given), im).assign(arch=name)
        for name, own in runs_of_cube(fitted.cube, answers).items()
    ]
    surfaces = [
        _surface_frame(each, im).assign(arch=name)
        for name, each in surfaces_of(study, fitted).items()
    ]
    same = {"limit_state": "collapse", "measure": given.measure, "unit": given.unit}
    return {
        key: pd.concat([each for each in tables if len(each)]).assign(
            intensity=lambda rows: rows["im"] * given.factor, **same
        )
        for key, tables in {"parts": parts, "surface": surfaces}.items()
        if any(map(len, tables))
    }


def _surface_frame(surface: Surface, im: FloatArray) -> pd.DataFrame:
    """Return the table of a surface, with its border in the direction of each movement."""
    rows = surface.to_dataframe(im)
    rows.columns = pd.Index(["moved", "im", "probability", "lower", "upper"])
    ends = np.where(rows["moved"] < 0.0, surface.border[0], surface.border[-1])
    return rows.assign(falls_at=ends, movement=surface.movement)
