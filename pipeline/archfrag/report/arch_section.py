"""What the page says of one arch."""

from typing import TYPE_CHECKING, Any

import xarray as xr

from archfrag.arch import Arch
from archfrag.fragility.fit import Fragility
from archfrag.report import (
    arch_figure,
    example,
    figures,
    ladder_figures,
    mechanism_figures,
    tables,
    timeline,
)
from archfrag.report.summary import ArchResults
from archfrag.study.cautions import undecided

if TYPE_CHECKING:
    from archfrag.report.page import ReportInputs
    from archfrag.simulate import Onset

_ENTRIES = 60  # of the log, in words


def arch_section(
    inputs: "ReportInputs",
    cube: xr.Dataset,
    results: ArchResults,
    arch: Arch,
    onset: "Onset",
    prefix: str,
) -> dict[str, Any]:
    """Figures, tables and numbers of an arch, by the names that the page's template uses.

    Parameters
    ----------
    inputs : ReportInputs
    cube : xarray.Dataset
    results : ArchResults
    arch : Arch
    onset : Onset
    prefix : str
        Unique on the page.
    """
    given = inputs.fits[results.arch]
    fit = given if isinstance(given, Fragility) else None
    counts = results.counts
    resampled = None
    if fit is not None and len(results.records) > 1:
        resampled = figures.resample(results, inputs.confidence)
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
        "curve": figures.curve(results, fit, f"{prefix}-curve", inputs.confidence, resampled),
        "levels": tables.levels(results, fit, inputs.confidence),
        "verdicts": figures.verdict_map(results, f"{prefix}-verdicts"),
        "arch": arch_figure.arch_at_onset(arch, onset, results.arch, f"{prefix}-onset"),
        "onset": {
            "plus": arch_figure.onset_text(onset.plus),
            "minus": arch_figure.onset_text(onset.minus),
        },
        "stands": onset.stands,
        "geometry": tables.geometry(arch.parameters),
        **_mechanisms(inputs, results, arch, prefix),
        **_log(cube, inputs, results, arch, onset, fit, prefix),
        "ran": ladder_figures.what_ran(results, f"{prefix}-ran"),
        "ran_table": ladder_figures.table(results),
        "numerics": figures.numerics(results, f"{prefix}-numerics"),
        "quality": tables.quality(results, inputs.timings),
    }


def _mechanisms(
    inputs: "ReportInputs", results: ArchResults, arch: Arch, prefix: str
) -> dict[str, Any]:
    groups = [
        mechanism_figures.by_mode(results, inputs.confidence),
        mechanism_figures.by_joint(results, arch.n_joint, inputs.confidence),
        mechanism_figures.by_impacts(results, inputs.confidence),
    ]
    return {
        "collapses": figures.collapses(results, arch.n_joint, f"{prefix}-collapses"),
        "shares": mechanism_figures.shares(groups, results, f"{prefix}-shares"),
        "shares_table": mechanism_figures.table(groups, results),
        "n_effective": f"{groups[0].n_effective:.1f}",
    }


def _log(
    cube: xr.Dataset,
    inputs: "ReportInputs",
    results: ArchResults,
    arch: Arch,
    onset: "Onset",
    fit: Fragility | None,
    prefix: str,
) -> dict[str, Any]:
    median = None if fit is None else fit.theta * results.scale.factor
    shown = example.repeat(cube, results, arch, inputs.motions, median) if onset.stands else None
    if shown is None:
        return {"timeline": None, "log": []}
    changes = shown.response.mechanism or ()
    lines = [str(change) for change in changes[:_ENTRIES]]
    if len(changes) > _ENTRIES:
        lines.append(f"... and {len(changes) - _ENTRIES} more")
    return {"timeline": timeline.timeline(shown, f"{prefix}-timeline"), "log": lines}
