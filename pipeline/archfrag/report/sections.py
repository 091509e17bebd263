"""What the page shows of each arch and of each class."""

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from markupsafe import Markup
from numpy.typing import NDArray

from archfrag.fragility.counts import Verdict, clopper_pearson
from archfrag.fragility.curve import Fragility
from archfrag.report import arch as arch_figures
from archfrag.report import curves, example, runs
from archfrag.report import results as words
from archfrag.report.drawing import Picture
from archfrag.report.inputs import ReportInputs
from archfrag.report.results import ArchResults, Scale, digits, measured, pairs, table
from archfrag.simulation.response import MODEL_WORDS
from archfrag.study.answer.curves import Answer, arch_classes
from archfrag.study.answer.fits import lost_text

_ENTRIES = 60  # of the log, in words
_UNITS = {
    **dict.fromkeys(("radius", "thickness", "span", "rise", "width", "height"), " [m]"),
    **dict.fromkeys(("depth", "intrados", "extrados"), " [m]"),
    "embrace": " [deg]", "density": " [kg/m³]", "dead_load": " [N]",
}  # fmt: skip


def arch_section(
    inputs: ReportInputs, results: ArchResults, place: int, animated: bool
) -> dict[str, Any]:
    """Data, figures and tables of an arch, by the names that the page's template uses."""
    name, arch, onset = inputs.arches[place]
    answer, scale, grouped = inputs.answers[name], results.scale, results.own_levels
    groups = runs.groupings(results, inputs.confidence)
    percent = f"{100 * inputs.confidence:.0f} %"
    note = json.loads(inputs.cube.attrs["archfrag_design"]).get("arches", {}).get(name)
    return {
        "id": f"arch{place}",
        "name": name,
        "answer": answer,
        "counts": results.counts,
        "onset": onset,
        "cautions": cautions_of(inputs.cautions, name),
        "curve": curves.curve(results, answer),
        "design": note and pairs(
            f"Design of the runs of {name}", _design(note, results), "design"
        ),
        "levels": _levels(results, answer, percent),
        "cloud": _cloud(answer, name, scale),
        "limit_states": curves.limit_states(answer, name, scale, float(results.levels.max())),
        "states": states_table(answer, name, scale),
        "lost": lost_text(answer, scale.text),
        "measures": runs.measures(answer, name),
        "measured": _measured(answer, name),
        "verdicts": (runs.verdict_map if grouped is None else runs.single_runs)(results),
        "arch": arch_figures.arch_at_onset(arch, onset, name),
        "geometry": _geometry(arch.parameters, name),
        "fractions": runs.fractions(groups, results),
        "mechanisms": _mechanisms(groups, results, percent),
        "n_effective": f"{groups[0].n_effective:.1f}",
        "grouped": grouped is not None,
        **_repeated(inputs, results, place, animated),
        "ran": pairs(f"Models and events of {name}", _ran(results)),
        "speed": pairs(f"Speed and energy figures of {name}", _speed(inputs, results)),
        "after_loss": stood_after_loss(results),
    }  # fmt: skip


def cautions_of(cautions: Sequence[str], name: str) -> list[str]:
    """Cautions that concern one arch, without its name."""
    start = f"{name}: "
    return [caution.removeprefix(start) for caution in cautions if caution.startswith(start)]


def stood_after_loss(results: ArchResults) -> int:
    """Number of runs that lost all contact at a joint and stand."""
    lost = np.isfinite(results["lost_contact_time"])
    return int(((results.verdict == Verdict.STANDING) & lost).sum())


Rows = Iterator[tuple[str, object]]


def _design(note: Mapping[str, Any], results: ArchResults) -> Rows:
    yield f"design {results.design}", results.design_text
    yield "runs", note["runs"]
    if "records" in note:
        yield "records", f"{note['records']} of {len(results.records)}"
    if note.get("checked"):
        checks = f"{note['contradictions']} of {note['checked']}"
        yield "checks near the border against the capacity of their record", checks
    if isinstance(note.get("half_width"), float | int) and note["half_width"] < 1e300:
        label = "half width of the median's interval, by the design's own estimate"
        yield label, f"{100 * note['half_width']:.2g} %"
        yield "as narrow as wanted", "yes" if note.get("reached") else f"no: {note.get('why', '')}"


def _levels(results: ArchResults, answer: Answer, percent: str) -> Markup:
    counts, known, fit = results.counts, results.known, answer.curve
    ends = clopper_pearson(known.collapsed, known.n, answer.confidence)
    rows = []
    for i, level in enumerate(results.levels):
        fraction = ["–", "–"]
        if known.n[i]:
            interval = f"{ends[0][i]:.3f} – {ends[1][i]:.3f}"
            fraction = [f"{known.collapsed[i] / known.n[i]:.3f}", interval]
        fitted = "–"
        if isinstance(fit, Fragility):
            fitted = f"{fit.probability(level / results.scale.factor):.3f}"
        rows.append([
            digits(level), counts.runs[i], counts.collapsed[i], counts.standing[i],
            counts.unfinished[i], counts.solver_failures[i], *fraction, fitted,
        ])  # fmt: skip
    heads = [
        results.scale.label, "runs", "collapsed", "standing", "unfinished", "solver failures",
        "records with capacity below" if results.bisected else "fraction",
        f"Clopper–Pearson {percent}", "curve",
    ]  # fmt: skip
    return table(f"Verdicts and probabilities of {results.arch} by level", heads, rows, "", 0)


