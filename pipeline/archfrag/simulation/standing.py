"""Whether an arch stands, and if not why; reasons for caution with one that does."""

from collections.abc import Callable
from functools import lru_cache

import numpy as np

from archfrag.arch import Arch
from archfrag.arch.quasi_static import tie_name
from archfrag.errors import ArchfragError, GeometryError, StabilityError
from archfrag.physics.contact.ties import tie_stretch
from archfrag.physics.state import model_of
from archfrag.physics.status import Status, Tie
from archfrag.physics.steps.face_rest import settled
from archfrag.simulation.joints import inset_of
from archfrag.simulation.response import STATUS_MESSAGE
from archfrag.simulation.rest import Onset, onset

# INSET: how far inside the edges of joints hinges are put [m]. MOST_LOST: an arch that loses more
# than this part of its onset by it gets a caution.
INSET = 0.01
MOST_LOST = 0.1
# RIGID_ENOUGH, INSET_ENOUGH: parts of the onset lost by joints that give, up to which rigid joints
# and the model inset are enough. MOST_GROWTH: growth of normal forces up to which the inset is.
# USUAL_STIFFNESS: used if none is given, of cut stone or brick in mortar [Pa/m].
RIGID_ENOUGH = 0.01
INSET_ENOUGH = 0.25
MOST_GROWTH = 1.5
USUAL_STIFFNESS = 3e10
HALVINGS = 20  # to find the prestress with which an arch stands


@lru_cache(maxsize=256)  # arches are asked for with every chunk of runs
def check_stands(arch: Arch) -> Onset:
    """Return the onset of an arch; `StabilityError` if it does not rest under its own weight.

    `ArchfragError` if the solver finds no rest of the arch on elastic joints.
    """
    start = onset(arch)
    if not start.stands:
        tight = prestress_text(arch)
        if tight:
            raise StabilityError(f"{arch!r}: the arch {tight}")
        message = f"{arch!r}: {STATUS_MESSAGE[Status.DOES_NOT_STAND]}"
        if np.isfinite(start.plus):
            message += (
                " (rest would need a steady horizontal acceleration between "
                f"{-start.minus:.4g} and {start.plus:.4g} g)"
            )
        raise StabilityError(message)
    rest = None if arch.chain.joint is None else settled(arch.chain)
    if rest is Status.DOES_NOT_STAND:
        raise StabilityError(f"{arch!r}: the arch does not stand on joints that soft")
    if rest is Status.NO_CONTACT_SOLUTION:
        raise ArchfragError(
            f"{arch!r}: the solver found no rest of the arch on its joints, which does not say "
            "that it falls; take joints.model inset, and please report the case"
        )
    return start


def edge_loss(arch: Arch) -> float:
    """Find the part of its onset that an arch loses with hinges 10 mm inside its edges [1].

    The arch is taken as it was built, before its springings moved. The result is nan if it does
    not stand or nothing moves it, and 1 if it does not stand with such hinges. If its joints give
    by the model inset, the hinges are 10 mm further inside than by this model.
    """
    built: Arch = arch.built or arch
    built = built.changed(parameters={**built.parameters, "joints": None})
    return _loss(built, lambda: built.recessed(INSET, INSET))


@lru_cache(maxsize=256)
def joints_loss(arch: Arch) -> tuple[float, float]:
    """Find what the model inset does to an arch of rigid joints, as two numbers [1].

    The first is the part of its onset that the arch loses: nan if it does not stand or nothing
    moves it, 1 if it does not stand with this model. The second is the largest normal force under
    the largest steady load over that at rest: nan if there are no contact points for it. The
    stiffness is that of the arch, or `USUAL_STIFFNESS`. Ties, strength and movements of springings
    are left out.
    """
    rigid = arch.rebuilt()
    if "recess" in arch.parameters:
        rigid = rigid.recessed(**arch.parameters["recess"])
    stiffness, shear = (
        np.broadcast_to(_stiffness(arch, key), rigid.n_joint)
        for key in ("stiffness", "shear")
    )
    growth = [np.nan]

    def inset() -> Arch:
        found = inset_of(rigid, stiffness, shear)
        growth.append(found.growth)
        return rigid.recessed(found.lengths, found.lengths)

    return _loss(rigid, inset), growth[-1]


def _stiffness(arch: Arch, key: str = "stiffness") -> np.ndarray:
    """Return the stiffness of an arch's joints [Pa/m], or with `key` "shear" the shear one.

    A shear stiffness that is not set equals the stiffness. A stiffness that is not set is
    `USUAL_STIFFNESS`.
    """
    default = arch.joints.get("stiffness", USUAL_STIFFNESS)
    return np.array(arch.joints.get(key, default), dtype=float)


