"""Arches that move so slowly that they stay in equilibrium: a springing moves, or a tie pulls."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from archfrag.arch.marks import Mark
from archfrag.arch.shape import Shape
from archfrag.errors import StabilityError
from archfrag.physics.contact.path import new_path
from archfrag.physics.contact.ties import tie_stretch
from archfrag.physics.shared import begin
from archfrag.physics.state import new_model, new_state, new_work
from archfrag.physics.status import Tie, TieMode, TieState
from archfrag.physics.steps.service import creep, rest_range

LOST_GAP = (
    0.5  # an arch falls if a joint gapes by this part of its length at both corners [1]
)
# Step of a movement over the shortest joint, or as a rotation [rad]; the step in time makes
# inertia small beside weight. At the end, steps until nothing moves any more.
STEP = 1e-4
LONGEST = 0.2
SETTLING = 200
# Displacement, over the shortest joint, below which nothing moves, and beyond which an arch falls.
STILL = 1e-10
FALLS = 0.05
# Load over gravity below which forces that are not in equilibrium are rounding.
HOLDS = 1e-9
# Part of a prestress that a tie gets at once; least part to which this is halved; most steps until
# the arch rests again. Meanwhile the tie is soft: its elongation is SOFT times its length, so that
# it pulls with the same force wherever the arch goes.
PULL = 0.02
LEAST_PULL = 1e-4
FOLLOWING = 2000
SOFT = 1e6


class SlowArch:
    """An arch that moves from one equilibrium to the next, without velocity."""

    def __init__(self, arch: Shape) -> None:
        self._built = arch
        self.model = new_model(arch.chain)
        self._state = new_state(self.model)
        self._work = new_work(self.model)
        self._path = new_path(self.model)
        self._before = self.model.corner.copy(), self.model.tie.copy()
        begin(self.model, self._state, self._work, 0, 0.0)
        self.length = self.model.length.min()
        self._time = min(
            LONGEST, 50.0 * math.sqrt(STEP * self.length / self.model.gravity)
        )

    def rest_range(self) -> tuple[float, float]:
        """Return the range of rest in the present geometry: plus and minus [g].

        Both are -inf if there is none.
        """
        found, plus, minus = rest_range(
            self.model, self._state, self._work, self._path.rest
        )
        return (plus, minus) if found else (-math.inf, -math.inf)

    def step(self) -> tuple[bool, float]:
        """Make one step; return whether it succeeds, and the largest displacement of a body [m].

        It fails if its contact problem is not solved, or if a joint loses contact for good.
        """
        known = self.model, self._state, self._work, self._path
        solved, moved, lost = creep(*known, self._time, LOST_GAP)
        return solved and not lost, moved

    def place(self, base: int, move: NDArray, turn: float) -> None:
        """Place a base that has moved, with the joint face and the ends of ties on it.

        `base` is its number in `Shape.bases`. `move` (2,) [m] and `turn` [rad], about the middle
        of its joint, are those in all, not since the last call.
        """
        model = self.model
        corners, ties = self._before
        ground = [*self._built.bases.values()][base]
        face = corners[ground]
        middle = face.mean(axis=0)
        cosine = math.cos(turn)
        sine = math.sin(turn)
        rotation = np.array([[cosine, sine], [-sine, cosine]])
        moved = middle + move + (face - middle) @ rotation
        model.corner[ground] = moved
        along = moved[1] - moved[0]
        model.tangent[ground] = along / np.hypot(*along)
        row = self._built.n_voussoir + base if base else 0
        for end in range(2):
            held = ties[:, Tie.BODY_0 + end] == row
            columns = slice(Tie.X_0 + 2 * end, Tie.X_0 + 2 * end + 2)
            model.tie[held, columns] = (
                middle + move + (ties[held, columns] - middle) @ rotation
            )

    def settle(self, least: float, most: int = SETTLING) -> bool:
        """Make steps until the bodies rest; return whether they do.

        They do not if they fall or still move after `most` steps. The steps end early where the
        range of rest exceeds `least` [g].
        """
        for _ in range(most):
            made, moved = self.step()
            if not made or moved > FALLS * self.length:
                return False
            if moved < STILL * self.length or min(self.rest_range()) > least:
                return min(self.rest_range()) >= -HOLDS
        return False

    def arch(self):
        """Return the arch, at rest in the present position of its bodies."""
        arch = self._built
        model = self.model
        start = self._state.position[1 : 1 + arch.n_voussoir].copy()
        before = arch.chain.face_before.copy()
        after = arch.chain.face_after.copy()
        for joint, side in arch.bases.values():
            (before, after)[side][joint] = model.corner[joint, side]
        chain = arch.chain._replace(start=start, face_before=before, face_after=after)
        if len(model.tie):
            tie = model.tie.copy()
            tie[:, Tie.LENGTH] += self._state.tie[:, TieState.SET]
            chain = chain._replace(tie=tie)
        angle = start[:, 2].copy()
        if arch.chain.start is not None:  # its outlines have rotated so far already
            angle -= arch.chain.start[:, 2]

        def placed(points: NDArray, bodies: Sequence[int]) -> NDArray:
            moved = Mark("stone", points, bodies).moved
            return moved(arch.centroids, start[None, :, :2], angle[None])[0]

        last = arch.n_voussoir - 1
        bodies = [b if b <= last else a for a, b in arch.pairs.tolist()]
        bodies += [last] * arch.free_end
        return arch.changed(
            chain=chain,
            built=arch.built or arch,
            outlines=tuple(placed(each, [k]) for k, each in enumerate(arch.outlines)),
            intrados=placed(arch.intrados, bodies),
            extrados=placed(arch.extrados, bodies),
        )

    def tension(self, tie: int, prestress: float) -> float:
        """Tension a tie slowly while the arch follows, until the arch rests.

        Return inf if it does, else the fraction of `prestress` [N] up to which the arch stands.
        """
        row = self.model.tie[tie]
        part = 0.0
        more = PULL
        given = row.copy()
        while part < 1.0:
            kept = [array.copy() for array in self._state]
            self._pull(tie, min(1.0, part + more) * prestress)
            if min(self.rest_range()) >= 0.0 or self.settle(0.0, FOLLOWING):
                part = min(1.0, part + more)
                continue
            for array, values in zip(self._state, kept):
                array[:] = values
            more *= 0.5
            if more < LEAST_PULL:
                return part
        if not self.settle(math.inf, FOLLOWING):
            return 1.0
        length = row[Tie.LENGTH] + tie_stretch(self.model, tie, self._state.position)
        row[:] = given
        row[Tie.LENGTH] = length - prestress / row[Tie.STIFFNESS]
        return math.inf

    def _pull(self, tie: int, force: float) -> None:
        """Make a tie pull with a force [N] that stays the same wherever its ends go."""
        row = self.model.tie[tie]
        length = row[Tie.LENGTH] + tie_stretch(self.model, tie, self._state.position)
        row[Tie.STIFFNESS] = force / (SOFT * length)
        row[Tie.LENGTH] = (1.0 - SOFT) * length
        row[Tie.STRENGTH] = row[Tie.RUPTURE] = math.inf
        self._state.tie[tie] = TieMode.TAUT, 0.0


def follow_tie(arch: Shape):
    """Return an arch, whose springing has moved, at rest under its last tie.

    Its hinges leave it only one thrust, so that it moves when a tie pulls, until joints close. The
    tie has its prestress at the end.

    Raises
    ------
    StabilityError
        If the arch falls; the message names the tie, and the force up to which the arch stands.
    """
    tie = len(arch.parameters["ties"]) - 1
    slow = SlowArch(arch)
    prestress = arch.parameters["ties"][tie]["prestress"]
    if prestress == 0.0 or min(slow.rest_range()) >= 0.0:
        return arch
    part = slow.tension(tie, prestress)
    if math.isfinite(part):
        raise StabilityError(
            f"{arch!r}: the arch falls when its {tie_name(arch, tie)} gets a prestress "
            f"of {prestress:g} N; it stands with up to {part * prestress:.4g} N"
        )
    return slow.arch()


def tie_name(arch: Shape, tie: int) -> str:
    """Return the name of a tie in messages: its number, and its level if it has one."""
    level = arch.parameters["ties"][tie].get("level")
    return f"tie {tie + 1}" + ("" if level is None else f" (level {level:g} m)")
