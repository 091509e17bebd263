"""What a cube holds, as plain arrays in the units that people read."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from archfrag.errors import InputError
from archfrag.fragility.brackets import Brackets, fill_verdicts, find_brackets
from archfrag.fragility.counts import Verdict, VerdictCounts, count_verdicts
from archfrag.mechanics.status import CollapseMode
from archfrag.report.axes import digits
from archfrag.study.config import LEVEL_UNITS

if TYPE_CHECKING:
    import xarray as xr

NOT_SIMULATED = 4  # code of a cell that the study's design left out
_MOST_GROUPS = 10

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Field of `ArchResults`: variable of the cube, kind, and the value where no run was made.
_TABLES: dict[str, tuple[str, type, int]] = {
    "verdict": ("verdict", int, NOT_SIMULATED),
    "status": ("status", int, 0),
    "collapse_time": ("collapse_time", float, 0),
    "collapse_joint": ("collapse_joint", int, -1),
    "collapse_mode": ("collapse_mode", int, 0),
    "peak_displacement": ("peak_displacement", float, 0),
    "energy_error": ("energy_error", float, 0),
    "residual": ("contact_residual", float, 0),
    "fallbacks": ("fallbacks", int, 0),
    "steps": ("steps", int, 0),
    "impacts": ("impacts", int, 0),
    "events": ("events", int, 0),
    "switches": ("switches", int, 0),
    "two_level": ("levels", int, 0),
    "level_iterations": ("level_iterations", int, 0),
    "general": ("general", int, 0),
    "end_time": ("end_time", float, 0),
    "model_time": ("model_time", float, 0),
}
_OPTIONAL = {"lost_contact_time": float, "peak_rotation": float, "contact_losses": int}


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

    def text(self, value_si: float) -> str:
        """Value with its unit, three digits."""
        return f"{digits(value_si * self.factor)} {self.unit}"


@dataclass(frozen=True)
class ArchResults:
    """All runs of one arch; arrays (n_record, n_level) unless stated otherwise."""

    arch: str
    records: list[str]
    levels: FloatArray  # (n_level,) in the reader's unit
    scale: Scale
    verdict: IntArray
    counts: VerdictCounts
    collapse_time: FloatArray  # [s]
    collapse_joint: IntArray
    collapse_mode: IntArray
    peak_displacement: FloatArray  # [m]
    energy_error: FloatArray  # [1]
    residual: FloatArray  # [1]
    fallbacks: IntArray
    steps: IntArray
    impacts: IntArray  # joints that closed
    events: IntArray  # instants located at which the mechanism changed
    switches: IntArray  # to time stepping
    two_level: IntArray  # contact problems solved by the first and second level
    level_iterations: IntArray  # of these, with more than one round
    general: IntArray  # contact problems left to the general solver
    end_time: FloatArray  # [s]
    model_time: FloatArray  # (n_record, n_level, n_model) [s]
    models: list[str]
    factors: FloatArray  # on the motion
    status: IntArray
    peak_rotation: FloatArray | None = None  # [rad]; None in cubes without it
    lost_contact_time: FloatArray | None = None  # [s]; likewise
    contact_losses: IntArray | None = None  # times that a joint was without contact
    own_levels: FloatArray | None = None  # (n_record,), where each run has one of its own
    design: str = "stripes"

    @property
    def grouped(self) -> bool:
        """Whether each run has an intensity of its own; levels stand for groups of runs then."""
        return self.own_levels is not None

    @property
    def bisected(self) -> bool:
        """Whether the levels of each record were chosen to find its capacity."""
        return self.design in ("ida", "two_stage")

    @property
    def brackets(self) -> Brackets:
        """Between which levels the capacity of each record that was run lies."""
        return find_brackets(self.verdict[self.simulated.any(axis=1)], self.levels, "first")

    @property
    def known(self) -> VerdictCounts:
        """Counts of records at each level, with what their capacities imply where bisected."""
        if not self.bisected:
            return self.counts
        return _counted(fill_verdicts(self.verdict[self.simulated.any(axis=1)], "first"))

    @property
    def simulated(self) -> NDArray[np.bool_]:
        """Which runs there are; a design need not simulate every level."""
        return self.verdict != NOT_SIMULATED

    @property
    def decided_or_neither(self) -> IntArray:
        """Verdicts with what was not simulated as unfinished, which counts as neither."""
        return np.where(self.simulated, self.verdict, int(Verdict.UNFINISHED))

    @property
    def level_texts(self) -> list[str]:
        """Levels with their unit."""
        return [f"{digits(level)} {self.scale.unit}" for level in self.levels]

    @property
    def stood_after_loss(self) -> int | None:
        """Runs that lost all contact at a joint and stand; None if the cube does not hold it."""
        if self.lost_contact_time is None:
            return None
        stands = self.verdict == Verdict.STANDING
        return int((stands & np.isfinite(self.lost_contact_time)).sum())

    @property
    def resurrections(self) -> int:
        """Records that collapse at a level and stand at a higher one."""
        collapsed = self.verdict == Verdict.COLLAPSED
        below = np.cumsum(collapsed, axis=1) > 0
        return int(np.any(below & (self.verdict == Verdict.STANDING), axis=1).sum())

    def collapses_by_joint(self, n_joint: int) -> IntArray:
        """Collapses by joint, mode and level, (n_joint, n_mode, n_level)."""
        table = np.zeros((n_joint, len(CollapseMode), self.levels.size), dtype=np.int64)
        record, level = np.nonzero(self.verdict == Verdict.COLLAPSED)
        joint = self.collapse_joint[record, level]
        mode = self.collapse_mode[record, level]
        known = (joint >= 0) & (joint < n_joint)
        np.add.at(table, (joint[known], mode[known], level[known]), 1)
        return table


def reading_scale(cube: "xr.Dataset", measure: str) -> Scale:
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


def study_config(cube: "xr.Dataset") -> Mapping[str, Any]:
    """What a cube holds of the study that made it; may be empty."""
    found: Mapping[str, Any] = json.loads(cube.attrs.get("archfrag_config", "{}"))
    return found


def arch_results(cube: "xr.Dataset", arch: str, scale: Scale) -> ArchResults:
    """Everything the report needs of one arch of a cube."""
    needed = [variable for variable, _, _ in _TABLES.values()]
    missing = [name for name in (*needed, "scale_factor", "intensity") if name not in cube]
    if missing:
        raise InputError(
            f"the cube lacks {', '.join(missing)}; is it of this version of archfrag?"
        )
    names = [str(name) for name in cube["arch"].values]
    if arch not in names:
        raise InputError(f"the cube holds no arch {arch!r}; it holds {', '.join(names)}")
    part = cube.isel(arch=names.index(arch))
    levels, own, place = _levels(part, scale)

    run = part["verdict"].transpose("record", "level").values != NOT_SIMULATED

    def table(name: str, kind: type, missing: int = 0) -> NDArray:
        """Values of the runs, and `missing` where there is none."""
        values: NDArray = part[name].transpose("record", "level", ...).values
        values = np.where(run.reshape(run.shape + (1,) * (values.ndim - 2)), values, missing)
        return (values if place is None else _placed(values, place, levels.size)).astype(kind)

    tables = {field: table(*given) for field, given in _TABLES.items()}
    verdict = tables["verdict"]
    if place is not None:
        verdict[place[:, None] != np.arange(levels.size)] = NOT_SIMULATED
    factors = part["scale_factor"].transpose("record", "level").values
    return ArchResults(
        arch=arch,
        records=[str(name) for name in cube["record"].values],
        levels=levels,
        scale=scale,
        counts=_counted(verdict),
        models=[str(name) for name in part["model"].values],
        factors=factors if place is None else _placed(factors, place, levels.size),
        own_levels=own,
        design=str(cube.attrs.get("archfrag_design_kind", "stripes")),
        **tables,
        **{name: table(name, kind) for name, kind in _OPTIONAL.items() if name in part},
    )


def _levels(
    part: "xr.Dataset", scale: Scale
) -> tuple[FloatArray, FloatArray | None, IntArray | None]:
    """Levels in the reader's unit; the own level and the group of each record, if it has such.

    The group of a record that was not run is -1.
    """
    given = part["intensity"]
    if given.dims == ("level",):
        return given.values.astype(float) * scale.factor, None, None
    own = given.transpose("record", "level").values[:, 0].astype(float) * scale.factor
    verdict = part["verdict"].transpose("record", "level").values[:, 0]
    run = np.flatnonzero((verdict != NOT_SIMULATED) & np.isfinite(own))
    order = run[np.argsort(own[run], kind="stable")]
    groups = np.array_split(order, min(_MOST_GROUPS, max(1, order.size // 5)))
    place = np.full(own.size, -1)
    for number, members in enumerate(groups):
        place[members] = number
    levels = np.array([np.exp(np.log(own[members]).mean()) for members in groups])
    return levels, own, place


def _placed(values: NDArray, place: IntArray, n_level: int) -> NDArray:
    """Values (n_record, 1, ...) put into the columns of their groups, zero elsewhere."""
    wide = np.zeros((values.shape[0], n_level, *values.shape[2:]), dtype=values.dtype)
    run = np.flatnonzero(place >= 0)
    wide[run, place[run]] = values[run, 0]
    return wide


def _counted(verdict: IntArray) -> VerdictCounts:
    """Counts of the runs that there are."""
    absent = verdict == NOT_SIMULATED
    counts = count_verdicts(np.where(absent, int(Verdict.STANDING), verdict))
    return replace(counts, standing=counts.standing - absent.sum(axis=0))
