"""Inputs of the report of a finished study, and its numbers for programs."""

import json
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from archfrag.errors import attempt
from archfrag.files import Named, counted, write_csv
from archfrag.fragility.curve import Curve, FloatArray, IntArray
from archfrag.fragility.verdicts import Verdict, count_verdicts
from archfrag.motions.motion import Motion
from archfrag.motions.selection import target_of_index
from archfrag.physics.status import CollapseMode
from archfrag.properties import LATER
from archfrag.report.html import digits
from archfrag.simulation.simulate import Onset, onset
from archfrag.study.answer.compare import Table, compare
from archfrag.study.answer.curves import ArchRuns, Fitted, arch_classes
from archfrag.study.answer.fits import cautions_of
from archfrag.study.answer.rates import StudyRisk, risk_of_study
from archfrag.study.answer.surface import Surface, surfaces_of
from archfrag.study.answer.tables import code_table, runs_table
from archfrag.study.file.members import shown
from archfrag.study.file.schema import CodeKeys, StudyKeys
from archfrag.study.provenance import README, finite, write_text
from archfrag.study.runs.store import Plan, make_plan
from archfrag.study.steps import finished, read_timings
from archfrag.study.validate import logo_url
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
    "collapse_place",
    "collapse_part",
    "collapse_time",
    "lost_contact_time",
    "lost_contact_joint",
    "lost_contact_place",
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
_FILES = Path(__file__).with_name("readme.txt").read_text("utf-8")  # what each file is

_MODELLED = {
    "friction",
    "dead_load",
    "fill",
    "spans",
    "piers",
    "ends",
    "transverse",
    *LATER,
}
_PLACED = ("joint", "place", "part")
_MOST_GROUPS = 10
_MOST_RATIOS = 8  # arches or classes whose ratios are told
_MISSING = {
    "verdict": Verdict.NOT_RUN,
    "collapse_joint": -1,
}  # values where no run was made; 0 for all other variables


@dataclass(frozen=True)
class Scale:
    """Intensity measure, and the unit in which people read it."""

    measure: str
    unit: str  #: of texts and figures
    factor: float  #: value in `unit` over value in SI

    @property
    def label(self) -> str:
        return f"{self.measure} [{self.unit}]"

    def text(self, value: float) -> str:
        """Write a value in the unit with three digits and the unit."""
        return f"{digits(value)} {self.unit}"


@dataclass(frozen=True)
class ArchResults:
    """All runs of an arch, or of the arches of a class, whose rows follow each other."""

    arch: str  #: name of the arch or class
    records: list[str]  #: name of the record of each row
    scale: Scale
    levels: FloatArray  #: (n_level,) in the reader's unit
    own_levels: FloatArray | None  #: (n_record,), if each run has its own
    table: Callable[[str], NDArray]  #: gives a variable of the cube by name [SI]
    simulated: NDArray[np.bool_]  #: (n_record, n_level), which runs there are
    runs: ArchRuns
    counts: Mapping[str, IntArray]  #: `count_verdicts` of runs at each level
    #: `count_verdicts` of records; if levels were searched, with what capacities imply.
    known: Mapping[str, IntArray]
    #: Of each record that was run, the middle of its bracket in logarithms: inf if it never
    #: collapsed, its lowest level if it collapsed there.
    capacities: FloatArray

    def __getitem__(self, name: str) -> NDArray:
        """Return a variable of the cube, (n_record, n_level, ...); 0 or -1 without a run."""
        return self.table(name)

    @property
    def verdict(self) -> IntArray:
        return self.table("verdict")

    @property
    def fraction(self) -> FloatArray:
        """Fraction of the known verdicts that are collapses, (n_level,); nan if there are none."""
        return np.asarray(self.known["fraction"])


