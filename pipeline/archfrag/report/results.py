"""What a cube holds of an arch in the units that people read, and how numbers are written."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from markupsafe import Markup, escape
from numpy.typing import NDArray

from archfrag.errors import InputError
from archfrag.fragility.brackets import find_brackets
from archfrag.fragility.counts import Verdict, VerdictCounts, count_verdicts
from archfrag.report.drawing import FloatArray
from archfrag.study.file.blocks import LEVEL_UNITS
from archfrag.study.runs import design_of

IntArray = NDArray[np.int64]
_MOST_GROUPS = 10
# Variables of runs that the report needs, and the values where no run was made, if not 0.
_INTEGERS = (
    "verdict", "status", "collapse_joint", "collapse_mode", "contact_losses", "fallbacks", "steps",
    "impacts", "events", "switches", "levels", "level_iterations", "general",
)  # fmt: skip
_NUMBERS = (
    "collapse_time", "lost_contact_time", "peak_displacement", "peak_rotation", "energy_error",
    "contact_residual", "end_time", "model_time",
)  # fmt: skip
_MISSING = {"verdict": Verdict.NOT_SIMULATED, "collapse_joint": -1}


@dataclass(frozen=True)
class Scale:
    """How an intensity measure is written: its name, the unit people read, SI to that unit."""

    measure: str
    unit: str
    factor: float

    @property
    def label(self) -> str:
        """Axis label."""
        return f"{self.measure} [{self.unit}]"

    def digits(self, value_si: float) -> str:
        """Value in the unit, three digits."""
        return digits(value_si * self.factor)

    def text(self, value_si: float) -> str:
        """Value with its unit, three digits."""
        return f"{self.digits(value_si)} {self.unit}"

    def interval(self, ends_si: Sequence[float]) -> str:
        """Two values with their unit."""
        return f"{self.digits(ends_si[0])} to {self.text(ends_si[1])}"


@dataclass(frozen=True)
class ArchResults:
    """All runs of one arch; arrays (n_record, n_level), `model_time` with an axis of models."""

    arch: str
    records: list[str]
    scale: Scale
    levels: FloatArray  #: (n_level,) in the reader's unit
    own_levels: FloatArray | None  #: (n_record,), where each run has one of its own
    models: list[str]
    tables: Mapping[str, NDArray]  #: variables of the cube in SI units, by name
    verdict: IntArray  #: codes of `Verdict`
    simulated: NDArray[np.bool_]  #: which runs there are
    counts: VerdictCounts  #: of runs at each level
    bisected: bool  #: whether the levels of each record were chosen to find its capacity
    known: VerdictCounts  #: of records, with what their capacities imply where bisected
    #: Of each record that was run, the middle of its bracket in logarithms: inf where it never
    #: collapsed, its lowest level where it collapsed there.
    capacities: FloatArray
    design: str  #: its kind
    design_text: str  #: and what it is

    def __getitem__(self, name: str) -> NDArray:
        return self.tables[name]


def reading_scale(cube: xr.Dataset, measure: str) -> Scale:
    """Unit in which the intensities of a cube are shown: the study's, or else g or as stored."""
    units = cube["intensity"].attrs.get("units")
    if not units:
        raise InputError("the cube's variable intensity has no attribute units")
    stored = {"m s-2": "m/s2", "m s-1": "m/s"}.get(units, units)
    allowed = LEVEL_UNITS.get(stored, {})
    intensity = study_config(cube).get("intensity", {})
    unit = intensity.get("unit") if intensity.get("measure") == measure else None
    if unit not in allowed:
        unit = "g" if "g" in allowed else stored
    return Scale(measure, unit, 1.0 / allowed.get(unit, 1.0))


def study_config(cube: xr.Dataset) -> Mapping[str, Any]:
    """What a cube holds of the study that made it; may be empty."""
    found: Mapping[str, Any] = json.loads(cube.attrs.get("archfrag_config", "{}"))
    return found


def arch_results(cube: xr.Dataset, arch: str, scale: Scale) -> ArchResults:
    """Everything the report needs of one arch of a cube."""
    needed = (*_INTEGERS, *_NUMBERS, "scale_factor", "intensity")
    missing = [name for name in needed if name not in cube]
    if missing:
        raise InputError(
            f"the cube lacks {', '.join(missing)}; is it of this version of archfrag?"
        )
    names = [str(name) for name in cube["arch"].values]
    if arch not in names:
        raise InputError(f"the cube holds no arch {arch!r}; it holds {', '.join(names)}")
    part = cube.isel(arch=names.index(arch)).transpose("record", "level", ...)
    run = part["verdict"].values != Verdict.NOT_SIMULATED
    levels, own, place = _levels(part, run, scale)
    if own is not None:
        run = run & (place[:, None] == np.arange(levels.size))

    tables = {}
    for name in needed[:-1]:
        values = part[name].values
        made = run.reshape(run.shape + (1,) * (values.ndim - 2))
        kept = np.where(made, values, _MISSING.get(name, 0))
        tables[name] = kept.astype(int if name in _INTEGERS else float)
    verdict, design = tables["verdict"], design_of(json.loads(cube.attrs["archfrag_design"]))
    counts, brackets = count_verdicts(verdict), find_brackets(verdict[run.any(axis=1)], levels)
    return ArchResults(
        arch=arch, records=[str(name) for name in cube["record"].values], scale=scale,
        levels=levels, own_levels=own, models=[str(name) for name in part["model"].values],
        tables=tables, verdict=verdict, simulated=run, counts=counts, bisected=design.adaptive,
        known=count_verdicts(brackets.filled) if design.adaptive else counts,
        capacities=np.where(brackets.bracketed, brackets.middle, brackets.upper),
        design=design.kind, design_text=design.text,
    )  # fmt: skip


