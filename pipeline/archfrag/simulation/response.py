"""The result of one run: what the arch did, how it was computed, its history and mechanism."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from archfrag.arch import STANDARD_GRAVITY, Arch
from archfrag.errors import InputError
from archfrag.files import Named
from archfrag.physics.contact.laws import CLOSED_STICK
from archfrag.physics.interface import Frames, MechanismLog, Outcomes
from archfrag.physics.status import (
    Cause,
    CollapseMode,
    Count,
    Energy,
    Level,
    Loss,
    Peak,
    Status,
)

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes

    from archfrag.motions.motion import Motion
    from archfrag.plots import Film

STATUS_MESSAGE = {
    Status.STANDING: "the arch came to rest with contact kept or regained at every joint, or "
    "sways calmly on its ties",
    Status.COLLAPSED: "a joint lost all contact for good (Signorini loss)",
    Status.UNFINISHED: "the arch was still moving at the end of the follow-on time; raise "
    "`follow`",
    Status.NO_CONTACT_SOLUTION: "no admissible set of reactions was found in a step; try a "
    "smaller `dt`, and please report the case",
    Status.DOES_NOT_STAND: "the arch does not stand under its own weight; make it thicker or "
    "raise the friction",
    Status.NOT_FINITE: "a position or velocity stopped being finite; try a smaller `dt`",
    Status.WORK_BOUND: "the run needed more steps than its length allows; try a larger `rtol` "
    "or another `method`",
    Status.NOT_APPLICABLE: "the method has no model for this mechanism or this initial state; "
    "use `auto`",
    Status.INACCURATE: "energy balance or overlap missed the tolerance; try a smaller `rtol`, "
    "and please report the case",
}
_EVENTS = {
    "impacts": Count.IMPACTS,
    "openings": Count.OPENINGS,
    "slides": Count.SLIDES,
    "contact_losses": Count.LOSSES,
    "rests": Count.RESTS,
    "events": Count.EVENTS,
    "switches": Count.SWITCHES,
}
_NO_WORK = {*_EVENTS.values(), Count.FRAMES, Count.LOG_ENTRIES}
_COLLAPSED = {Status.STANDING: False, Status.COLLAPSED: True}
# Units of what is in a response, by the last word of its name.
UNITS = {"time": "s", "rotation": "rad", "displacement": "m", "energy": "J"}
_ENERGY = {
    "kinetic": Energy.KINETIC,
    "potential": Energy.POTENTIAL,
    "ground": Energy.GROUND,
    "friction": Energy.FRICTION,
    "impacts": Energy.IMPACT,
    "balance_error": Energy.BALANCE_ERROR,
    "largest_kinetic": Energy.LARGEST_KINETIC,
}

CAUSE_WORDS = {
    "start": "start",
    "hinge": "new hinge",
    "slide": "sliding starts",
    "stick": "sliding ends",
    "impact": "impact",
    "loss": "contact lost",
    "close": "hinge closes",
    "rest": "comes to rest",
    "accumulation": "events accumulate",
    "unsolved": "laws not met on mega-voussoirs",
    "quiescent": "taken back from time stepping",
    "end": "end of the run",
    "tie": "a tie changes",
}
MODEL_WORDS = {
    "rest": "rest",
    "four_hinges": "four hinges",
    "mega_voussoirs": "mega-voussoirs",
    "all_voussoirs": "all voussoirs",
}


@dataclass(frozen=True)
class MechanismChange:
    """One change of the mechanism, and the mechanism after it.

    Attributes
    ----------
    time, until : float
        From when to when this mechanism holds [s]. `until` is nan if changes that followed were
        too many to be kept.
    cause, model : str
        Why it changed, and the model from then on: names of `archfrag.physics.status.Cause` and
        `archfrag.physics.status.Level` in lower case.
    joint : int
        Joint that caused it; -1 where none did.
    joints : dict of int to str
        What each joint does that is not closed and sticking: "hinge intrados", "slides towards
        extrados", "hinge extrados sliding towards intrados", or "open". A joint slides towards
        the side to which the voussoir after it moves on the one before it.
    places : sequence of str
        Names of all joints of a bridge, by number; empty of a single ring.

    Examples
    --------
    >>> from archfrag.simulation.response import MechanismChange
    >>> joints = {0: "hinge extrados", 3: "hinge intrados", 5: "slides towards intrados"}
    >>> print(MechanismChange(0.412, 0.5, "impact", 4, "mega_voussoirs", joints))
    0.4120 s  impact at joint 4: hinges 0 extrados, 3 intrados; slides 5 towards intrados; \