def _cloud(answer: Answer, name: str, scale: Scale) -> Markup | None:
    found = answer.more.get("cloud")
    if not found or "none" in found:
        return None
    rows = []
    for kind, each in found.items():
        if "none" in each:
            rows.append((kind, each["none"], "–"))
            continue
        theta, *ends = map(scale.digits, (each["theta"], *each["theta_interval"]))
        beta = "{:.2f} ({:.2f}–{:.2f})".format(each["beta"], *each["beta_interval"])
        rows.append((kind, f"{theta} ({'–'.join(ends)})", beta))
    heads = ["regression", f"θ [{scale.unit}]", "β"]
    return table(f"Cloud regressions of {name}", heads, rows, "compact")


def states_table(answer: Answer, name: str, scale: Scale) -> Markup | None:
    """Limit states with median and dispersion, or why they have none."""
    rows = []
    for state in answer.more.get("limit_states", {}).get("states", ()):
        own, curve = state["name"].replace("_", " "), state["curve"]
        if "none" in curve:
            rows.append((own, f"{state['meaning']} (no curve: {curve['none']})", "–", "–"))
        else:
            numbers = scale.digits(curve["theta"]), f"{curve['beta']:.3f}"
            rows.append((own, state["meaning"], *numbers))
    heads = ["limit state", "meaning", f"θ [{scale.unit}]", "β"]
    return table(f"Limit states of {name}", heads, rows, "compact", 2) if rows else None


def _measured(answer: Answer, name: str) -> Markup:
    rows = [
        [row["measure"], *(
            row[key] if key == "unit" else measured(row[key])
            for key in ("theta", "unit", "beta", "efficiency", "p_magnitude", "p_distance")
        )]
        for row in curves.efficient_first(answer)
    ]  # fmt: skip
    heads = ["measure", "θ", "unit", "β", "efficiency", "p of magnitude", "p of distance"]
    return table(f"Intensity measures for {name}", heads, rows, "dense narrow")


def _geometry(parameters: Mapping[str, Any], name: str) -> Markup:
    rows = [
        (f"{key.replace('_', ' ')}{_UNITS.get(key, '')}", words.short(value))
        for key, value in parameters.items()
        if value is not None
    ]
    if parameters.get("dead_load", 0) is None:
        rows.append(("dead load", "none: the ring alone, without fill and spandrels"))
    return pairs(f"Geometry of {name}", rows, "parameter")


def _mechanisms(groups: Sequence[Any], results: ArchResults, percent: str) -> Markup:
    everything = groups[0].collapsed
    rows = [["all", everything.sum(), "", "", *everything.tolist()]]
    for group in groups:
        for i in np.flatnonzero(group.counts.any(axis=1)):
            interval = f"{group.overall_lower[i]:.2f} – {group.overall_upper[i]:.2f}"
            rows.append([group.categories[i], group.counts[i].sum(), f"{group.overall[i]:.2f}",
                         interval, *group.counts[i].tolist()])  # fmt: skip
    levels = list(map(digits, results.levels.tolist()))
    heads = ["collapses", "all levels", "fraction", f"{percent} interval", *levels]
    return table(f"Collapses of {results.arch} by mechanism", heads, rows, "dense narrow")


def _ran(results: ArchResults) -> Rows:
    time = dict(zip(results.models, results["model_time"].sum(axis=(0, 1)).tolist()))
    words = {model.name.lower(): text for model, text in MODEL_WORDS.items()}
    total = sum(time.values())
    moving = total - time["rest"]
    for model, seconds in time.items():
        if seconds:
            part = f"{seconds:,.1f} s ({100 * seconds / total:.1f} %)"
            yield f"simulated time, {words[model]}", part
    if moving > 0:
        part = f"{100 * time['all_voussoirs'] / moving:.1f} %"
        yield "fraction of the time in motion on all voussoirs", part
    for label, name in (("events located", "events"), ("impacts", "impacts"),
                        ("switches to time stepping", "switches")):  # fmt: skip
        if number := results[name].sum():
            often = f" ({number / moving:.3g} in a second of motion)" if moving > 0 else ""
            yield label, f"{number:,}{often}"
    solved, again = results["levels"].sum(), results["level_iterations"].sum()
    if solved:
        yield "contact problems solved by the two levels", f"{solved:,}"
    if again:
        yield "of these, with more than one round", f"{again:,} ({100 * again / solved:.2g} %)"
    if general := results["general"].sum():
        yield "contact problems left to the general solver", f"{general:,}"