@dataclass(frozen=True)
class ReportInputs:
    """Everything a report is written from."""

    cube: xr.Dataset  #: of the study
    scale: Scale  #: of the cube's levels
    answers: Mapping[str, Curve]  #: curve of each arch of the cube, in the SI unit
    classes: Mapping[str, Curve] = field(
        default_factory=dict
    )  #: curves of classes of several arches
    #: Unscaled motion of each record of the cube, whose name is its `id`; empty for a table.
    motions: Sequence[Motion] = ()
    #: Onset of each arch with a section, by its name in the cube, in the order of the page.
    arches: Mapping[str, Onset] = field(default_factory=dict)
    cautions: Sequence[
        str
    ] = ()  #: one that concerns an arch begins with its name and a colon
    #: Wall time of each run of an arch, or of groups of them [s].
    timings: Mapping[str, Sequence[float]] = field(default_factory=dict)
    title: str = "Fragility of masonry arches"
    confidence: float = 0.9  #: of all bands and intervals
    at: float | None = (
        None  #: level at which the probability is asked for, in the study's unit
    )
    risk: StudyRisk | str | None = None  #: or a text: why there are no rates
    code: CodeKeys | None = None  #: building code of a table
    #: Result of `target_of_index`.
    target: tuple[FloatArray, Mapping[str, float]] | None = None
    #: Keys of all arches that say what is modelled, by name of arch or class.
    given: Mapping[str, Sequence[Mapping[str, Any]]] = field(default_factory=dict)
    #: Of classes whose arches differ in the movement of a springing only.
    surfaces: Mapping[str, Surface] = field(default_factory=dict)
    plan: Plan | None = None  #: plan of the runs, for motions after first shocks
    #: Project, client and author, and a picture as a data URL, as far as they are given.
    about: Mapping[str, str] = field(default_factory=dict)

    @property
    def percent(self) -> str:
        return f"{100 * self.confidence:.0f} %"

    @cached_property
    def curves(self) -> dict[str, Curve]:
        """Curves of all classes and arches in the unit of the scale."""
        to = 1.0 / self.scale.factor, self.scale.measure, self.scale.unit
        return {k: curve.in_unit(*to) for k, curve in self.fitted.curves.items()}

    @cached_property
    def quoted(self) -> dict[str, Curve]:
        """Curves of the classes, and of the arches without a class, in the order of the study."""
        return {name: self.curves[name] for name in self.fitted.quoted()}

    @cached_property
    def config(self) -> Mapping[str, Any]:
        """Configuration of the study that made the cube; may be empty."""
        return json.loads(self.cube.attrs.get("archfrag_config", "{}"))

    @cached_property
    def results(self) -> Callable[[str], ArchResults]:
        """Function that gives the runs of an arch or a class by its name."""
        return cache(lambda name: arch_results(self.fitted.runs[name], self.scale))

    @cached_property
    def of_class(self) -> dict[str, str]:
        """Class of each arch, by the name of the arch."""
        return arch_classes(self.cube)

    @cached_property
    def known(self) -> dict[str, Curve]:
        """The curves of `quoted`, without those that could not be fitted."""
        return {name: curve for name, curve in self.quoted.items() if curve.fitted}

    @cached_property
    def fitted(self) -> Fitted:
        """All curves and the cube, with the runs behind them."""
        return Fitted(dict(self.answers), dict(self.classes), self.cube)

    @cached_property
    def ratios(self) -> dict[str, Table] | str:
        """Ratios of curves to their `references`, by name; or a text: why there are none."""
        if not 1 < len(self.known) <= _MOST_RATIOS:
            return {}
        site = self.risk.hazard.main if isinstance(self.risk, StudyRisk) else None

        both = [self.fitted] * 2
        return attempt(
            lambda: {
                name: compare(both, [reference, name], site, self.confidence)
                for name, reference in self.references.items()
            }
        )

    @cached_property
    def references(self) -> dict[str, str]:
        """Name of the curve with which each curve is compared, by name.

        It is the first curve; for an arch after a first shock it is that of the arch before the
        shock.
        """
        first, *others = self.known
        found = dict.fromkeys(others, first)
        for name in self.known:
            if not self.fitted.runs[name].intact:
                found[name] = name.rpartition("-after-")[0]
        return {name: of for name, of in found.items() if of in self.known}

    def stands_after(self, name: str) -> str:
        """Return words on the number of records after whose first shock an arch stands.

        They are empty if no first shock made it collapse.
        """
        runs = self.fitted.runs[name]
        before = (runs.verdict == Verdict.COLLAPSED_BEFORE).any(axis=1)
        return f"if it stands, as in {(~before).sum()} of {before.size}" * bool(
            before.any()
        )

    @cached_property
    def code_rows(self) -> pd.DataFrame | None:
        """Demand and capacity by the code that was asked for; None if there are no rates."""
        if self.code is None or not isinstance(self.risk, StudyRisk):
            return None
        return code_table(self.quoted, self.risk, self.code)

    @property
    def highest(self) -> float:
        """Highest level, in the unit of the scale."""
        return self.scale.factor * float(self.cube["intensity"].max())


def thetas(answers: Iterable[Curve]) -> FloatArray:
    """Return the median capacity of each curve, in its unit; nan without a curve."""
    return np.array([curve.theta for curve in answers])


