"""The result of one run: what the arch did, how it was computed, and how accurately."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from archfrag.mechanics.status import CollapseMode, Count, Energy, Loss, Model, Peak, Status
from archfrag.mechanics.types import Results
from archfrag.simulation.mechanism import MechanismChange

if TYPE_CHECKING:
    import xarray

_EVENTS = {
    "impacts": Count.IMPACTS, "openings": Count.OPENINGS, "slides": Count.SLIDES,
    "contact_losses": Count.LOSSES, "rests": Count.RESTS, "events": Count.EVENTS,
    "switches": Count.SWITCHES,
}  # fmt: skip
_WORK = (
    Count.STEPS, Count.ITERATIONS, Count.PATHS, Count.COMPLIANT, Count.SHORTENED, Count.LEVELS,
    Count.LEVEL_ITERATIONS, Count.GENERAL, Count.SWEEPS, Count.UNCONVERGED, Count.REFUSED,
    Count.REFINED,
)  # fmt: skip
_COLLAPSE_MODES = [mode.name.lower() for mode in CollapseMode]
_COLLAPSED = {Status.STANDING: False, Status.COLLAPSED: True}
_ENERGY = {
    "kinetic": Energy.KINETIC, "potential": Energy.POTENTIAL, "ground": Energy.GROUND,
    "friction": Energy.FRICTION, "impacts": Energy.IMPACT,
    "balance_error": Energy.BALANCE_ERROR, "largest_kinetic": Energy.LARGEST_KINETIC,
}  # fmt: skip


@dataclass(frozen=True)
class Response:
    """Result of one arch under one ground motion.

    Attributes
    ----------
    status : Status
        How the run ended; `archfrag.errors.STATUS_MESSAGE` has its text.
    collapsed : bool or None
        None if the run was unfinished or the solver failed: neither collapse nor survival.
    collapse_time : float
        Instant at which the joint lost contact for good [s]; nan if none. If a joint collapsed
        with contact kept, the instant of the verdict.
    collapse_joint : int
        -1 if none.
    collapse_mode : str
        "hinging" or "sliding" if the rotation [rad] of that joint, or its slip over its length,
        was larger when it lost contact; "lift_off" if it had neither; "overturning" if a joint
        rotated by 90 degrees with contact kept; else "none".
    lost_contact_time, lost_contact_joint, lost_contact_mode
        The same for the first loss of contact that opened a joint at both corners by more than 2 %
        of its length, regained or not: nan, -1 and "none" where there was none.
    widest_gap : float
        Largest gap at both corners of a joint at once, over its length [1].
    peak_rotation : float
        Of any voussoir [rad].
    peak_displacement : float
        Of any voussoir's centroid, relative to the ground [m].
    residual_rotation, residual_displacement : float
        Largest rotation [rad] and displacement [m] at the end of the run.
    events : dict of str to int
        "impacts" (joints that closed), "openings", "slides", "contact_losses" and "rests";
        "events": instants located at which the mechanism changed; "switches": times that
        event-driven integration switched to time stepping.
    model_time : dict of str to float
        Simulated time in each model [s]: "rest", "four_hinges", "mega_voussoirs",
        "all_voussoirs".
    energy_error : float
        Largest energy gained or lost that no contact law explains, over the largest kinetic
        energy [1].
    energy : dict of str to float
        Kinetic and potential energy at the end, work of the ground, of friction and of impacts,
        and the remainder ("balance_error") [J].
    work : dict of str to int
        Counts of what was computed: "steps"; "iterations", linear contact problems on all
        voussoirs (of quadratic_programme: iterations of its solver); "paths", contact problems
        that needed the path following behind the Newton iteration; "compliant", those solved
        with slightly compliant joints only; "shortened", steps
        halved; "levels", contact problems solved by the first and second level;
        "level_iterations", those of them that needed more than one round; "general", those that
        the levels left to the general solver; "sweeps", passes of gauss_seidel over all
        contacts; "unconverged", steps that a baseline took though its solver had not met its
        tolerance; "refused", states that would have had to be moved to bear as they should;
        "refined", times that auto made a run again: with a tighter tolerance, then by steps alone.
    wall_time : float
        Time it took, compilation included if there was any [s].
    end_time : float
        Simulated time at which the run ended [s].
    residual : float
        Largest measured violation of the contact laws, by one measure for all methods
        (`archfrag.mechanics.residual.state_residual`): gaps over joint lengths, slip
        rates over the speed of a fall through them, forces over the weight [1].
    overlap : float
        Deepest overlap of two bodies at a corner that was seen, over the joint's
        length [1].
    method : str
        Its name.
    mechanism : tuple of MechanismChange or None
        With a history only: every change of the mechanism, up to a bound of 50,000; ``print``
        one to read it, ``pandas.DataFrame(response.mechanism)`` for a table.
    history : xarray.Dataset or None
    steps, fallbacks : int
        As in `work`; fallbacks are its "compliant".
    """

    status: Status
    collapsed: bool | None
    collapse_time: float
    collapse_joint: int
    collapse_mode: str
    lost_contact_time: float
    lost_contact_joint: int
    lost_contact_mode: str
    widest_gap: float
    peak_rotation: float
    peak_displacement: float
    residual_rotation: float
    residual_displacement: float
    events: dict[str, int]
    model_time: dict[str, float]
    energy_error: float
    energy: dict[str, float]
    work: dict[str, int]
    wall_time: float
    end_time: float
    residual: float
    overlap: float
    method: str
    mechanism: tuple[MechanismChange, ...] | None = field(default=None, repr=False)
    history: xarray.Dataset | None = field(default=None, repr=False)

    @property
    def steps(self) -> int:
        """Integration steps."""
        return self.work["steps"]

    @property
    def fallbacks(self) -> int:
        """Contact problems solved with compliant joints only."""
        return self.work["compliant"]


def response_of(
    results: Results,
    row: int,
    method: str,
    wall_time: float,
    mechanism: tuple[MechanismChange, ...] | None = None,
    history: xarray.Dataset | None = None,
) -> Response:
    """What a method returned of one run, in names; mechanism and history as in `Response`."""
    status = Status(int(results.status[row]))
    count, energy, model_time, peak, loss = (
        values[row].tolist()
        for values in (
            results.count, results.energy, results.model_time, results.peak, results.loss
        )
    )  # fmt: skip
    largest = energy[Energy.LARGEST_KINETIC]
    return Response(
        status=status,
        collapsed=_COLLAPSED.get(status),
        collapse_time=float(results.collapse_time[row]),
        collapse_joint=int(results.collapse_joint[row]),
        collapse_mode=_COLLAPSE_MODES[results.collapse_mode[row]],
        lost_contact_time=loss[Loss.TIME],
        lost_contact_joint=int(loss[Loss.JOINT]),
        lost_contact_mode=_COLLAPSE_MODES[int(loss[Loss.MODE])],
        widest_gap=loss[Loss.WIDEST],
        peak_rotation=peak[Peak.ROTATION],
        peak_displacement=peak[Peak.DISPLACEMENT],
        residual_rotation=peak[Peak.END_ROTATION],
        residual_displacement=peak[Peak.END_DISPLACEMENT],
        events={name: int(count[entry]) for name, entry in _EVENTS.items()},
        model_time={model.name.lower(): model_time[model] for model in Model},
        energy_error=energy[Energy.BALANCE_ERROR_PEAK] / largest if largest > 0.0 else 0.0,
        energy={name: energy[entry] for name, entry in _ENERGY.items()},
        work={entry.name.lower(): int(count[entry]) for entry in _WORK},
        wall_time=wall_time,
        end_time=float(results.end_time[row]),
        residual=peak[Peak.RESIDUAL],
        overlap=peak[Peak.OVERLAP],
        method=method,
        mechanism=mechanism,
        history=history,
    )
