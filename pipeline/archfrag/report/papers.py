"""Numbers beside the report: for programs, capacities, runs in words, what each file is."""

import json
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from archfrag.files import write_csv
from archfrag.fragility.curve import Curve
from archfrag.fragility.verdicts import Verdict, count_verdicts
from archfrag.physics.status import CollapseMode
from archfrag.report.inputs import ReportInputs
from archfrag.study.answer.tables import runs_table
from archfrag.study.products import README
from archfrag.study.provenance import finite, write_text
from archfrag.version import __version__

RUN_COLUMNS = (
    "arch",
    "arch_class",
    "record",
    "event",
    "magnitude",
    "distance",
    "intensity",
    "scale_factor",
    "verdict",
    "collapse_mode",
    "collapse_joint",
    "collapse_time",
    "lost_contact_time",
    "lost_contact_joint",
    "peak_rotation",
    "residual_rotation",
    "peak_displacement",
    "residual_displacement",
    "impacts",
    "openings",
    "slides",
    "end_time",
    "status",
    "energy_error",
    "moving_before",
)
COUNTS = ("runs", "collapsed", "survived", "unfinished", "failed", "collapsed_before")
_MADE_BY = (
    "archfrag_commit",
    "archfrag_versions",
    "archfrag_plan",
    "archfrag_machine",
    "source",
)
_HEAD = "Results of archfrag"
_FILES = (
    Path(__file__).with_name("readme.txt").read_text("utf-8")
)  # what each of them is


def write_papers(inputs: ReportInputs, folder: Path) -> None:
    """Write ``summary.json``, ``capacities.csv``, ``runs.csv`` and ``README.txt``.

    A README of somebody else is left alone.
    """
    scale = inputs.scale
    cube = inputs.cube
    units = {name: f"{name} [{scale.unit}]" for name in ("lower", "upper", "capacity")}
    table = inputs.fitted.capacities(scale.factor).rename(columns=units)
    runs = runs_in_words(cube, scale.label, scale.factor)
    numbers = json.dumps(summary(inputs), indent=1, ensure_ascii=False, allow_nan=False)
    write_text(folder / "summary.json", numbers + "\n")
    for name, pieces in (
        ("capacities.csv", [table.replace(np.inf, np.nan)]),
        ("runs.csv", runs),
    ):
        write_csv(folder / name, pieces, float_format="%.7g")
    path = folder / README
    if not path.is_file() or path.read_bytes().startswith(_HEAD.encode()):
        title, study = (cube.attrs.get(key, "") for key in ("title", "archfrag_study"))
        about = f"{_HEAD} {__version__}: {title} (study {study})\nIntensities are "
        write_text(path, f"{about}{scale.label}.\n\n{_FILES}")


def runs_in_words(
    cube: xr.Dataset, intensity: str, factor: float
) -> Iterator[pd.DataFrame]:
    """Yield the runs in pieces, with words for codes and units in the names."""
    about, pieces = runs_table(cube)
    names = {}
    for name in RUN_COLUMNS:
        if name in about:
            unit = about[name].get("unit", "1")
            names[name] = name if unit == "1" else f"{name} [{unit}]"
    names["intensity"] = intensity
    for piece in pieces:
        own: dict[str, Any] = {
            "intensity": [_stated(si, factor) for si in piece["intensity"]]
        }
        for name in names:
            if codes := about[name].get("codes"):
                words = {code: word.replace("_", " ") for word, code in codes.items()}
                own[name] = piece[name].map(words)
            elif name.endswith("_joint"):
                own[name] = piece[name].where(piece[name] >= 0).astype("Int64")
        yield piece.assign(**own)[list(names)].rename(columns=names)


def _stated(si: float, factor: float) -> str:
    """Write an SI level times `factor` as a study gives it, or in full."""
    short = f"{factor * si:.12g}"
    return short if float(short) * (1.0 / factor) == si else repr(float(factor * si))


