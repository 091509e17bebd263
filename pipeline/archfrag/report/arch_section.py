"""What the page says of one arch."""

from typing import TYPE_CHECKING, Any

import xarray as xr

from archfrag.arch import Arch
from archfrag.fragility.fit import Fragility
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
from archfrag.report.curve_figures import Resampled
from archfrag.report.summary import ArchResults, digits
from archfrag.study.cautions import undecided

if TYPE_CHECKING:
    from archfrag.report.page import ReportInputs

_ENTRIES = 60  # of the log, in words


def arch_section(
    inputs: "ReportInputs",
    cube: xr.Dataset,
    results: ArchResults,
    place: int,
    resampled: Resampled | None,
    animated: bool,
) -> dict[str, Any]:
    """Figures, tables and numbers of an arch, by the names that the page's template uses.

    Parameters
    ----------
    inputs : ReportInputs
    cube : xarray.Dataset
    results : ArchResults
    place : int
        Of the arch in `inputs.arches`.
    resampled : Resampled or None
        Band of its curve.
    animated : bool
        Whether to show runs in motion.
    """
    prefix, (_, arch, onset) = f"arch{place}", inputs.arches[place]
    given = inputs.fits[results.arch]
    fit = given if isinstance(given, Fragility) else None
    counts = results.counts
    return {
        "id": prefix,
        "name": results.arch,
        "answer": tables.answer(
            results, given, inputs.confidence, resampled.band if resampled else None
        ),
        "counts": {
            "runs": int(counts.runs.sum()),
            "collapsed": int(counts.collapsed.sum()),
            "standing": int(counts.standing.sum()),
            "unfinished": int(counts.unfinished.sum()),
            "failures": int(counts.solver_failures.sum()),
            "stood_after_loss": results.stood_after_loss,
        },
        "caution": undecided(counts, results.level_texts),
        "curve": curve_figures.curve(results, fit, inputs.confidence, resampled),
        "levels": tables.levels(results, fit, inputs.confidence),
        "verdicts": figures.verdict_map(results),
        "arch": arch_figure.arch_at_onset(arch, onset, results.arch),
        "onset": {
            "plus": arch_figure.onset_text(onset.plus),
            "minus": arch_figure.onset_text(onset.minus),
        },
        "stands": onset.stands,
        "geometry": tables.geometry(arch.parameters),
        **_mechanisms(inputs, results, arch),
        **_runs(cube, inputs, results, place, (fit, animated)),
        **_other_curves(inputs, results),
        "ran": ladder_figures.what_ran(results),
        "ran_table": ladder_figures.table(results),
        "numerics": figures.numerics(results),
        "quality": tables.quality(results, inputs.timings),
    }


def _mechanisms(inputs: "ReportInputs", results: ArchResults, arch: Arch) -> dict[str, Any]:
    groups = [
        mechanism_figures.by_mode(results, inputs.confidence),
        mechanism_figures.by_joint(results, arch.n_joint, inputs.confidence),
        mechanism_figures.by_impacts(results, inputs.confidence),
    ]
    return {
        "collapses": figures.collapses(results, arch.n_joint),
        "shares": mechanism_figures.shares(groups, results),
        "shares_table": mechanism_figures.table(groups, results),
        "n_effective": f"{groups[0].n_effective:.1f}",
    }


def _runs(
    cube: xr.Dataset,
    inputs: "ReportInputs",
    results: ArchResults,
    place: int,
    about: tuple[Fragility | None, bool],
) -> dict[str, Any]:
    """Runs done again: the log of one, a collapse and a near miss in motion."""
    fit, animated = about
    _, arch, onset = inputs.arches[place]
    found: dict[str, Any] = {"timeline": None, "log": [], "animations": []}
    if not onset.stands:
        return found
    median = None if fit is None else fit.theta * results.scale.factor
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
        for name, title, run in (("fall", "A collapse", shown), ("miss", "A near miss", near)):
            if run is not None and run.response.collapsed == (name == "fall"):
                moving = animation.animation(run, f"{name}{place}", title)
                found["animations"] += [] if moving is None else [moving]
    return found


def _other_curves(inputs: "ReportInputs", results: ArchResults) -> dict[str, Any]:
    """Limit states and measures, where others gave them."""
    scale = results.scale
    found: dict[str, Any] = {"limit_states": None, "measures": None}
    states = list(inputs.limit_states.get(results.arch, ()))
    if states:
        rows = [[name, digits(f.theta * scale.factor), f"{f.beta:.3f}"] for name, f in states]
        found["limit_states"] = {
            "figure": curve_figures.limit_states(
                states, results.arch, scale, float(results.levels.max())
            ),
            "table": tables.Table(["limit state", f"θ [{scale.unit}]", "β"], rows),
        }
    rows_ = list(inputs.measures.get(results.arch, ()))
    if rows_:
        found["measures"] = {
            "best": measure_figures.best(rows_),
            "figure": measure_figures.measures_figure(rows_, results.arch),
            "table": measure_figures.measures_table(rows_),
        }
    return found
