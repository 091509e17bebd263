"""What a cube holds, as plain arrays in the units that people read."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from archfrag.errors import InputError
from archfrag.fragility.brackets import Brackets, fill_verdicts, find_brackets
from archfrag.fragility.counts import Verdict, VerdictCounts, count_verdicts
from archfrag.report.picture import FloatArray, digits
from archfrag.study.config import LEVEL_UNITS

if TYPE_CHECKING:
    import xarray as xr

_MOST_GROUPS = 10

IntArray = NDArray[np.int64]

# Variables of runs that the report needs: their kind, and the value where no run was made.
_TABLES: dict[str, tuple[type, int]] = {
    "verdict": (int, Verdict.NOT_SIMULATED), "status": (int, 0), "collapse_time": (float, 0),
    "collapse_joint": (int, -1), "collapse_mode": (int, 0), "lost_contact_time": (float, 0),
    "contact_losses": (int, 0), "peak_displacement": (float, 0), "peak_rotation": (float, 0),
    "energy_error": (float, 0), "contact_residual": (float, 0), "fallbacks": (int, 0),
    "steps": (int, 0), "impacts": (int, 0), "events": (int, 0), "switches": (int, 0),
    "levels": (int, 0), "level_iterations": (int, 0), "general": (int, 0),
    "end_time": (float, 0), "model_time": (float, 0),
}  # fmt: skip


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


@dataclass(frozen=True)
class ArchResults:
    """All runs of one arch; arrays (n_record, n_level), `model_time` with an axis of models."""

    arch: str
    records: list[str]
    levels: FloatArray  #: (n_level,) in the reader's unit
    scale: Scale
    models: list[str]
    factors: FloatArray  #: on the motion
    tables: Mapping[str, NDArray]  #: variables of the cube in SI units, by name
    own_levels: FloatArray | None  #: (n_record,), where each run has one of its own
    design: str

    def __getitem__(self, name: str) -> NDArray:
        return self.tables[name]

    @property
    def verdict(self) -> IntArray:
        """Codes of `Verdict`."""
        return self["verdict"]

    @property
    def counts(self) -> VerdictCounts:
        """Runs at each level."""
        return count_verdicts(self.verdict)

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
        return find_brackets(self.verdict[self.simulated.any(axis=1)], self.levels)

    @property
    def known(self) -> VerdictCounts:
        """Counts of records at each level, with what their capacities imply where bisected."""
        if not self.bisected:
            return self.counts
        return count_verdicts(fill_verdicts(self.verdict[self.simulated.any(axis=1)]))

    @property
    def simulated(self) -> NDArray[np.bool_]:
        """Which runs there are; a design need not simulate every level."""
        return self.verdict != Verdict.NOT_SIMULATED

    @property
    def failed(self) -> NDArray[np.bool_]:
        """Runs that the solver could not finish."""
        return self.verdict == Verdict.SOLVER_FAILURE

    @property
    def sound(self) -> NDArray[np.bool_]:
        """Runs that the solver finished."""
        return self.simulated & ~self.failed

    @property
    def displaced(self) -> NDArray[np.bool_]:
        """Runs that the solver finished in which a voussoir is displaced by 0.1 mm or more."""
        return self.sound & (self["peak_displacement"] >= 1e-4)

    @property
    def lost_contact(self) -> NDArray[np.bool_]:
        """Runs that lost all contact at a joint by more than a noted gap."""
        return self.simulated & np.isfinite(self["lost_contact_time"])

    @property
    def stood_after_loss(self) -> int:
        """Runs that lost all contact at a joint and stand."""
        return int(((self.verdict == Verdict.STANDING) & self.lost_contact).sum())

    @property
    def resurrections(self) -> int:
        """Records that collapse at a level and stand at a higher one."""
        below = np.cumsum(self.verdict == Verdict.COLLAPSED, axis=1) > 0
        return int(np.any(below & (self.verdict == Verdict.STANDING), axis=1).sum())

    def level_text(self, level: int) -> str:
        """A level with its unit."""
        return f"{digits(self.levels[level])} {self.scale.unit}"


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
    missing = [name for name in (*_TABLES, "scale_factor", "intensity") if name not in cube]
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

    def table(name: str, kind: type, missing: int) -> NDArray:
        """Values of the runs, and `missing` where there is none."""
        values: NDArray = part[name].values
        made = run.reshape(run.shape + (1,) * (values.ndim - 2))
        return np.where(made, values, missing).astype(kind)

    return ArchResults(
        arch=arch,
        records=[str(name) for name in cube["record"].values],
        levels=levels,
        scale=scale,
        models=[str(name) for name in part["model"].values],
        factors=table("scale_factor", float, 0),
        tables={name: table(name, *given) for name, given in _TABLES.items()},
        own_levels=own,
        design=str(cube.attrs.get("archfrag_design_kind", "stripes")),
    )


def _levels(
    part: "xr.Dataset", made: NDArray[np.bool_], scale: Scale
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