def report_inputs(study: StudyKeys, table: Fitted | None = None) -> ReportInputs:
    """Return the inputs of the report of a finished study, or of a table of verdicts.

    A `table` has no arches and no motions. InputError if results are missing or out of date,
    OutputError if the cube of another study is in the folder.
    """
    fitted = table or finished(study)
    levels = study.intensity
    inputs = ReportInputs(
        fitted.cube,
        Scale(levels.measure, levels.unit, 1.0 / levels.factor),
        fitted.arches,
        fitted.classes,
        cautions=cautions_of(study, fitted),
        title=study.title,
        confidence=study.report.confidence,
        at=study.report.at,
        code=study.report.code,
        risk=attempt(partial(risk_of_study, study, fitted)),
    )
    if table:
        return inputs
    plan = make_plan(study)
    arches = {member.id: member.entry for member in study.members}
    names = list(fitted.arches)
    detailed = shown(thetas(fitted.arches.values()).tolist())
    given: dict[str, list[Mapping[str, Any]]] = {}
    spans = fitted.cube["spans"].values if "spans" in fitted.cube else [1] * len(names)
    for member, count in zip(study.members, spans):
        keys = member.entry.model_dump(include=_MODELLED, exclude_none=True)
        given.setdefault(member.arch_class, []).append(
            keys | several(int(count)) | {"before": not member.intact}
        )
    about = study.report.model_dump(
        include={"project", "client", "author"}, exclude_none=True
    )
    if study.report.logo is not None:
        about["logo"] = logo_url(study.report.logo)
    return replace(
        inputs,
        motions=[plan.motion(record) for record in plan.records],
        plan=plan,
        arches={names[i]: onset(arches[names[i]].build()) for i in detailed},
        timings=read_timings(study),
        title=_title(study),
        target=target_of_index(study.motions.index),
        given=given,
        surfaces=surfaces_of(study, fitted),
        about=about,
    )


def several(spans: int) -> dict[str, int]:
    """Return the number of spans under a key that only a bridge has."""
    return {"several": spans} if spans > 1 else {}


def _title(study: StudyKeys) -> str:
    """Return the title of the study, or a general one if it only has its id."""
    if study.title != study.id:
        return study.title
    block = all(member.entry.profile == "block" for member in study.members)
    noun = "block" if block else "masonry arch"
    return f"Fragility of {f'a {noun}' if len(study.members) == 1 else counted(2, noun)[2:]}"


def arch_results(runs: ArchRuns, scale: Scale) -> ArchResults:
    """Return the runs of an arch or a class in the form that the report needs."""
    n_arch = len(runs.arches)
    made = runs.verdict != Verdict.NOT_RUN
    levels = runs.level * scale.factor
    own_levels = None
    if levels.ndim == 2:
        own_levels = levels[:, 0]
        levels, group = _grouped(own_levels, made[:, 0])
        made = made & (group[:, None] == np.arange(levels.size))

    @cache
    def table(variable: str) -> NDArray:
        values = runs.cube[variable]
        values = values if "arch" in values.dims else values.expand_dims(arch=n_arch)
        values = values.transpose("arch", "record", "level", ...).values
        values = values.reshape(len(made), -1, *values.shape[3:])
        mask = made.reshape(made.shape + (1,) * (values.ndim - 2))
        kept = np.where(mask, values, _MISSING.get(variable, 0))
        return kept.astype(float if kept.dtype.kind == "f" else int)

    counts = count_verdicts(table("verdict"))
    brackets = runs.brackets
    return ArchResults(
        arch=runs.name,
        runs=runs,
        scale=scale,
        records=runs.whole["record"].values.astype(str).tolist() * n_arch,
        levels=levels,
        own_levels=own_levels,
        table=table,
        simulated=made,
        counts=counts,
        known=count_verdicts(runs.filled) if runs.gaps else counts,
        capacities=scale.factor
        * np.where(brackets.bracketed | runs.by_level, brackets.middle, brackets.upper),
    )