def _levels(
    part: xr.Dataset, made: NDArray[np.bool_], scale: Scale
) -> tuple[FloatArray, FloatArray | None, IntArray]:
    """Levels in the reader's unit; the own level and the group of each record, if it has such.

    The group of a record that was not run is -1.
    """
    given = part["intensity"]
    if given.dims == ("level",):
        return given.values.astype(float) * scale.factor, None, np.empty(0, int)
    own = given.values[:, 0].astype(float) * scale.factor
    run = np.flatnonzero(made[:, 0] & np.isfinite(own))
    order = run[np.argsort(own[run], kind="stable")]
    groups = np.array_split(order, min(_MOST_GROUPS, max(1, order.size // 5)))
    place = np.full(own.size, -1)
    for number, members in enumerate(groups):
        place[members] = number
    levels = np.array([np.exp(np.log(own[members]).mean()) for members in groups])
    return levels, own, place


def digits(value: float) -> str:
    """A level with three digits, or all before the point: 0.500, 12.0, 1250."""
    return f"{value:.0f}" if 99.95 <= abs(value) < 1e6 else f"{value:#.3g}"


def onset_text(value: float) -> str:
    """Onset acceleration in g, or that there is none."""
    return f"{value:.4f} g" if np.isfinite(value) else "no limit"


def measured(value: float | str | None, form: str = "#.3g") -> str:
    """A number, with three digits by default, which may be null where it is not known."""
    number = np.nan if value is None else float(value)
    return format(number, form).removesuffix(".") if np.isfinite(number) else "–"


def to(ends: Sequence[float], form: str = ".2f") -> str:
    """An interval."""
    return f"{ends[0]:{form}} to {ends[1]:{form}}"


def together(words: str) -> str:
    """Words in parentheses that a line does not part."""
    return f"({words})".replace(" ", "\u00a0").replace("–", "\u2060–\u2060")


def chance(value: float) -> str:
    """A probability with two digits, three where it is small or large."""
    if not np.isfinite(value):
        return "–"
    if not 0.001 <= value <= 0.999:
        return "< 0.001" if value < 0.001 else "> 0.999"
    return f"{value:.2f}" if 0.1 <= value <= 0.9 else f"{value:.3f}"


def median_and_largest(values: FloatArray) -> str:
    """Of magnitudes, with a power of ten."""
    values = np.abs(values[np.isfinite(values)])
    if values.size == 0:
        return "not known"
    return f"{np.median(values):.1e}, {values.max():.1e}"


def short(value: Any) -> str:
    """A parameter of an arch; a long list shortened to its size."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list | tuple):
        flat = np.ravel(np.array(value, dtype=object))
        return f"{flat.size} values" if flat.size > 6 else ", ".join(map(short, flat))
    return f"{value:g}" if isinstance(value, float) else str(value)


def years(period: float) -> str:
    """Three digits, never as a power of ten."""
    if period > 1e9:
        return "more than 1e9"
    return f"{float(f'{period:.3g}'):,.{0 if period >= 100.0 else 1}f}"


def table(
    label: str, heads: Sequence[str], rows: Iterable[Sequence[object]], kind: str = "",
    numeric_from: int = 1,
) -> Markup:  # fmt: skip
    """A table that scrolls by itself on a narrow screen; columns of numbers are on the right.

    The first cell of each row is its head. Tables of the kind ``pairs`` hold a name and a value,
    written to the left.
    """
    first = 99 if kind.startswith("pairs") else numeric_from

    def cell(tag: str, place: int, content: object) -> str:
        number = Markup(' class="number"') if place >= first else ""
        return f"<{tag}{number}>{escape(content)}</{tag.split()[0]}>"

    head = "".join(cell('th scope="col"', i, each) for i, each in enumerate(heads))
    body = "".join(
        "<tr>"
        + "".join(cell("td" if i else 'th scope="row"', i, each) for i, each in enumerate(row))
        + "</tr>\n"
        for row in rows
    )
    return Markup(
        f'<div class="wide" role="group" aria-label="{escape(label)}, may be scrolled" '
        f'tabindex="0"><table class="{kind}" aria-label="{escape(label)}">\n'
        f"<thead><tr>{head}</tr></thead>\n<tbody>\n{body}</tbody></table></div>"
    )


def pairs(label: str, rows: Iterable[Sequence[object]], head: str = "figure") -> Markup:
    """A table of names and values."""
    return table(label, [head, "value"], rows, "pairs")
