"""Whether an arch stands, and if not why; reasons for caution with one that does."""

from __future__ import annotations

import math
from weakref import WeakKeyDictionary

import numpy as np

from archfrag.arch import Arch
from archfrag.arch.tie_rods import tie_name
from archfrag.errors import GeometryError, StabilityError
from archfrag.physics.contact.ties import tie_stretch
from archfrag.physics.state import model_of
from archfrag.physics.status import Status, Tie
from archfrag.simulation.response import STATUS_MESSAGE
from archfrag.simulation.rest import Onset, onset

# How far inside the edges hinges are put [m], and the part of the onset above which this matters.
INSET, MOST_LOST = 0.01, 0.1
HALVINGS = 20  # of the prestress that an arch stands
_STANDING = WeakKeyDictionary[Arch, Onset]()  # arches are asked for with every chunk of runs


def check_stands(arch: Arch) -> Onset:
    """See that an arch is at rest under its own weight, or raise `StabilityError`."""
    start = _STANDING.get(arch) or onset(arch)
    if not start.stands:
        if tight := prestress_text(arch):
            raise StabilityError(f"{arch!r}: the arch {tight}")
        message = f"{arch!r}: {STATUS_MESSAGE[Status.DOES_NOT_STAND]}"
        if math.isfinite(start.plus):
            ends = f"{-start.minus:.4g} and {start.plus:.4g} g"
            message += f" (rest would need a steady horizontal acceleration between {ends})"
        raise StabilityError(message)
    _STANDING[arch] = start
    return start


def inset_loss(arch: Arch) -> float:
    """Find the part of its onset that an arch loses with hinges 10 mm inside its edges [1].

    Of the arch as built, before its springings moved; nan if it does not stand then, or nothing
    moves it. 1 if it does not stand with such hinges.
    """
    built = arch.built or arch
    start = onset(built)
    before = min(start.plus, start.minus)
    if not start.stands or not 0.0 < before < math.inf:
        return math.nan
    try:
        inside = onset(built.recessed(INSET, INSET))
    except GeometryError:  # nothing is left of a joint
        return 1.0
    return 1.0 - min(inside.plus, inside.minus) / before if inside.stands else 1.0


def inset_text(arch: Arch, loss: float) -> str:
    """Say what hinges inside the edges do to the onset; empty if that is not known."""
    where = f"hinges {1000.0 * INSET:g} mm inside the edges of the joints"
    if math.isnan(loss):
        return ""
    if loss >= 1.0:
        return f"with {where} the arch does not stand"
    of = " of the arch as built" if arch.built else ""
    return f"{where} lower the onset of motion{of} by {100.0 * loss:.1f} %"


def arch_cautions(arch: Arch, start: Onset) -> list[str]:
    """List reasons for caution with the onset and the verdicts of an arch that stands."""
    if not start.stands:
        return []
    found, loss = [], inset_loss(arch)
    both = (start.plus, "+x"), (start.minus, "-x")
    if locked := " and ".join(towards for load, towards in both if math.isinf(load)):
        found.append(
            f"no steady acceleration towards {locked} moves it in theory: its joints can lock "
            "each other at any load. Contact dynamics may still let it fall, so a run in which "
            "it stays at rest proves little; see limit_load"
        )
    if loss > MOST_LOST:
        found.append(
            f"{inset_text(arch, loss)}; rigid joints bear at their very edges, which is on the "
            "unsafe side for an arch as thin as this: compare it with recess: {intrados: "
            f"{INSET:g}, extrados: {INSET:g}}}"
        )
    return found


def prestress_text(arch: Arch) -> str:
    """Say that an arch falls by the prestress of its ties, and how much it bears; else empty."""
    largest = _part_of_prestress(arch)
    if math.isnan(largest):
        return ""
    ties = [
        f"{tie_name(arch, tie)}: {pull:g} N, at most {largest * pull:.4g} N"
        for tie, pull in enumerate(told["prestress"] for told in arch.parameters["ties"]) if pull
    ]  # fmt: skip
    together = " together" * (len(ties) > 1)
    return (
        f"does not stand with the prestress of its ties ({'; '.join(ties)}{together}), "
        "but without it; give less prestress"
    )


def _part_of_prestress(arch: Arch) -> float:
    """Return the largest part of the prestress of its ties with which an arch stands; nan if with
    none.
    """
    ties = arch.chain.tie
    if ties is None:
        return math.nan
    model = model_of(arch.chain)
    stretch = [max(tie_stretch(model, tie, model.start), 0.0) for tie in range(len(ties))]

    def stands(part: float) -> bool:
        fewer = ties.copy()
        fewer[:, Tie.LENGTH] += (1.0 - part) * np.array(stretch)
        return onset(arch.changed(chain=arch.chain._replace(tie=fewer))).stands

    if stands(1.0) or not stands(0.0):
        return math.nan
    low, high = 0.0, 1.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stands(middle) else (low, middle)
    return low
