"""What is kept of each run: one table of columns for parts and cube alike."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from archfrag.fragility.counts import Verdict
from archfrag.mechanics.status import CollapseMode, Count, Energy, Loss, Model, Peak, Status

if TYPE_CHECKING:
    from archfrag.arch import Arch
    from archfrag.mechanics.types import Results
    from archfrag.motions.motion import Motion
    from archfrag.simulate import Response


@dataclass(frozen=True)
class Column:
    """One value of each run."""

    name: str
    dtype: str  # as in the cube
    units: str  # empty for a code
    long_name: str
    fill: float | None = None  # what stands where a run has no such value
    flags: Sequence[tuple[int, str]] = ()  # codes with their meanings
    comment: str = ""
    held: tuple[str, int] | None = None  # array of the kernels' results, and the entry there

    @property
    def missing(self) -> float:
        """What stands in a cell that was not simulated: a code of its own, -1 or nan."""
        if self.name == "verdict":
            return Verdict.NOT_SIMULATED
        if self.flags and self.flags[0][1] == "none":
            return 0
        return np.nan if self.dtype.startswith("f") else -1


def _flags(kind: Any) -> tuple[tuple[int, str], ...]:
    return tuple((int(member), member.name.lower()) for member in kind)


def _counted(name: str, entry: int, long_name: str) -> Column:
    return Column(name, "i8", "1", long_name, held=("count", entry))


def _peak(name: str, units: str, entry: int, long_name: str, comment: str = "") -> Column:
    return Column(name, "f8", units, long_name, comment=comment, held=("peak", entry))


_MODES = _flags(CollapseMode)
COLUMNS = (
    Column(
        "verdict", "i1", "", "outcome of the run: collapse or not", flags=_flags(Verdict),
        comment="Unfinished runs and solver failures count neither as collapse nor as survival.",
    ),
    Column(
        "status", "i1", "", "how the run ended", flags=((-1, "not_simulated"), *_flags(Status))
    ),
    Column(
        "collapse_time", "f8", "s", "time at which a joint lost its contact for good", np.nan,
        comment="From the first sample of the record.",
    ),
    Column(
        "collapse_joint", "i4", "1", "number of the joint that lost its contact",
        comment="Joints are counted from 0 at the first springing; -1 where none was lost.",
    ),
    Column("collapse_mode", "i1", "", "how the lost joint was moving", flags=_MODES),
    Column(
        "lost_contact_time", "f8", "s",
        "time of the first loss of contact at a joint, regained or not", np.nan,
        comment="Losses that open a joint at both corners by more than 2 % of its length.",
        held=("loss", Loss.TIME),
    ),
    Column(
        "lost_contact_joint", "i4", "1", "number of the joint that lost contact first",
        comment="-1 where none did.", held=("loss", Loss.JOINT),
    ),
    Column(
        "lost_contact_mode", "i1", "", "how that joint was moving", flags=_MODES,
        held=("loss", Loss.MODE),
    ),
    Column(
        "widest_gap", "f8", "1", "largest gap at both corners of a joint at once, over its length",
        held=("loss", Loss.WIDEST),
    ),
    _peak("peak_rotation", "rad", Peak.ROTATION, "largest rotation of a voussoir"),
    _peak("peak_displacement", "m", Peak.DISPLACEMENT,
          "largest displacement of a voussoir's centroid relative to the ground"),
    _peak("residual_rotation", "rad", Peak.END_ROTATION,
          "largest rotation of a voussoir at the end"),
    _peak("residual_displacement", "m", Peak.END_DISPLACEMENT,
          "largest displacement of a voussoir's centroid relative to the ground at the end"),
    Column(
        "energy_error", "f8", "1",
        "energy made or lost by the integrator, over the largest kinetic energy",
    ),
    Column("end_time", "f8", "s", "simulated time at which the run ended"),
    _counted("steps", Count.STEPS, "number of integration steps"),
    _counted("impacts", Count.IMPACTS, "number of joints that closed"),
    _counted("openings", Count.OPENINGS, "number of joints that opened"),
    _counted("slides", Count.SLIDES, "number of times that a joint began to slide"),
    _counted("contact_losses", Count.LOSSES, "number of times that a joint was without contact"),
    _counted("rests", Count.RESTS, "number of times that the chain came to rest"),
    _counted("events", Count.EVENTS, "number of instants located at which the mechanism changed"),
    _counted("switches", Count.SWITCHES,
             "number of switches from event-driven integration to time stepping"),
    _counted("levels", Count.LEVELS,
             "number of contact problems solved by the first and second level"),
    _counted("level_iterations", Count.LEVEL_ITERATIONS,
             "number of contact problems of the two levels that needed more than one round"),
    _counted("general", Count.GENERAL,
             "number of contact problems that the levels left to the general solver"),
    _peak("contact_residual", "1", Peak.RESIDUAL,
          "largest violation of the contact laws that was measured, by one measure for all "
          "methods",
          "Gaps over joint lengths, slip rates over sqrt(gravity x length), forces over the "
          "weight or the largest reaction."),
    _peak("overlap", "1", Peak.OVERLAP,
          "deepest overlap of two voussoirs at a corner that was seen, over the joint's length"),
    _counted("refined", Count.REFINED,
             "times that auto made the run again with a tighter tolerance"),
    _counted("fallbacks", Count.COMPLIANT, "number of contact problems left to the fallback"),
)  # fmt: skip


_OWN = ("status", "collapse_time", "collapse_joint", "collapse_mode", "end_time")


def columns_of(results: "Results") -> dict[str, NDArray]:
    """Columns of runs by name, each (n_run,), and `model_time` (n_run, n_model) [s]."""
    energy = results.energy
    largest = energy[:, Energy.LARGEST_KINETIC]
    values: dict[str, NDArray] = {
        # Verdicts are the first codes of status; what comes after are failures of the solver.
        "verdict": np.minimum(results.status, Verdict.SOLVER_FAILURE),
        "energy_error": np.divide(
            energy[:, Energy.BALANCE_ERROR_PEAK], largest, out=np.zeros(len(largest)),
            where=largest > 0.0,
        ),
        **{name: getattr(results, name) for name in _OWN},
        **{c.name: getattr(results, c.held[0])[:, c.held[1]] for c in COLUMNS if c.held},
        "model_time": results.model_time[:, list(Model)],
    }  # fmt: skip
    return values


def simulate_case(
    method: Mapping[str, Any], arch: "Arch", motion: "Motion", factor: float, history: bool = False
) -> "Response":
    """One run by a study's method as plan and cube store it; `factor` is on the vertical too."""
    from archfrag.simulate import simulate

    arguments = {key: value for key, value in method.items() if key != "name"}
    return simulate(
        arch, motion, scale=factor, method=method["name"], history=history, **arguments
    )


def tabulate_cases(
    method: Mapping[str, Any], arch: "Arch", motions: Sequence["Motion"], factors: Sequence[float]
) -> dict[str, NDArray]:
    """As `simulate_case` for several runs of one arch: `columns_of` and `wall_time` [s]."""
    from archfrag.simulate import results_of_runs

    arguments = {key: value for key, value in method.items() if key != "name"}
    results, wall_time = results_of_runs(
        arch, motions, factors, method=method["name"], **arguments
    )
    return columns_of(results) | {"wall_time": wall_time}