def summary(inputs: ReportInputs) -> dict[str, Any]:
    """Return the content of ``summary.json``, which docs/reference/results.md lists."""
    cube = inputs.cube
    attributes = cube.attrs
    scale = inputs.scale
    onsets = {name: onset for name, _, onset in inputs.arches}
    of_runs = ("verdict", "lost_contact_time", "collapse_mode", "collapse_joint")
    tables = [
        cube[name].transpose("arch", "record", "level").values for name in of_runs
    ]
    arches = []
    for (name, of_class), *of_arch in zip(inputs.of_class.items(), *tables):
        start = onsets.get(name)
        arches.append(
            {
                "id": name,
                "class": of_class,
                **_answered(inputs, inputs.answers[name]),
                **_counted(*of_arch),
                "stands": start and bool(start.stands),
                "onset": start and {"plus": start.plus, "minus": start.minus},
            }
        )
    classes = [
        {
            "id": name,
            "arches": list(inputs.of_class.values()).count(name),
            **_answered(inputs, answer),
            "dispersion": answer.more.get("dispersion"),
        }
        for name, answer in inputs.classes.items()
    ]
    return finite(
        {
            "format": "archfrag-summary/2",
            "study": attributes.get("archfrag_study"),
            "title": inputs.title,
            "measure": scale.measure,
            "unit": scale.unit,
            "unit_in_si": 1.0 / scale.factor,
            "confidence": inputs.confidence,
            "level": inputs.at,
            "design": json.loads(attributes["archfrag_design"])["kind"],
            "records": cube.sizes["record"],
            "levels": cube.sizes["level"],
            "arches": arches,
            "classes": classes,
            "cautions": list(inputs.cautions),
            "made_by": {key: attributes[key] for key in _MADE_BY if key in attributes},
        },
        None,
    )


def _answered(inputs: ReportInputs, answer: Curve) -> dict[str, Any]:
    """Return the curve [SI] and the probability of an arch or a class, or why there is none."""
    factor = inputs.scale.factor
    at = inputs.at
    lost = answer.more.get("without_verdict") or None
    if lost and "runs" in lost:
        medians = {key: lost[key].get("theta") for key in ("collapsed", "survived")}
        theta = {key: median and factor * median for key, median in medians.items()}
        lost = {"runs": lost["runs"], "theta_if": theta}
    found: dict[str, Any] = {"reason": answer.reason or None, "without_verdict": lost}
    found |= {"curve": None, "probability": None}
    if not answer.fitted:
        return found
    likeliest = None
    most = answer.likelihood
    if most is not None and most.fitted:
        likeliest = {"theta": factor * most.theta, "beta": most.beta, "kind": most.kind}
    found["curve"] = {
        "theta": factor * answer.theta,
        "theta_interval": [factor * end for end in answer.theta_interval],
        "beta": answer.beta,
        "beta_interval": list(answer.beta_interval),
        "method": answer.method,
        "assumptions": answer.assumptions,
        "independent": answer.n_independent,
        "non_monotone": answer.n_non_monotone,
        "kind": answer.kind,
        "maximum_likelihood": likeliest,
    }
    if at is not None:
        value, *ends = answer.at(at / factor)
        found["probability"] = {"level": at, "value": value, "interval": ends}
    return found


def _counted(
    verdict: NDArray, lost: NDArray, mode: NDArray, joint: NDArray
) -> dict[str, Any]:
    """Return how many runs of an arch have each verdict, and fractions of its collapses."""
    number = count_verdicts(verdict)
    collapsed = verdict == Verdict.COLLAPSED
    counts = {name: int(number[name].sum()) for name in COUNTS}
    counts["not_run"] = verdict.size - counts["runs"]
    landed = (verdict == Verdict.SURVIVED) & np.isfinite(lost)
    counts["lost_contact_and_stand"] = int(landed.sum())
    modes = [CollapseMode(code).name.lower() for code in mode[collapsed]]
    mechanisms = {
        kind: {
            str(k): round(n / len(codes), 6) for k, n in sorted(Counter(codes).items())
        }
        for kind, codes in (("mode", modes), ("joint", joint[collapsed].tolist()))
    }
    return {"counts": counts, "mechanisms": mechanisms}
