"""What the page shows of one arch."""

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from archfrag.arch import Arch
from archfrag.report import (
    animation,
    arch_figure,
    curve_figures,
    example,
    figures,
    ladder_figures,
    measure_figures,
    mechanism_figures,
    tables,
    timeline,
)
from archfrag.report.axes import digits
from archfrag.report.summary import ArchResults, Scale
from archfrag.study.curves import curve_of_dict

if TYPE_CHECKING:
    import xarray as xr

    from archfrag.report.page import ReportInputs
    from archfrag.study.curves import Answer

DESIGN_WORDS = {
    "stripes": "every record at every level",
    "ida": "the levels bisected for each record",
    "two_stage": "the levels bisected for each record by a coarse method, decided by the study's",
    "scattered": "each run a motion and a level of its own",
    "cloud": "every record once",
}
_ENTRIES = 60  # of the log, in words


def arch_section(
    inputs: "ReportInputs", cube: "xr.Dataset", results: ArchResults, place: int, animated: bool
) -> dict[str, Any]:
    """Figures, tables and numbers of an arch, by the names that the page's template uses."""
    prefix, (name, arch, onset) = f"arch{place}", inputs.arches[place]
    answer, counts = inputs.answers[name], results.counts
    wall = None if inputs.timings is None else inputs.timings.get(name)
    return {
        "id": prefix,
        "name": name,
        "answer": tables.answer(answer, results.scale),
        "counts": {
            "runs": int(counts.runs.sum()),
            "collapsed": int(counts.collapsed.sum()),
            "standing": int(counts.standing.sum()),
            "unfinished": int(counts.unfinished.sum()),
            "failures": int(counts.solver_failures.sum()),
            "stood_after_loss": results.stood_after_loss,
        },
        "cautions": cautions_of(inputs.cautions, name),
        "grouped": results.grouped,
        "design": design_table(cube, name),
        "curve": curve_figures.curve(results, answer),
        "test_of_fit": answer.more.get("free", {}).get("test_of_fit", {}).get("message", ""),
        "levels": tables.levels(results, answer),
        "verdicts": (figures.scattered_runs if results.grouped else figures.verdict_map)(results),
        "arch": arch_figure.arch_at_onset(arch, onset, name),
        "onset": {
            "plus": arch_figure.onset_text(onset.plus),
            "minus": arch_figure.onset_text(onset.minus),
        },
        "stands": onset.stands,
        "geometry": tables.geometry(arch.parameters),
        **_mechanisms(inputs, results, arch),
        **_runs(cube, inputs, results, place, animated),
        "cloud": _cloud(answer, results.scale),
        "limit_states": _limit_states(answer, results),
        "measures": _measures(answer, name),
        "ran": ladder_figures.what_ran(results),
        "ran_table": ladder_figures.table(results),
        "numerics": figures.numerics(results),
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
    return tables.Table(
        ["design", "value"], [[key, value] for key, value in rows.items() if value]
    )


def _mechanisms(inputs: "ReportInputs", results: ArchResults, arch: Arch) -> dict[str, Any]:
    groups = [
        mechanism_figures.by_mode(results, inputs.confidence),
        mechanism_figures.by_joint(results, arch.n_joint, inputs.confidence),
        mechanism_figures.by_impacts(results, inputs.confidence),
    ]
    return {
        "collapses": figures.collapses(results, arch.n_joint),
        "fractions": mechanism_figures.fractions(groups, results),
        "fractions_table": mechanism_figures.table(groups, results),
        "n_effective": f"{groups[0].n_effective:.1f}",
    }


def _runs(
    cube: "xr.Dataset", inputs: "ReportInputs", results: ArchResults, place: int, animated: bool
) -> dict[str, Any]:
    """Runs done again: the log of one, a collapse and a near miss in motion."""
    name, arch, onset = inputs.arches[place]
    fit = inputs.answers[name].curve
    found: dict[str, Any] = {"timeline": None, "log": [], "animations": []}
    if not onset.stands:
        return found
    median = None if isinstance(fit, str) else fit.theta * results.scale.factor
    shown = example.repeat(cube, results, arch, inputs.motions, example.choose(results, median))
    if shown is None:
        return found
    changes = shown.response.mechanism or ()
    lines = [str(change) for change in changes[:_ENTRIES]]
    if len(changes) > _ENTRIES:
        lines.append(f"... and {len(changes) - _ENTRIES} more")
    found |= {"timeline": timeline.timeline(shown), "log": lines}
    if animated:
        miss = example.near_miss(results)
        near = example.repeat(cube, results, arch, inputs.motions, miss) if miss else None
        for key, title, run in (("fall", "A collapse", shown), ("miss", "A near miss", near)):
            if run is not None and run.response.collapsed == (key == "fall"):
                moving = animation.animation(run, f"{key}{place}", title)
                found["animations"] += [] if moving is None else [moving]
    return found


def _cloud(answer: "Answer", scale: Scale) -> tables.Table | None:
    """Curves of a cloud by regression, beside the one that is quoted."""
    rows = []
    for name, found in answer.more.get("cloud", {}).items():
        if "theta" not in found:
            rows.append([name, found["none"], "–"])
            continue
        low, high = (digits(scale.factor * end) for end in found["theta_interval"])
        ends = "–".join(f"{end:.2f}" for end in found["beta_interval"])
        theta = digits(scale.factor * found["theta"])
        rows.append([name, f"{theta} ({low}–{high})", f"{found['beta']:.2f} ({ends})"])
    return tables.Table(["regression", f"θ [{scale.unit}]", "β"], rows) if rows else None


def _limit_states(answer: "Answer", results: ArchResults) -> dict[str, Any] | None:
    given = answer.more.get("limit_states")
    if given is None:
        return None
    scale, fits, rows = results.scale, [], []
    for state in given["states"]:
        fit = curve_of_dict(state["curve"])
        words = [state["name"].replace("_", " "), state["meaning"]]
        if isinstance(fit, str):
            rows.append([*words, "no curve", "–"])
        else:
            fits.append((words[0], fit))
            rows.append([*words, digits(fit.theta * scale.factor), f"{fit.beta:.3f}"])
    highest = float(results.levels.max())
    return {
        "figure": curve_figures.limit_states(fits, results.arch, scale, highest) if fits else None,
        "table": tables.Table(["limit state", "meaning", f"θ [{scale.unit}]", "β"], rows, 2),
        "message": given["message"],
    }


def _measures(answer: "Answer", name: str) -> dict[str, Any] | None:
    given = answer.more.get("measures")
    if given is None:
        return None
    if "none" in given:
        return {"message": f"No comparison: {given['none']}", "figure": None, "table": None}
    return {
        "message": given["message"],
        "figure": measure_figures.measures_figure(given["rows"], name, given["best"]),
        "table": measure_figures.measures_table(given["rows"]),
    }