def _loss(arch: Arch, change: Callable[[], Arch]) -> float:
    """Return the part of its onset that an arch loses by a change; `change` returns the new arch.

    It is nan if the arch does not stand or nothing moves it, and 1 if the new arch does not stand.
    """
    start = onset(arch)
    before = start.least
    if not start.stands or not 0.0 < before < np.inf:
        return np.nan
    try:
        inside = onset(change())
    except (GeometryError, StabilityError):  # nothing is left of a joint, or too little
        return 1.0
    return 1.0 - inside.least / before if inside.stands else 1.0


def joints_text(arch: Arch) -> str:
    """Say which model of its joints an arch needs; empty if that is not known."""
    loss, growth = joints_loss(arch)
    if np.isnan(loss):
        return ""
    who = f"{'its' if arch.joints else 'usual'} joints of {_stiffness(arch).min():.3g} Pa/m"
    lost = f"{who} lower the onset of motion by {100.0 * loss:.1f} %"
    if loss >= 1.0:
        lost = f"with {who} bearing inside their ends it does not stand"
    if growth > MOST_GROWTH:
        lost += (
            f", and under the largest load that it bears its normal forces are {growth:.1f} times "
            "those at rest, so that its joints store energy and give it back"
        )
    if loss > INSET_ENOUGH or growth > MOST_GROWTH:
        return f"{lost}: joints.model face is needed"
    if loss < RIGID_ENOUGH:
        return f"{lost}: rigid ones are enough"
    return f"{lost}: joints.model inset is enough, rigid ones are not"


def edge_text(arch: Arch, loss: float) -> str:
    """Say what hinges inside the edges do to the onset; empty if that is not known.

    `loss` is that of `edge_loss`.
    """
    if np.isnan(loss):
        return ""
    further = arch.joints.get("model") == "inset"
    where = (
        f"hinges {1000.0 * INSET:g} mm "
        f"{'further inside the joints' if further else 'inside the edges of the joints'}"
    )
    if loss >= 1.0:
        return f"with {where} the arch does not stand"
    return (
        f"{where} lower the onset of motion{' of the arch as built' if arch.built else ''} by "
        f"{100.0 * loss:.1f} %, and the collapse border by about as much"
    )


def arch_cautions(arch: Arch, start: Onset) -> list[str]:
    """List reasons for caution with the onset and the verdicts of an arch that stands."""
    if not start.stands:
        return []
    found = []
    loss = edge_loss(arch)
    both = (start.plus, "+x"), (start.minus, "-x")
    locked = " and ".join(towards for load, towards in both if np.isinf(load))
    if locked:
        found.append(
            f"no steady acceleration towards {locked} moves it in theory: its joints can lock "
            "each other at any load. Contact dynamics may still let it fall, so a run in which "
            "it stays at rest proves little; see limit_load"
        )
    if not arch.joints and loss > MOST_LOST:
        found.append(
            f"{edge_text(arch, loss)}; rigid joints bear at their very edges, which is on the "
            "unsafe side for an arch as thin as this: compare it with joints: {stiffness: "
            f"{USUAL_STIFFNESS:g}}}"
        )
    if arch.joints.get("model") == "inset":
        told = joints_text(arch)
        if told.endswith("needed"):
            found.append(told)
    return found


def prestress_text(arch: Arch) -> str:
    """Say that an arch falls by the prestress of its ties, and how much of it the arch bears.

    The text is empty if the prestress is not the reason.
    """
    largest = _part_of_prestress(arch)
    if np.isnan(largest):
        return ""
    ties = [
        f"{tie_name(arch, tie)}: {pull:g} N, at most {largest * pull:.4g} N"
        for tie, pull in enumerate(
            told["prestress"] for told in arch.parameters["ties"]
        )
        if pull
    ]
    return (
        "does not stand with the prestress of its ties "
        f"({'; '.join(ties)}{' together' * (len(ties) > 1)}), "
        "but without it; give less prestress"
    )


def _part_of_prestress(arch: Arch) -> float:
    """Return the largest part of the prestress of its ties with which an arch stands.

    It is nan if the arch has no ties, stands with all of the prestress, or falls without it too.
    """
    ties = arch.chain.tie
    if ties is None:
        return np.nan
    model = model_of(arch.chain)
    stretch = [tie_stretch(model, tie, model.start) for tie in range(len(ties))]

    def stands(part: float) -> bool:
        fewer = ties.copy()
        fewer[:, Tie.LENGTH] += (1.0 - part) * np.maximum(stretch, 0.0)
        return onset(arch.changed(chain=arch.chain._replace(tie=fewer))).stands

    if stands(1.0) or not stands(0.0):
        return np.nan
    part = 0.0
    for halvings in range(1, HALVINGS + 1):
        more = 0.5**halvings
        if stands(part + more):
            part += more
    return part
