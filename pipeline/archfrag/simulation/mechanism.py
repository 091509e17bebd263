"""Log of the mechanism: when joints hinge or slide, and why the mechanism changed."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from archfrag.arch import Arch
from archfrag.mechanics.laws import CLOSED_STICK
from archfrag.mechanics.status import Cause, Model
from archfrag.mechanics.types import MechanismLog

FIRST_LOG, LARGEST_LOG = 1024, 50_000

CAUSE_WORDS = {
    Cause.START: "start", Cause.HINGE: "new hinge", Cause.SLIDE: "sliding starts",
    Cause.STICK: "sliding ends", Cause.IMPACT: "impact", Cause.LOSS: "contact lost",
    Cause.CLOSE: "hinge closes", Cause.REST: "comes to rest",
    Cause.ACCUMULATION: "events accumulate", Cause.UNSOLVED: "laws not met on mega-voussoirs",
    Cause.QUIESCENT: "taken back from time stepping", Cause.END: "end of the run",
}  # fmt: skip
MODEL_WORDS = {
    Model.REST: "rest", Model.FOUR_HINGES: "four hinges",
    Model.MEGA_VOUSSOIRS: "mega-voussoirs", Model.ALL_VOUSSOIRS: "all voussoirs",
}  # fmt: skip


@dataclass(frozen=True)
class MechanismChange:
    """One change of the mechanism, and the mechanism after it.

    Attributes
    ----------
    time, until : float
        From when to when this mechanism holds [s]. `until` is nan if changes that followed were
        too many to be kept.
    cause : str
        Why it changed: a name of `archfrag.mechanics.status.Cause` in lower case.
    joint : int
        Joint that caused it; -1 where none did.
    model : str
        Model from then on: a name of `archfrag.mechanics.status.Model` in lower
        case.
    joints : dict of int to str
        What each joint does that is not closed and sticking: "hinge intrados", "slides towards
        extrados", "hinge extrados sliding towards intrados", or "open". A joint slides towards
        the side to which the voussoir after it moves on the one before it.

    Examples
    --------
    >>> from archfrag.simulation.mechanism import MechanismChange
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

    def __str__(self) -> str:
        groups: dict[str, list[str]] = {"hinges": [], "slides": [], "open": []}
        for joint, text in self.joints.items():
            verb, _, rest = text.partition(" ")
            groups["hinges" if verb == "hinge" else verb].append(f"{joint} {rest}".strip())
        parts = [f"{name} {', '.join(members)}" for name, members in groups.items() if members]
        why = CAUSE_WORDS[Cause[self.cause.upper()]]
        where = f" at joint {self.joint}" if self.joint >= 0 else ""
        parts = [*(parts or ["all joints closed"]), MODEL_WORDS[Model[self.model.upper()]]]
        what = "; ".join(parts)
        return f"{self.time:.4f} s  {why}{where}: {what}"


def empty_log(n_entry: int, n_joint: int) -> MechanismLog:
    """Space for so many entries."""
    return MechanismLog(
        time=np.zeros(n_entry),
        cause=np.zeros(n_entry, np.int8),
        joint=np.zeros(n_entry, np.int32),
        model=np.zeros(n_entry, np.int8),
        mode=np.zeros((n_entry, n_joint), np.int8),
    )


def mechanism_of(
    arch: Arch, log: MechanismLog, n_entry: int, end_time: float, from_rest: bool
) -> tuple[MechanismChange, ...]:
    """Entries of a log in words, preceded by the standstill in which the run began if it did.

    `n_entry` changes were made: more than the log has space for if it was too small.
    """
    words = joint_words(arch)
    kept = min(n_entry, log.time.size)
    until = np.append(log.time[1:kept], end_time if kept == n_entry else np.nan)
    changes = tuple(
        MechanismChange(
            time=float(log.time[i]),
            until=float(until[i]),
            cause=Cause(log.cause[i]).name.lower(),
            joint=int(log.joint[i]),
            model=Model(log.model[i]).name.lower(),
            joints={
                int(j): words[log.mode[i, j]] for j in np.flatnonzero(log.mode[i] != CLOSED_STICK)
            },
        )
        for i in range(kept)
    )
    first = changes[0].time if changes else end_time
    if not from_rest or first <= 0.0:
        return changes
    return (MechanismChange(0.0, first, "start", -1, "rest", {}), *changes)


def joint_words(arch: Arch) -> tuple[str, ...]:
    """What a joint does in each contact mode of `archfrag.mechanics.laws`, in the user's names.

    Friction opposes slip: where it acts along the tangent, from corner 0 to corner 1, the later
    voussoir slides towards corner 0.
    """
    sides = [arch.corner_name(corner) for corner in (0, 1)]
    slips = ["", f" sliding towards {sides[0]}", f" sliding towards {sides[1]}"]
    hinges = [f"hinge {side}{slip}" for side in sides for slip in slips]
    slides = [slip.replace(" sliding", "slides") for slip in slips[1:]]
    return ("open", *hinges, "closed", *slides)


def summary(changes: Sequence[MechanismChange]) -> str:
    """How often the mechanism changed, and why, most frequent causes first."""
    causes = Counter(change.cause for change in changes if change.cause not in ("start", "end"))
    why = [f"{CAUSE_WORDS[Cause[name.upper()]]} {n}" for name, n in causes.most_common()]
    n = sum(causes.values())
    return f"{n} changes of the mechanism" + (f" ({', '.join(why)})" if why else "")
