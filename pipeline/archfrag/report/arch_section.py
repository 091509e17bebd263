"""What the page shows of one arch."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from archfrag.report import arch_figure, curve_figures, example, figures, mechanism_figures, tables
from archfrag.report.animation import animation
from archfrag.report.inputs import ReportInputs
from archfrag.report.picture import Picture
from archfrag.report.summary import ArchResults, Scale
from archfrag.report.timeline import timeline
from archfrag.study.curves import Answer, curve_of_dict

if TYPE_CHECKING:
    import xarray as xr

DESIGN_WORDS = {
    "stripes": "every record at every level",
    "ida": "the levels bisected for each record",
    "two_stage": "the levels bisected for each record by a coarse method, decided by the study's",
    "scattered": "each run a motion and a level of its own",
    "cloud": "every record once",
}
_ENTRIES = 60  # of the log, in words

_NO_STATES = (
    "None has a curve: the runs lie near collapse, so that nearly all of them exceed the others. "
    "The design stripes, or levels nearer to the onset of motion, would show them."
)


def arch_section(
    inputs: ReportInputs, results: ArchResults, place: int, animated: bool
) -> dict[str, Any]:
    """Figures, tables and numbers of an arch, by the names that the page's template uses."""
    name, arch, onset = inputs.arches[place]
    answer = inputs.answers[name]
    counts = {kind: int(number.sum()) for kind, number in asdict(results.counts).items()}
    wall = None if inputs.timings is None else inputs.timings.get(name)
    groups = mechanism_figures.groupings(results, inputs.confidence)
    return {
        "id": f"arch{place}",
        "name": name,
        "answer": tables.answer(answer, results.scale),
        "counts": {"runs": sum(counts.values()), **counts},
        "stood_after_loss": results.stood_after_loss,
        "cautions": cautions_of(inputs.cautions, name),
        "grouped": results.grouped,
        "design": design_table(inputs.cube, name),
        "curve": curve_figures.curve(results, answer),
        "test_of_fit": answer.more.get("free", {}).get("test_of_fit", {}).get("message", ""),
        "levels": tables.levels(results, answer),
        "verdicts": (figures.scattered_runs if results.grouped else figures.verdict_map)(results),
        "arch": arch_figure.arch_at_onset(arch, onset, name),
        "onset": [arch_figure.onset_text(limit) for limit in (onset.plus, onset.minus)],
        "stands": onset.stands,
        "geometry": tables.geometry(arch.parameters),
        "fractions": mechanism_figures.fractions(groups, results),
        "fractions_table": mechanism_figures.fractions_table(groups, results),
        "n_effective": f"{groups[0].n_effective:.1f}",
        **_repeated(inputs, results, place, animated),
        "cloud": _cloud(answer, results.scale),
        "limit_states": _limit_states(answer, results),
        "measures": _measures(answer, name),
        "ran_table": mechanism_figures.ran_table(results),
        "quality": tables.quality(results, wall),
    }


def cautions_of(cautions: Sequence[str], name: str) -> list[str]:
    """Cautions that concern one arch, without its name."""
    start = f"{name}: "
    return [caution.removeprefix(start) for caution in cautions if caution.startswith(start)]


def design_table(cube: "xr.Dataset", name: str) -> tables.Table | None:
    """How the runs of an arch were chosen; None where the cube does not hold it."""
    design = json.loads(cube.attrs.get("archfrag_design", "{}"))
    note = design.get("arches", {}).get(name)
    if note is None:
        return None
    width = float(note.get("half_width", np.nan))
    checked = f"{note.get('contradictions')} of {note.get('checked')}"
    rows = {
        f"design {design['kind']}": DESIGN_WORDS[design["kind"]],
        "runs": str(note["runs"]),
        "coarse runs before": str(note.get("coarse_runs") or ""),
        "records": f"{note['records']} of {cube.sizes['record']}" if "records" in note else "",
        "runs at random against the capacity of their record":
            checked if note.get("checked") else "",
        "half width of the median's interval, by the design's own estimate":
            f"{100 * width:.2g} %" if np.isfinite(width) else "",
        "as narrow as wanted":
            ("yes" if note.get("reached") else f"no: {note.get('why', '')}")
            if np.isfinite(width) else "",
    }  # fmt: skip
    return tables.Table(["design", "value"], [list(row) for row in rows.items() if row[1]])


def _repeated(
    inputs: ReportInputs, results: ArchResults, place: int, animated: bool
) -> dict[str, Any]:
    """Runs done again: the log of one, a collapse and a near miss in motion."""
    name, arch, onset = inputs.arches[place]
    moving: list[Picture] = []
    found: dict[str, Any] = {"timeline": None, "log": [], "animations": moving}
    if not onset.stands:
        return found

    def again(chosen: example.Chosen | None) -> example.Example | None:
        return example.repeat(inputs.cube, results, arch, inputs.motions, chosen)

    fit = inputs.answers[name].curve
    median = None if isinstance(fit, str) else fit.theta * results.scale.factor
    shown = again(example.choose(results, median))
    if shown is None:
        return found
    changes = shown.response.mechanism or ()
    found["log"] = [str(change) for change in changes[:_ENTRIES]]
    if len(changes) > _ENTRIES:
        found["log"].append(f"... and {len(changes) - _ENTRIES} more")
    found["timeline"] = timeline(shown)
    if animated:
        near = again(example.near_miss(results))
        for key, title, run in (("fall", "A collapse", shown), ("miss", "A near miss", near)):
            if run is not None and run.response.collapsed == (key == "fall"):
                drawn = animation(run, f"{key}{place}", title)
                moving += [] if drawn is None else [drawn]
    return found


def _cloud(answer: Answer, scale: Scale) -> tables.Table | None:
    """Curves of a cloud by regression, beside the one that is quoted."""
    rows = []
    for name, found in answer.more.get("cloud", {}).items():
        if "theta" not in found:
            rows.append([name, found["none"], "–"])
            continue
        ends = "–".join(map(scale.digits, found["theta_interval"]))
        betas = "–".join(f"{end:.2f}" for end in found["beta_interval"])
        theta = scale.digits(found["theta"])
        rows.append([name, f"{theta} ({ends})", f"{found['beta']:.2f} ({betas})"])
    return tables.Table(["regression", f"θ [{scale.unit}]", "β"], rows) if rows else None


def _limit_states(answer: Answer, results: ArchResults) -> dict[str, Any] | None:
    given = answer.more.get("limit_states")
    if given is None:
        return None
    scale, fits, rows = results.scale, {}, []
    for state in given["states"]:
        fit = curve_of_dict(state["curve"])
        name = state["name"].replace("_", " ")
        if isinstance(fit, str):
            rows.append([name, f"{state['meaning']} (no curve: {fit})", "–", "–"])
            continue
        fits[name] = fit
        rows.append([name, state["meaning"], scale.digits(fit.theta), f"{fit.beta:.3f}"])
    if not fits:
        return {"figure": None, "table": None, "message": _NO_STATES}
    return {
        "figure": curve_figures.limit_states(fits, results),
        "table": tables.Table(["limit state", "meaning", f"θ [{scale.unit}]", "β"], rows, 2),
        "message": given["message"],
    }


def _measures(answer: Answer, name: str) -> dict[str, Any] | None:
    given = answer.more.get("measures")
    if given is None:
        return None
    if "none" in given:
        return {"message": f"No comparison: {given['none']}", "figure": None, "table": None}
    return {
        "message": given["message"],
        "figure": curve_figures.measures(given["rows"], name, given["best"]),
        "table": curve_figures.measures_table(given["rows"]),
    }