mega-voussoirs
    """

    time: float
    until: float
    cause: str
    joint: int
    model: str
    joints: dict[int, str]
    places: Sequence[str] = field(default=(), repr=False, compare=False)

    def __str__(self) -> str:
        parts = []
        for verb, name in (("hinge", "hinges"), ("slides", "slides"), ("open", "open")):
            members = [
                f"{self._name(joint, '')}{text.removeprefix(verb)}"
                for joint, text in self.joints.items()
                if text.startswith(verb)
            ]
            if members:
                parts.append(f"{name} {', '.join(members)}")
        parts = parts or ["all joints closed"]
        parts.append(MODEL_WORDS[self.model])
        where = f" at {self._name(self.joint)}" if self.joint >= 0 else ""
        return (
            f"{self.time:.4f} s  {CAUSE_WORDS[self.cause]}{where}: {'; '.join(parts)}"
        )

    def _name(self, joint: int, noun: str = "joint ") -> str:
        return self.places[joint].replace(",", "") if self.places else f"{noun}{joint}"


@dataclass(frozen=True, repr=False)
class Response:
    """Result of one arch under one ground motion.

    Attributes
    ----------
    status : Status
        How the run ended; `archfrag.simulation.response.STATUS_MESSAGE` has its text.
    collapsed : bool or None
        None if the run was unfinished or the solver failed: neither collapse nor survival.
    collapse_time, collapse_joint, collapse_mode
        Time [s] and joint of the loss of contact for good, else nan and -1 (`collapse_place` names
        it). "hinging" if rotation [rad] exceeded slip over length, else "sliding"; "none" etc.
    lost_contact_time, lost_contact_joint, lost_contact_mode
        The same of the first gap at both corners over 2 % of the length; `lost_contact_place`.
    peak_rotation, peak_displacement, residual_rotation, residual_displacement : float
        Largest rotation of a voussoir [rad] and displacement of its centroid relative to the
        ground [m], in the whole run (peak) and at its end (residual).
    events, work : dict of str to int
        Numbers of events and of operations by name, see `archfrag.physics.status.Count`.
    model_time, end_time, wall_time : dict of str to float, float, float
        Simulated time in each model, simulated time in all, and computing time [s].
    energy, energy_error : dict of str to float, float
        Parts of the energy balance [J]; energy that no contact law explains, over the largest
        kinetic energy [1], 0 where both are rounding.
    widest_gap, overlap, residual : float
        Largest gap at both corners of a joint at once and deepest overlap, over its length;
        largest violation of the contact laws [1].
    mechanism : tuple of MechanismChange or None
        With a history: every change of the mechanism, up to 50,000; ``print`` one to read it.
    history : xarray.Dataset or None
    method, arch, motion, scale
        What was simulated, and how.

    Examples
    --------
    >>> import numpy as np, archfrag as af
    >>> pulse = af.Motion(np.full(100, 3.0), dt=0.01)
    >>> af.simulate(af.Block(width=0.2, height=1.0, friction=0.8), pulse)
    <Response collapsed at 0.7328 s, joint 0, hinging; peak 1.28 rad, 0.766 m; auto, 0.9127 s>
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
    mechanism: tuple[MechanismChange, ...] | None = None
    history: xarray.Dataset | None = None
    arch: Arch | None = field(default=None, compare=False)
    motion: Motion | None = field(default=None, compare=False)
    scale: float = field(default=1.0, compare=False)

    steps = property(lambda self: self.work["steps"])
    fallbacks = property(lambda self: self.work["compliant"])
    collapse_place = property(lambda self: self._place(self.collapse_joint))
    lost_contact_place = property(lambda self: self._place(self.lost_contact_joint))

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the rotation of each voussoir over time, in `ax` or in new axes.

        InputError if the response has no history.
        """
        from archfrag.plots import plot_response

        return plot_response(self, ax)

    def animate(self, seconds: float = 8.0, speed: float = 1.0) -> Film:
        """Make a film of the run, above the acceleration of the ground.

        It shows at most `seconds` of the run, with its collapse or its largest rotation, `speed`
        times as fast. A notebook plays it; ``save("fall.gif")`` keeps it, and so does
        ``save("fall.mp4")`` where ffmpeg is installed. InputError if there is no history.
        """
        from archfrag.plots import animate

        return animate(self, seconds, speed)

    def _place(self, joint: int) -> str:
        if joint < 0:
            return ""
        return f"joint {joint}" if self.arch is None else self.arch.place(joint)

    def _arrays(self) -> tuple[NDArray, NDArray, NDArray]:
        """Return times, displacements and rotations of the history; InputError without one.

        Shapes are (n_time,) [s], (n_time, n_voussoir, 2) [m] and (n_time, n_voussoir) [rad].
        """
        if self.history is None:
            raise InputError("the response has no history; simulate with history=True")
        kept = self.history
        time, shift, turn = kept.time, kept.displacement, kept.rotation
        return time.values, shift.values, turn.values

    def _window(self, seconds: float) -> tuple[float, float]:
        """Return the first and the last time of the run that a film shows [s].

        They are `seconds` apart at most. The film ends with the collapse; if there is none, it
        shows the largest rotation. If nothing moves, both times are equal.
        """
        assert self.arch is not None
        time, shift, turn = self._arrays()
        size = self.arch.extent.max()
        turned = np.abs(turn).max(axis=1)
        reach = np.maximum(np.abs(shift).max(axis=(1, 2)), 0.1 * size * turned)
        moving = np.flatnonzero(reach > 1e-5 * size)
        times = time.tolist()
        if moving.size < 2:
            return times[0], times[0]
        first = times[max(moving[0] - 1, 0)]
        last = times[moving[-1]]
        peak = times[turned.argmax()]
        if self.collapsed:
            peak = last = times[-1]
        first = max(first, min(peak - 0.5 * seconds, last - seconds))
        return first, min(last, first + seconds)

    def __repr__(self) -> str:
        ended = self.status.name.lower().replace("_", " ")
        if self.collapsed:
            ended += (
                f" at {self.collapse_time:.4g} s, {self.collapse_place}, "
                f"{self.collapse_mode.replace('_', ' ')}"
            )
        return (
            f"<Response {ended}; peak {self.peak_rotation:.3g} rad, {self.peak_displacement:.3g} "
            f"m; {self.method}, {self.end_time:.4g} s>"
        )


def response_of(results: Outcomes, row: int, method: str, wall_time: float) -> Response:
    """Return the response of one run, without a history.

    `results` are what a method returned, with a `row` for each run. `wall_time` is in s.
    """
    one: Any = Outcomes._make([values[row].tolist() for values in results])
    status = Status(one.status)
    largest = one.energy[Energy.LARGEST_KINETIC]
    error = one.energy[Energy.BALANCE_ERROR_PEAK]
    return Response(
        status=status,
        collapsed=_COLLAPSED.get(status),
        collapse_time=one.collapse_time,
        collapse_joint=one.collapse_joint,
        collapse_mode=CollapseMode(one.collapse_mode).name.lower(),
        lost_contact_time=one.loss[Loss.TIME],
        lost_contact_joint=int(one.loss[Loss.JOINT]),
        lost_contact_mode=CollapseMode(one.loss[Loss.MODE]).name.lower(),
        widest_gap=one.loss[Loss.WIDEST],
        peak_rotation=one.peak[Peak.ROTATION],
        peak_displacement=one.peak[Peak.DISPLACEMENT],
        residual_rotation=one.peak[Peak.END_ROTATION],
        residual_displacement=one.peak[Peak.END_DISPLACEMENT],
        events={name: int(one.count[entry]) for name, entry in _EVENTS.items()},
        model_time={each.name.lower(): one.model_time[each] for each in Level},
        energy_error=error / largest if largest > 0.0 else 0.0,
        energy={name: one.energy[entry] for name, entry in _ENERGY.items()},
        work={e.name.lower(): int(one.count[e]) for e in Count if e not in _NO_WORK},
        wall_time=wall_time,
        end_time=one.end_time,
        residual=one.peak[Peak.RESIDUAL],
        overlap=one.peak[Peak.OVERLAP],
        method=method,
    )


def empty_output(
    n_frame: int, n_entry: int, n_body: int, n_joint: int
) -> tuple[Frames, MechanismLog]:
    """Return arrays of zeros for the frames of a history and for the entries of a log."""
    body = (n_frame, n_body, 3)
    joint = (n_frame, n_joint, 3)
    codes = (np.float64, np.int8, np.int32, np.int8)
    entries = [np.zeros(n_entry, code) for code in codes]
    modes = np.zeros((n_entry, n_joint), np.int8)
    log = MechanismLog._make([*entries, modes])
    numbers = [np.zeros(shape) for shape in (n_frame, body, body, joint)]
    return Frames._make([*numbers, np.zeros(joint[:2], np.int8)]), log


def history_of(arch: Arch, frames: Frames, n_frame: int) -> xarray.Dataset:
    """Return the first `n_frame` frames of a run as a data set with names and units.

    Dimensions are time, voussoir, joint and component. Event-driven methods evaluate a frame at
    its instant. Time stepping writes it at the start of a step, with the mean of the velocities
    half a step before and after, and the mean reactions over that time. At an impact velocities
    and reactions of steps are means across it.
    """
    import xarray

    body = ("time", "voussoir", "component")
    joint = ("time", "joint", "component")
    place, rate, force, mode = (each[:n_frame] for each in frames[1:5])
    places = (arch.corner_name(0), arch.corner_name(1), "closed")
    slips = ("sticks", "slides_plus", "slides_minus")
    flags: Named = {
        "flag_values": np.arange(10, dtype=np.int8),
        "flag_meanings": " ".join(
            ["open", *(f"{p}_{slip}" for p in places for slip in slips)]
        ),
    }
    rows = (
        (
            "displacement",
            body,
            place[:, :, :2],
            "m",
            "displacement of the centroid from rest",
        ),
        ("rotation", body[:2], place[:, :, 2], "rad", "rotation of the voussoir"),
        (
            "velocity",
            body,
            rate[:, :, :2],
            "m s-1",
            "velocity of the centroid relative to the ground",
        ),
        (
            "angular_velocity",
            body[:2],
            rate[:, :, 2],
            "rad s-1",
            "angular velocity of the voussoir",
        ),
        (
            "reaction",
            joint,
            force[:, :, :2],
            "N",
            "reaction on the voussoir after the joint",
        ),
        (
            "moment",
            joint[:2],
            force[:, :, 2],
            "N m",
            "moment of the reaction about the middle between the joint's contact points",
        ),
    )
    variables = {
        name: (dimensions, values, {"units": unit, "long_name": text})
        for name, dimensions, values, unit, text in rows
    }
    flags["long_name"] = "contact mode of the joint"
    variables["contact_mode"] = joint[:2], mode, flags
    coordinates = {
        "time": ("time", frames.time[:n_frame], {"units": "s", "long_name": "time"}),
        "voussoir": np.arange(arch.n_voussoir),
        "joint": np.arange(arch.n_joint),
        "component": ["x", "y"],
    }
    return xarray.Dataset(variables, coordinates, {"gravity": STANDARD_GRAVITY})


def mechanism_of(
    arch: Arch, log: MechanismLog, n_entry: int, end_time: float, from_rest: bool
) -> tuple[MechanismChange, ...]:
    """Return the changes of the mechanism in a log, with names instead of numbers.

    If the run began `from_rest`, the rest before the first change is put first. `n_entry` is the
    number of changes in the run; those for which the log had no space are missing.
    """
    # What a joint does in each contact mode (`physics.contact.laws`). Friction opposes slip: where
    # it acts along the tangent, from corner 0 to corner 1, the later voussoir slides towards
    # corner 0.
    words = [_mode_words(arch, joint) for joint in range(arch.n_joint)]
    places = arch.places
    kept = min(n_entry, log.time.size)
    last = end_time if kept == n_entry else np.nan
    changes = [
        MechanismChange(
            time,
            to,
            Cause(cause).name.lower(),
            int(joint),
            Level(model).name.lower(),
            {int(j): words[j][mode[j]] for j in np.flatnonzero(mode != CLOSED_STICK)},
            places,
        )
        for time, to, cause, joint, model, mode in zip(
            log.time[:kept].tolist(), [*log.time[1:kept].tolist(), last], *log[1:]
        )
    ]
    first = changes[0].time if changes else end_time
    if from_rest and first > 0.0:
        changes.insert(0, MechanismChange(0.0, first, "start", -1, "rest", {}, places))
    return tuple(changes)


def _mode_words(arch: Arch, joint: int) -> list[str]:
    """Return what a joint does in each contact mode, in words."""
    sides = [arch.corner_name(corner, joint) for corner in (0, 1)]
    slides = [f"towards {side}" for side in sides]
    words = ["open"]
    for side in sides:
        words += [f"hinge {side}", *(f"hinge {side} sliding {to}" for to in slides)]
    return [*words, "closed", *(f"slides {to}" for to in slides)]


def summary(changes: Sequence[MechanismChange]) -> str:
    """Count the changes of the mechanism by cause, the most frequent first."""
    causes = Counter(each.cause for each in changes)
    del causes["start"], causes["end"]
    why = [f"{CAUSE_WORDS[name]} {n}" for name, n in causes.most_common()]
    return f"{causes.total()} changes of the mechanism ({', '.join(why) or 'none'})"
