"""Rest: the steady acceleration that an arch withstands, how it starts to move, and how far it
can rotate slowly before it falls by itself; checks of initial states."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise, starmap
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from archfrag.arch import STANDARD_GRAVITY, Arch
from archfrag.arch.checks import FloatArray
from archfrag.arch.geometry import cross
from archfrag.arch.marks import Mark, hinge_points, mechanism_marks
from archfrag.errors import InputError, UnitWarning
from archfrag.physics.contact.path import new_path, solve_with_fallback
from archfrag.physics.contact.placing import clearance, move_faces, place_contacts
from archfrag.physics.contact.ties import pull_at_rest, pull_bodies
from archfrag.physics.onset import (
    HINGE_EXTRADOS,
    HINGE_INTRADOS,
    SLIDING,
    RestLimit,
    new_rest_problem,
    rest_limit,
)
from archfrag.physics.shared import begin
from archfrag.physics.state import Model, State, Work, model_of, new_state, new_work
from archfrag.properties import LATER

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from archfrag.motions.motion import Motion

STANDS_TOLERANCE = 1e-12
# Overlap, over joint length, that an initial state may have: what time stepping leaves.
MOST_OVERLAP = 1e-5
NEEDS_SPACE = (
    "a plane model is not enough where across governs, for a skewed or curved bridge, and for "
    "spandrel walls that fall out of their plane: these need three dimensions"
)
# Positions of a mechanism that are evaluated, up to this rotation of the first body [rad].
POSITIONS = 4000
LARGEST_ROTATION = 0.5 * np.pi

Hinge = tuple[int, str]


@dataclass(frozen=True, repr=False)
class Onset:
    """Rest range of an arch and the mechanisms at its ends.

    Attributes
    ----------
    stands : bool
        Whether the arch is at rest under its own weight.
    plus, minus : float
        Largest steady ground acceleration towards +x and towards -x at which it stays at rest
        [g]; nan if no load leaves it at rest, inf if none moves it. With a vertical ground
        acceleration k_v they are limits of k_h / (1 + k_v).
    hinges, hinges_minus : list of (int, str)
        Joint and side ("intrados" or "extrados") of the hinges at `plus` and at `minus`.
    sliding, sliding_minus : list of int
        Joints that slide at `plus` and at `minus`.
    thrust, thrust_plus, thrust_minus : ndarray, (n_joint, 2) or None
        Contact centres under self-weight and at the two ends of the range [m]; nan at joints
        without a force; None if the arch does not stand or they are not unique. An arch at rest
        is hyperstatic: its thrust line is the admissible one of joints that are equal springs, in
        the limit of infinite stiffness.
    normal : ndarray, (n_joint,) or None
        Normal forces of the joints under self-weight, which belong to `thrust` [N].
    arch : Arch
    transverse : (str, Onset) or None
        The pier that moves first across the bridge, and the onset of its column; None without
        piers.

    Examples
    --------
    >>> import archfrag as af
    >>> af.onset(af.Block(width=0.2, height=1.0, friction=0.8))
    <Onset towards +x 0.2 g: hinge 0 extrados
           towards -x 0.2 g: hinge 0 intrados>
    """

    stands: bool
    plus: float
    minus: float
    hinges: list[Hinge]
    sliding: list[int]
    hinges_minus: list[Hinge]
    sliding_minus: list[int]
    thrust: FloatArray | None
    thrust_plus: FloatArray | None
    thrust_minus: FloatArray | None
    normal: FloatArray | None
    arch: Arch = field(compare=False)

    def mechanism(self, towards: str) -> tuple[float, list[Hinge], list[int]]:
        """Return limit [g], hinges and sliding joints; the ground accelerates towards +x or -x."""
        if towards == "+x":
            return self.plus, self.hinges, self.sliding
        if towards == "-x":
            return self.minus, self.hinges_minus, self.sliding_minus
        raise InputError(f"towards = {towards!r} must be +x or -x")

    @property
    def least(self) -> float:
        """The smaller of the limits towards +x and -x [g]."""
        return min(self.plus, self.minus)

    @property
    def transverse(self) -> tuple[str, Onset] | None:
        """The pier that moves first across the bridge, and the onset of its column.

        See `Arch.transverse`; of the bridge as it was built, without recesses, joints, strength,
        moved springings and ties. None if the arch has no piers.
        """
        return _first_transverse(self.arch)

    @property
    def transverse_text(self) -> str:
        """Onsets across and along the bridge in words, and which governs; empty without piers."""
        name = self.arch.parameters.get("transverse")
        if name:
            return f"the column is {name} across the bridge with its share of rings and fill"
        if self.transverse is None or not self.stands:
            return ""
        name, column = self.transverse
        moves = [
            "never moves" if math.isinf(value) else f"moves from {value:.4f} g"
            for value in (column.least, self.least)
        ]
        governs = "across" if column.least < self.least else "along"
        built = " as it was built" * bool({*LATER} & {*self.arch.parameters})
        return (
            f"across the bridge{built} {name}, {column.arch.extent[0]:.4g} m deep, with its share "
            f"of rings and fill {moves[0]}, along it the bridge {moves[1]}: {governs} governs; "
            f"{NEEDS_SPACE}"
        )

    def thrust_line(self, towards: str | None = None) -> FloatArray | None:
        """Return the thrust line for a drawing, (n_point, 2) [m]; None if it is not known.

        It passes through the contact centres. It is that under self-weight, or if `towards` is
        given that at onset, with the ground accelerating towards "+x" or "-x". Between the lines
        of the rings and piers of a bridge is a row of nan.
        """
        lines = self._thrust_lines(towards)
        gap = np.full((1, 2), np.nan)
        rows = [row for line in lines for row in (gap, line)]
        return np.concatenate(rows[1:]) if lines else None

    def _thrust_lines(self, towards: str | None) -> list[FloatArray]:
        centre = self.thrust
        load = 0.0
        if towards is not None:
            load, *_ = self.mechanism(towards)
            centre = self.thrust_plus
            if towards == "-x":
                load = -load
                centre = self.thrust_minus
        if centre is None:
            return []
        rows = joint_rows(self.arch)
        return [thrust_curve(self.arch, centre, load, joints) for joints in rows]

    def marks(self, towards: str) -> list[Mark]:
        """Return what a drawing shows of the mechanism: thrust lines, sliding joints, hinges."""
        lines = {"rest": None, "thrust": towards}
        marks = [
            Mark(role, line)
            for role, load in lines.items()
            for line in self._thrust_lines(load)
        ]
        return marks + mechanism_marks(self.arch, *self.mechanism(towards)[1:])

    def places(self, towards: str) -> str:
        """Return hinges and sliding joints in words: "joint 4 extrados, joint 7 slides"."""
        _, hinges, sliding = self.mechanism(towards)
        words = [f"{self.arch.place(joint)} {side}" for joint, side in hinges]
        words += [f"{self.arch.place(joint)} slides" for joint in sliding]
        return ("; " if self.arch.places else ", ").join(words)

    def plot(self, ax: Axes | None = None, towards: str | None = None) -> Axes:
        """Draw hinges, sliding joints and thrust line at onset, in `ax` or in new axes.

        The ground accelerates `towards` "+x" or "-x"; by default to the side of the smaller limit.
        """
        from archfrag.plots import plot_onset

        return plot_onset(self, ax, towards)

    def __repr__(self) -> str:
        plus, minus = (self._text(towards) for towards in ("+x", "-x"))
        words = [f"<Onset {plus}", minus]
        if self.transverse is not None:
            name, column = self.transverse
            words.append(f"across {column.least:.4g} g: {name}")
        return "\n       ".join(words) + ">"

    def _text(self, towards: str) -> str:
        limit, hinges, sliding = self.mechanism(towards)
        name = str if len(self.arch.parts) == 1 else self.arch.place
        words = [f"hinge {name(joint)} {side}" for joint, side in hinges]
        words += [f"{self.arch.place(joint)} slides" for joint in sliding]
        return f"towards {towards} {limit:.4g} g{': ' * bool(words)}{', '.join(words)}"

    def _repr_html_(self) -> str:
        from archfrag.plots import html_of

        return html_of(self)


@lru_cache(maxsize=256)
def _first_transverse(arch: Arch) -> tuple[str, Onset] | None:
    """Return the pier and the onset that `Onset.transverse` is."""
    built = arch.rebuilt()
    names = [part.name for part in arch.parts if "pier" in part.name]
    found = [(name, onset(built.transverse(name))) for name in names]
    return min(found, key=lambda each: each[1].least, default=None)


def onset(arch: Arch) -> Onset:
    """Find the steady ground acceleration that starts to move an arch, and the mechanism.

    An arch that does not stand has an onset too (``stands`` is then False). By the static theorem,
    rest is the contact problem of the chain with no acceleration, solved for the largest load
    factor (`archfrag.physics.onset`). With friction it is the largest load for which admissible
    reactions exist.

    Examples
    --------
    >>> import archfrag as af
    >>> arch = af.Arch.circular(10.0, 1.5, 157.5, voussoirs=7, friction=0.7)
    >>> start = af.onset(arch)
    >>> round(start.plus, 4), start.hinges
    (0.37, [(0, 'extrados'), (2, 'intrados'), (4, 'extrados'), (7, 'intrados')])
    """
    if not isinstance(arch, Arch):
        raise InputError(
            f"arch is {type(arch).__name__}; it must be an archfrag Arch or Block"
        )
    model, state, work = _placed(arch)
    begin(model, state, work, 0, 0.0)
    place_contacts(model, state.slip, work)
    work.candidate[:] = state.contact
    problem = new_rest_problem(model)
    problem.candidate[:] = state.contact
    problem.centroid[:] = model.start[:, :2]
    pull_at_rest(model, state, work, problem.pull)
    plus, minus = (rest_limit(model, work, problem, sense) for sense in (1.0, -1.0))
    found = plus.found and minus.found
    stands = bool(
        found
        and plus.load_factor >= -STANDS_TOLERANCE
        and minus.load_factor <= STANDS_TOLERANCE
    )
    ahead, back = (
        contact_centres(work, limit.reaction)
        if limit.found and math.isfinite(limit.load_factor)
        else None
        for limit in (plus, minus)
    )
    if stands:
        work.free[1 : model.end, 1] = -model.gravity
        work.position[:] = state.position
        pull_bodies(model, state, work)
        solve_with_fallback(model, state, work, new_path(model))
        pivot = work.pivot
        weight = work.reaction.copy()
        normal = np.einsum("jk,jk->j", weight[:, :2], work.normal)
        # Moments about the origin, as of the limits.
        weight[:, 2] += pivot[:, 0] * weight[:, 1] - pivot[:, 1] * weight[:, 0]
    return Onset(
        stands,
        float(plus.load_factor) if found else math.nan,
        float(-minus.load_factor) if found else math.nan,
        *_mechanism(arch, plus),
        *_mechanism(arch, minus),
        contact_centres(work, weight) if stands else None,
        ahead,
        back,
        normal if stands else None,
        arch,
    )


def contact_centres(work: Work, reaction: FloatArray) -> FloatArray:
    """Return the contact centres (Eq 34): where on each joint the reaction has no moment [m]."""
    point = work.point
    normal = work.normal
    force = reaction[:, :2]
    arm = point[:, 0]
    press = np.einsum("jk,jk->j", force, normal)
    moment = reaction[:, 2] - cross(arm, force)
    along = point[:, 1] - arm
    loaded = press > 1e-12 * np.abs(force).max()
    fraction = np.full(press.size, np.nan)
    length = np.linalg.norm(along, axis=1)
    fraction[loaded] = -moment[loaded] / (press * length)[loaded]
    return arm + fraction[:, None] * along


def joint_rows(arch: Arch) -> list[range]:
    """Return the joints of each pier and ring along which every body has two joints."""
    before, after = arch.pairs.T
    shared = np.bincount(after + 1)[before[1:] + 1] > 1  # of top courses
    ends = np.flatnonzero((after[:-1] != before[1:]) | shared) + 1
    return [*starmap(range, pairwise([0, *ends.tolist(), arch.n_joint]))]


def _bodies_of(arch: Arch, first: int, last: int) -> slice:
    """Return the bodies of a row behind its joint `first`, up to its joint `last`.

    With `last` beyond the joints of a chain with a free end it is up to that end.
    """
    end = arch.pairs[last, 0] + 1 if last < arch.n_joint else arch.n_voussoir
    return slice(arch.pairs[first, 1], end)


def thrust_curve(arch: Arch, centre: NDArray, load: float, joints: range) -> FloatArray:
    """Return the thrust line of a row of joints under weights and a steady load [g].

    It is (n_point, 2) [m]. It passes through the contact centres `centre`, (n_joint, 2), with
    curves between them. In an arch with ties, which add forces to bodies, it is straight between
    them.
    """
    chain = arch.chain
    centre = centre[joints.start : joints.stop]
    if arch.pulled or (len(centre) == 1 and not arch.free_end):
        return centre[np.isfinite(centre).all(axis=1)]
    bodies = _bodies_of(arch, joints[0], joints[-1] + arch.free_end)
    body = arch.centroids[bodies]
    force = chain.mass[bodies, None] * np.array([-load, -1.0])
    # The force beyond each body less that before the first one.
    after = np.cumsum(force, axis=0)
    if arch.free_end:
        first = -after[-1]
        start = centre
        end = np.vstack([centre[1:], body[-1:]])
    else:
        # Moments of each body about the centre of its first joint are in equilibrium.
        start = centre[:-1]
        end = centre[1:]
        right = cross(body - start, force) - cross(end - start, after)
        left = np.column_stack([start[:, 1] - end[:, 1], end[:, 0] - start[:, 0]])
        known = np.isfinite(right)
        first = np.linalg.lstsq(left[known], right[known], rcond=None)[0]
    reaction = first + np.vstack([np.zeros(2), after[:-1]])
    turn = cross(reaction, force)
    sizes = [np.linalg.norm(each, axis=1) for each in (reaction, force)]
    along = np.abs(turn) < 1e-9 * sizes[0] * sizes[1]
    turn[along] = np.nan
    # The forces at the ends of a body meet on the line of its weight. Spread evenly, the weight
    # bends the line between them to a parabola that is tangent to both.
    corner = start + (cross(body - start, force) / turn)[:, None] * reaction
    # Where they meet beyond both ends, as in a pier almost along its weight, the line is straight.
    chord = end - start
    place = ((corner - start) * chord).sum(axis=1) / (chord**2).sum(axis=1)
    along |= ~((place > 0.0) & (place < 1.0))
    corner[along] = 0.5 * (start + end)[along]
    part = np.linspace(0.0, 1.0, 9)[:, None, None]
    rest = 1.0 - part
    line = rest**2 * start + 2.0 * part * rest * corner + part**2 * end
    line = line.swapaxes(0, 1).reshape(-1, 2)
    return line[np.isfinite(line).all(axis=1)]


def stays_at_rest(peak: float, start: Onset) -> bool:
    """Return whether an arch stays at rest under a horizontal motion with this peak [g]."""
    return peak <= start.least


def warn_if_in_g(motion: Motion, factor: float, start: Onset) -> None:
    """Warn if a motion leaves an arch at rest but would move it if its numbers were in g.

    There is no warning for a motion that was read from a file, since it is known to be in m/s2,
    nor for one with a vertical component, since it may move the arch.
    """
    peak = abs(factor) * motion.pga
    weak = stays_at_rest(peak / STANDARD_GRAVITY, start) and not stays_at_rest(
        peak, start
    )
    if weak and motion.vertical is None and not motion.facts.unit_in_file:
        warnings.warn(
            f"{motion.id or 'motion'}: its peak of {peak:.3g} m/s2 is not above the onset of "
            f"motion ({start.least:.3g} g), so the arch stays at rest; if it is "
            "in g, multiply it by 9.80665",
            UnitWarning,
            stacklevel=3,
        )


def own_time(arch: Arch) -> float:
    """Return the time scale of an arch [s]: the root of (shortest joint over gravity)."""
    return math.sqrt(model_of(arch.chain).length.min() / arch.chain.gravity)


def at_rest(arch: Arch) -> tuple[NDArray, NDArray]:
    """Return the position and velocity in which an arch is at rest, each (n_voussoir, 3)."""
    model = model_of(arch.chain)
    position = model.start[1 : model.end]
    return position.copy(), np.zeros_like(position)


def check_initial(initial, arch: Arch) -> tuple[NDArray, NDArray]:
    """Return the displacement and velocity of an initial state as arrays, each (n_voussoir, 3).

    InputError for another shape, a number that is not finite, or bodies that overlap.
    """
    try:
        shift, velocity = (np.array(part, float) for part in initial)
    except (TypeError, ValueError) as error:
        raise InputError(
            "initial must be a pair of arrays: position and velocity"
        ) from error
    shape = (arch.n_voussoir, 3)
    for name, part in (("position", shift), ("velocity", velocity)):
        if part.shape != shape or not np.isfinite(part).all():
            raise InputError(
                f"initial {name} has shape {part.shape}, must be {shape} and finite"
            )
    model, _, work = _placed(arch, shift)
    for j, corner in np.ndindex(arch.n_joint, 2):
        gap = clearance(j, corner, work) / model.length[j]
        if gap < -MOST_OVERLAP:
            raise InputError(
                f"initial position lets the bodies at {arch.place(j)} overlap by {-gap:.2g} of "
                f"its length at the {arch.corner_name(corner, j)}; at most {MOST_OVERLAP:g}, a "
                "rounding, is allowed"
            )
    return shift, velocity


def _placed(arch: Arch, shift: NDArray | float = 0.0) -> tuple[Model, State, Work]:
    """Return model, state and work of an arch, with bodies and joint faces shifted from rest.

    `shift` is the displacement of the bodies, (n_voussoir, 3) [m, m, rad].
    """
    model = model_of(arch.chain)
    state = new_state(model)
    work = new_work(model)
    state.position[:] = model.start
    state.position[1 : model.end] += shift
    move_faces(model, state.position, work)
    return model, state, work


def _mechanism(arch: Arch, limit: RestLimit) -> tuple[list[Hinge], list[int]]:
    """Return the hinges and the sliding joints of a limit of rest."""
    corners = [limit.mechanism & bit for bit in (HINGE_INTRADOS, HINGE_EXTRADOS)]
    hinges = [
        (j, arch.corner_name(c, j))
        for j, c in np.argwhere(np.transpose(corners)).tolist()
    ]
    return hinges, np.flatnonzero(limit.mechanism & SLIDING).tolist()


def static_limit(arch: Arch, start: Onset) -> float:
    """Return the rotation at which the mechanism of onset is in unstable equilibrium [rad].

    There the potential energy of the weight is largest. The mechanism is a four-hinge linkage, or
    the body above the one hinge of a block or a column. The rotation is that of the voussoir that
    rotates most; for a block it is arctan(width / height). It is the smaller one of the mechanisms
    towards +x and -x; a mechanism that slides or has other hinges does not count. nan if none
    counts.
    """
    limits = [np.inf]
    for towards in ("+x", "-x"):
        _, hinges, sliding = start.mechanism(towards)
        joints = {joint for joint, _ in hinges}
        alone = any(joints <= {*row} for row in joint_rows(arch))
        count = 1 if arch.free_end else 4
        if not sliding and len(hinges) == count and alone:
            limits += [_limit(arch, hinges, sense) for sense in (1.0, -1.0)]
    least = min(limits)
    return least if np.isfinite(least) else np.nan


def _limit(arch: Arch, hinges: list[Hinge], sense: float) -> float:
    """Return the static limit of one mechanism in one sense of rotation [rad].

    It is inf if the weight does not resist a rotation in this sense.
    """
    # Points of the plane are complex numbers: x + i y.
    points = np.array([*hinge_points(arch, hinges)]) @ [1.0, 1j]
    centroid = arch.centroids @ [1.0, 1j]
    joints = [*(joint for joint, _ in hinges), arch.n_joint]
    angle = sense * np.linspace(0.0, LARGEST_ROTATION, POSITIONS)
    placed = _linkage(points, angle) if len(points) == 4 else [(points[0], angle)]
    energy = np.zeros(angle.size)
    for pivot, (moved, rotation), first, last in zip(
        points, placed, joints, joints[1:]
    ):
        bodies = _bodies_of(arch, first, last)
        arm = np.exp(1j * rotation)[:, None] * (centroid[bodies] - pivot)
        height = (arm + np.reshape(moved, (-1, 1))).imag
        energy += height @ arch.chain.mass[bodies]
    left = np.isfinite(energy)
    end = int(np.argmin(left)) if not left.all() else angle.size
    rise = np.diff(energy[:end])
    if not rise.size or rise[0] <= 0.0:
        return np.inf
    place = float(rise.size)
    if (rise <= 0.0).any():
        top = int(np.argmax(rise <= 0.0))
        # The energy is a parabola about its top: its slope vanishes between two positions.
        place = top - 0.5 + rise[top - 1] / (rise[top - 1] - rise[top])
    return float(
        max(np.interp(place, np.arange(end), np.abs(r[:end])) for _, r in placed)
    )


def _linkage(
    points: NDArray[np.complex128], angle: FloatArray
) -> list[tuple[NDArray[np.complex128], FloatArray]]:
    """Return the place of the first hinge and the rotation [rad] for each of three bars.

    `points` are the four hinges as complex numbers [m]. The first bar rotates by `angle`. Results
    are nan at angles at which the bars cannot reach.
    """
    first, second, third, last = points
    moved = first + np.exp(1j * angle) * (second - first)
    distance = abs(last - moved)
    middle = abs(third - second)
    end = abs(last - third)
    along = (middle**2 - end**2 + distance**2) / (2.0 * distance)
    with np.errstate(invalid="ignore"):
        height = np.sqrt(middle**2 - along**2)
    side = np.sign(((third - second) * np.conj(last - second)).imag)
    knee = moved + (along + 1j * side * height) * (last - moved) / distance
    return [
        (first, angle),
        (moved, np.angle((knee - moved) / (third - second))),
        (knee, np.angle((last - knee) / (last - third))),
    ]