def _grouped(own: FloatArray, made: NDArray[np.bool_]) -> tuple[FloatArray, IntArray]:
    """Group neighbouring runs that have levels of their own.

    Return the level of each group and the group of each record, or -1.
    """
    run = np.flatnonzero(made & np.isfinite(own))
    order = run[np.argsort(own[run], kind="stable")]
    place = np.full(own.size, -1)
    groups = np.array_split(order, min(_MOST_GROUPS, max(1, order.size // 5)))
    for number, members in enumerate(groups):
        place[members] = number
    return np.array([np.exp(np.log(own[members]).mean()) for members in groups]), place


def write_papers(inputs: ReportInputs, folder: Path) -> None:
    """Write ``summary.json``, ``capacities.csv``, ``runs.csv`` and ``README.txt``.

    A README that archfrag did not write is left alone.
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
        about = {"title": "", "archfrag_study": ""} | cube.attrs
        write_text(
            path,
            f"{_HEAD} {__version__}: {about['title']} (study {about['archfrag_study']})\n"
            f"Intensities are {scale.label}.\n\n{_FILES}",
        )


def runs_in_words(
    cube: xr.Dataset, intensity: str, factor: float
) -> Iterator[pd.DataFrame]:
    """Yield the table of runs in pieces, with words for codes and units in column names.

    `intensity` is the name of the column of levels, which are those in SI times `factor`.
    """
    about, pieces = runs_table(cube)
    names = {}
    for name in RUN_COLUMNS:
        if name in about:
            unit = about[name].get("unit", "1")
            names[name] = name if unit == "1" else f"{name} [{unit}]"
    names["intensity"] = intensity
    for piece in pieces:
        levels = {si: _stated(si, factor) for si in piece["intensity"].unique()}
        own: Named = {"intensity": piece["intensity"].map(levels)}
        for name in names:
            codes = about[name].get("codes", {})
            words = {code: word.replace("_", " ") for word, code in codes.items()}
            if words:
                own[name] = piece[name].map(words)
            elif name.endswith("_joint"):
                own[name] = piece[name].where(piece[name] >= 0).astype("Int64")
        yield piece.assign(**own)[list(names)].rename(columns=names)


def _stated(si: float, factor: float) -> str:
    """Return an SI level times `factor` as text.

    It has 12 digits if they give the same level, else all digits.
    """
    short = f"{factor * si:.12g}"
    return short if float(short) * (1.0 / factor) == si else repr(float(factor * si))


def summary(inputs: ReportInputs) -> Named:
    """Return the content of ``summary.json``, which docs/reference/results.md lists."""
    cube = inputs.cube
    attributes = cube.attrs
    scale = inputs.scale
    of_runs = ["verdict", "lost_contact_time", "collapse_mode", "collapse_joint"]
    of_runs += [name for name in ("collapse_place", "collapse_part") if name in cube]
    tables = [
        cube[name].transpose("arch", "record", "level").values for name in of_runs
    ]
    arches = []
    for (name, of_class), *of_arch in zip(inputs.of_class.items(), *tables):
        start = inputs.arches.get(name)
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
            "dispersion": answer.dispersion,
        }
        for name, answer in inputs.classes.items()
    ]
    code: Named = {}
    if inputs.code is not None:
        rows = inputs.code_rows
        of_code = None if rows is None else rows.to_dict("records")
        code = {"code": {**inputs.code.model_dump(), "rows": of_code}}
    return finite(
        code
        | {
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


def _answered(inputs: ReportInputs, answer: Curve) -> Named:
    """Return what the summary says of the curve of an arch or a class, given in SI units.

    Without a curve, ``curve`` and ``probability`` are None, and ``reason`` says why.
    """
    factor = inputs.scale.factor
    at = inputs.at
    lost: Named | None = None
    if answer.n_undecided:
        medians = (factor * each.theta for each in answer.extremes)
        theta = dict(zip(("collapsed", "survived"), medians))
        lost = {"runs": answer.n_undecided, "theta_if": theta}
    found: Named = {
        "reason": answer.reason or None,
        "without_verdict": lost,
        "curve": None,
        "probability": None,
    }
    if not answer.fitted:
        return found
    likeliest = None
    most = answer.likelihood or Curve()
    if most.fitted:
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
    verdict: NDArray, lost: NDArray, mode: NDArray, joint: NDArray, *places: NDArray
) -> Named:
    """Return numbers of runs of an arch by verdict, and of its collapses the fractions.

    The fractions are by mode and by joint; of bridges by place and by part too.
    """
    number = count_verdicts(verdict)
    collapsed = verdict == Verdict.COLLAPSED
    counts = {name: int(number[name].sum()) for name in COUNTS}
    counts["not_run"] = verdict.size - counts["runs"]
    landed = (verdict == Verdict.SURVIVED) & np.isfinite(lost)
    counts["lost_contact_and_stand"] = int(landed.sum())
    named = {int(each): each.name.lower() for each in CollapseMode}
    modes = [named[code] for code in mode[collapsed].tolist()]
    mechanisms = {
        kind: {
            str(k): round(n / len(codes), 6) for k, n in sorted(Counter(codes).items())
        }
        for kind, codes in (
            ("mode", modes),
            *zip(_PLACED, (each[collapsed].tolist() for each in (joint, *places))),
        )
    }
    return {"counts": counts, "mechanisms": mechanisms}
