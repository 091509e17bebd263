"""What the page shows of one arch."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from archfrag.fragility.counts import clopper_pearson
from archfrag.report import arch_figure, curve_figures, example, figures
from archfrag.report.animation import animation
from archfrag.report.inputs import ReportInputs
from archfrag.report.picture import Picture
from archfrag.report.summary import ArchResults
from archfrag.report.timeline import timeline
from archfrag.simulation.mechanism import MODEL_WORDS
from archfrag.study.fits import lost_text

_ENTRIES = 60  # of the log, in words


def arch_section(
    inputs: ReportInputs, results: ArchResults, place: int, animated: bool
) -> dict[str, Any]:
    """Data, figures and tables of an arch, by the names that the page's template uses."""
    name, arch, onset = inputs.arches[place]
    answer = inputs.answers[name]
    wall = np.array((inputs.timings or {}).get(name, ()), dtype=float)
    runs = results.counts.runs.sum()
    groups = figures.groupings(results, inputs.confidence)
    return {
        "id": f"arch{place}",
        "name": name,
        "answer": answer,
        "results": results,
        "onset": onset,
        "cautions": cautions_of(inputs.cautions, name),
        "curve": curve_figures.curve(results, answer),
        "interval": clopper_pearson(results.known.collapsed, results.known.n, answer.confidence),
        "limit_states": curve_figures.limit_states(
            answer, name, results.scale, float(results.levels.max())
        ),
        "lost": lost_text(answer, results.scale.text),
        "measures": curve_figures.measures(answer, name),
        "measured": curve_figures.efficient_first(answer),
        "verdicts": (figures.scattered_runs if results.grouped else figures.verdict_map)(results),
        "arch": arch_figure.arch_at_onset(arch, onset, name),
        "geometry": arch.parameters,
        "fractions": figures.fractions(groups, results),
        "groups": groups,
        **_repeated(inputs, results, place, animated),
        "model_time": dict(zip(results.models, results["model_time"].sum(axis=(0, 1)).tolist())),
        "model_words": {model.name.lower(): words for model, words in MODEL_WORDS.items()},
        "simulated": np.nansum(results["end_time"]),
        "wall": wall,
        "wall_ends": np.quantile(wall, [0.5, 0.95]) if wall.size and wall.size == runs else (),
    }


def cautions_of(cautions: Sequence[str], name: str) -> list[str]:
    """Cautions that concern one arch, without its name."""
    start = f"{name}: "
    return [caution.removeprefix(start) for caution in cautions if caution.startswith(start)]


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
    found["timeline"], found["example"] = timeline(shown), shown
    if animated:
        near = again(example.near_miss(results))
        for key, title, run in (("fall", "A collapse", shown), ("miss", "A near miss", near)):
            if run is not None and run.response.collapsed == (key == "fall"):
                drawn = animation(run, f"{key}{place}", title)
                moving += [] if drawn is None else [drawn]
    return found