def _speed(inputs: ReportInputs, results: ArchResults) -> Rows:
    wall = np.array((inputs.timings or {}).get(results.arch, ()), dtype=float)
    number, simulated = int(results.counts.runs.sum()), np.nansum(results["end_time"])
    yield "simulated time", f"{simulated:,.0f} s in {number:,} runs"
    if wall.sum() > 0 and simulated > 0:
        yield "wall time of the simulations, summed over workers", f"{wall.sum():,.2f} s"
        yield "wall time for one simulated second", f"{1e3 * wall.sum() / simulated:#.3g} ms"
    if wall.size and wall.size == number:
        ends = np.quantile(wall, [0.5, 0.95])
        yield "wall time of a run, median and 95 %", "{:#.3g} s, {:#.3g} s".format(*ends)
    yield "steps of integration", f"{results['steps'].sum():,}"
    failed = results.verdict == Verdict.SOLVER_FAILURE
    sound = results.simulated & ~failed
    displaced = sound & (results["peak_displacement"] >= 1e-4)
    of = f"{displaced.sum()} runs displaced by 0.1 mm or more"
    error, residual = results["energy_error"], results["contact_residual"]
    yield f"energy error, median and largest ({of})", words.median_and_largest(error[displaced])
    yield "contact residual, median and largest", words.median_and_largest(residual[sound])
    if failed.any():
        label = "contact residual of solver failures, median and largest"
        yield label, words.median_and_largest(residual[failed])
    yield "steps solved only with slightly compliant joints", f"{results['fallbacks'].sum():,}"
    yield "runs that lost all contact at a joint and stand", f"{stood_after_loss(results):,}"
    below = np.cumsum(results.verdict == Verdict.COLLAPSED, axis=1) > 0
    again = np.any(below & (results.verdict == Verdict.STANDING), axis=1).sum()
    yield "records that collapse at a level and stand at a higher one", again


def _repeated(
    inputs: ReportInputs, results: ArchResults, place: int, animated: bool
) -> dict[str, Any]:
    """Runs simulated again: the log of one, a collapse and a near miss in motion."""
    name, arch, onset = inputs.arches[place]
    films: list[Picture] = []
    found: dict[str, Any] = {"timeline": None, "log": [], "films": films}
    fit = inputs.answers[name].curve
    median = fit.theta * results.scale.factor if isinstance(fit, Fragility) else None
    chosen = {"A collapse": example.choose(results, median)}
    if animated:
        chosen["A near miss"] = example.farthest(results)
    for title, run in chosen.items():
        shown = onset.stands and example.repeat(inputs.cube, results, arch, inputs.motions, run)
        if not shown:
            continue
        if title == "A collapse":
            changes = shown.response.mechanism or ()
            found["log"] = [str(change) for change in changes[:_ENTRIES]]
            if len(changes) > _ENTRIES:
                found["log"].append(f"... and {len(changes) - _ENTRIES} more")
            found["timeline"] = example.timeline(shown)
        if animated and shown.response.collapsed == (title == "A collapse"):
            key = "fall" if shown.response.collapsed else "miss"
            film = arch_figures.film(shown, f"{key}{place}", title)
            films += [film] if film else []
    return found


def class_section(inputs: ReportInputs, name: str, scale: Scale) -> dict[str, Any]:
    """Figures, tables and numbers of a class, by the names that the page's template uses."""
    of_class = arch_classes(inputs.cube)
    members = [inputs.answers[arch] for arch, own in of_class.items() if own == name]
    answer = inputs.classes[name]
    highest = scale.factor * float(inputs.cube["intensity"].max())
    differences = _differences(inputs.cube, np.array(list(of_class.values())) == name)
    parts, split = answer.more.get("dispersion") or {}, None
    if parts and "none" not in parts:
        split = pairs(f"Dispersion of the class {name}", [
            ("from record to record", f"{parts['beta_record_to_record']:.3f}"),
            ("between the arches of the class", f"{parts['beta_model']:.3f}"),
        ], "part of β")  # fmt: skip
    return {
        "n_arch": len(members),
        "answer": answer,
        "cautions": (),
        "lost": lost_text(answer, scale.text),
        "limit_states": curves.limit_states(answer, name, scale, highest),
        "states": states_table(answer, name, scale),
        "curve": curves.class_curve(answer, members, name, scale),
        "split": split,
        "panels": runs.theta_panels(members, differences, name, scale),
    }


def _differences(cube: xr.Dataset, own: NDArray[np.bool_]) -> dict[str, NDArray]:
    """What the arches of a class differ by: numbers as floats, attributes as texts."""
    found: dict[str, NDArray] = {}
    for name in map(str, cube.data_vars):
        if name.startswith(("arch_", "attribute_")) and name != "arch_class":
            values = cube[name].values[own]
            values = values.astype(float if values.dtype.kind in "fiu" else str)
            if np.unique(values).size > 1:
                found[name.partition("_")[2].replace("_", " ")] = values
    return found
