"""Arguments of kernels: the constant model, the state of a run, and workspace.

The arrays of state and workspace hold one run, or four (`physics.kernels.primitives.LaneArray`).
Rows count bodies with the ground: row 0 is the ground of the left base, row i the i-th body, the
rows from ``Model.end`` on are the grounds of the other bases, the right one last. Joint j lies
between the rows ``Model.body[j]``, or j and j + 1 where that is None; a chain with a free end has
no joint before the last row.

Kernels take model, state, work, options and output in this order; `model`, `state` and `work` are
those below unless a docstring says otherwise.
"""

import functools
from collections.abc import Callable
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy import ndarray

from archfrag.physics.interface import Chain
from archfrag.physics.kernels.structs import struct
from archfrag.physics.status import Count, Energy, Loss, Peak, Tie, TieState, TieWork

# Gaps of this size, relative to the coordinates, are rounding. A closed ring is overdetermined:
# it would answer them with reactions of any size.
ROUNDING = 64 * 2.2e-16
KEPT = 1024  # chains whose model, rest or range of rest is kept

Zeros = Callable[[tuple[int, ...]], Any]


@struct(
    body=(2,),
    centroid=(2,),
    ahead=(2,),
    corner=(2, 2, 2),
    tangent=(2, 2),
    ray=(2,),
    start=(3,),
    tie=(len(Tie),),
)
class Model(NamedTuple):
    """Constant data of a chain of rigid bodies."""

    # Of a bridge of several spans; None for a row, see `archfrag.physics.neighbours`.
    body: ndarray | None  # (n_joint, 2) rows of the bodies before and after each joint
    # (n_joint,) at the spine's joints on either side of a top course, the joint of its pier
    # below; else -1
    bed: ndarray | None
    # (n_row, 2) the last joint of each body to be eliminated, and the row on its other side;
    # at least ``end`` for a ground
    ahead: ndarray | None
    mass: ndarray  # (n_body + 2,) [kg]; zero for the ground
    inertia: ndarray  # (n_body + 2,) about the centroid [kg m2]; zero for the ground
    inverse_mass: ndarray  # (n_body + 2,) [1/kg]; zero for the ground
    inverse_inertia: ndarray  # (n_body + 2,) [1/(kg m2)]; zero for the ground
    centroid: ndarray  # (n_body + 2, 2) at rest [m]; zero for the ground
    corner: (
        ndarray  # (n_joint, 2, 2, 2) side, corner, xy: faces in the bodies' frames [m]
    )
    tangent: (
        ndarray  # (n_joint, 2, 2) side, xy: unit tangents in the bodies' frames [1]
    )
    length: ndarray  # (n_joint,) the shorter face [m]
    friction: (
        ndarray  # (n_joint,) Coulomb coefficient; inf: the limit of large friction [1]
    )
    ray: ndarray  # (n_joint, 2) normal and tangential part of a sliding reaction [1]
    start: ndarray  # (n_body + 2, 3) where a run begins: centroid [m] and rotation
    tie: ndarray  # (n_tie, len(Tie)) by archfrag.physics.status.Tie
    end: int  # n_body + 1, the first row of ground behind the bodies
    gravity: float  # [m/s2]
    rounding: float  # gaps smaller than this count as zero [m]


@struct(
    position=(3,),
    velocity=(3,),
    contact=(2,),
    force=(3,),
    tie=(len(TieState),),
)
class State(NamedTuple):
    """State of one run, or of four side by side, whose array elements hold four numbers each."""

    position: ndarray  # (n_body + 2, 3) centroid [m] and rotation [rad]
    velocity: ndarray  # (n_body + 2, 3) relative to the ground [m/s], [rad/s]
    contact: ndarray  # (n_joint, 2) one where a corner is in contact, else zero
    force: ndarray  # (n_joint, 3) mean reactions of the last step; zero if it held an impact
    tie: ndarray  # (n_tie, len(TieState)) by archfrag.physics.status.TieState
    slide: ndarray  # (n_joint,) sense of the friction force along the tangent, zero: sticks
    slip: ndarray  # (n_joint,) along the tangent, where last in contact [m]
    bore_face: ndarray  # (n_joint,) one where the last contact was at both corners
    lost_since: ndarray  # (n_joint,) when contact was lost last [s]; nan before
    lost_slip: ndarray  # (n_joint,) slip over length at that instant [1]
    lost_rotation: ndarray  # (n_joint,) relative rotation at that instant [rad]
    impact: ndarray  # (n_joint,) one while an impact goes on after a step, else zero
    loss: ndarray  # (len(Loss),) by archfrag.physics.status.Loss
    clock: ndarray  # (len(Clock),)
    # (len(Count),) by archfrag.physics.status.Count
    count: ndarray  # type: ignore[assignment]
    energy: ndarray  # (len(Energy),) [J]
    peak: ndarray  # (len(Peak),)


class Clock(IntEnum):
    """Indices into ``State.clock``; the comment at each says what is stored there."""

    TIME = 0  # time of positions and velocities [s]
    STEP = 1  # size of the next step [s]
    IMPACT = 2  # time at which the next impact is expected [s]
    FASTEST = 3  # largest speed of any body, rotation times joint length included [m/s]
    MOVING = 4  # time spent moving so far [s]
    RESTING = 5  # time spent at rest so far [s]
    MOTION = 6  # number of the ground motion that moves the chain
    FACTOR = 7  # factor on that ground motion
    CODE = 8  # `Wait`: why the run waits or has ended; zero: it goes on
    START = 9  # potential energy of the initial state [J]
    ITERATIONS = 10  # linear problems solved so far for a step whose modes still change
    # last time at which a chain with ties, see `energy.record_calm`, or on joints that give was
    # not calm [s]
    LIVELY = 11
    NOTED = 12  # time at which to note whether the chain still moves; 0: never [s]
    RUN = 13  # number of the run
    STORED = 14  # elastic energy of joints that give [J]
    STORED_FIRST = 15  # the same at the start of the run [J]


@struct(
    face=(2, 2, 2),
    tangent=(2, 2),
    rotated=(2,),
    point=(2, 2),
    pivot=(2,),
    normal=(2,),
    side_normal=(2, 2, 2),
    candidate=(2,),
    bias=(2, 2),
    free=(3,),
    solved=(3,),
    contact=(2,),
    asked_contact=(2,),
    row=(3, 4),
    column=(3, 4),
    block=(3, 3),
    lower=(3, 3),
    fork=(2, 3, 3),
    upper=(3, 3),
    unknown=(3,),
    residual=(3,),
    reaction=(3,),
    relative=(3,),
    earlier=(3,),
    corner_rate=(2, 2),
    position=(3,),
    tie=(len(TieWork),),
)
class Work(NamedTuple):
    """Workspace of one step."""

    face: ndarray  # (n_joint, 2, 2, 2) side, corner, xy: where the faces are [m]
    tangent: ndarray  # (n_joint, 2, 2) side, xy: their unit tangents
    slip: ndarray  # (n_joint,) where contacts hold in this step [m]
    rotated: ndarray  # (n_body + 2, 2) cosine and sine of the rotations
    point: ndarray  # (n_joint, 2, 2) corner, xy: contact points [m]
    pivot: ndarray  # (n_joint, 2) halfway between the contact points [m]
    normal: ndarray  # (n_joint, 2) common normal of a closed joint
    side_normal: (
        ndarray  # (n_joint, 2, 2, 2) corner, PLUS or MINUS, xy: Eqs 23a and 23b
    )
    candidate: ndarray  # (n_joint, 2) one where the corner may touch in this step
    known: ndarray  # (n_joint,) sense of the friction of a slip in progress; zero: not known
    bias: ndarray  # (n_joint, 2, 2) corner, xy: added to the relative velocity [m/s]
    free: ndarray  # (n_body + 2, 3) velocities without reactions
    solved: ndarray  # (n_body + 2, 3) velocities that the contact problem gives
    contact: ndarray  # (n_joint, 2) modes that the contact problem is solved for
    slide: ndarray  # (n_joint,) and their sense of friction, as in ``State.slide``
    asked_contact: ndarray  # (n_joint, 2) modes that the solution asks for
    asked_slide: ndarray  # (n_joint,) and their sense of friction
    # (n_joint, 3, 4) constrained directions: x, y, lever arms about the centroids of the body
    # after and of the body before
    row: ndarray
    column: ndarray  # (n_joint, 3, 4) directions of the reactions, as in `row`
    block: ndarray  # (n_joint, 3, 3) eliminated diagonal blocks, reciprocals on the diagonal
    lower: ndarray  # (n_joint, 3, 3) coupling with the joint before
    # (n_joint, 2, 3, 3), (0, 2, 3, 3) for one span: coupling with the joint ``Model.bed``, and
    # the eliminated coupling of that joint with this one
    fork: ndarray
    upper: ndarray  # (n_joint, 3, 3) eliminated coupling with the next joint
    unknown: ndarray  # (n_joint, 3) multipliers
    residual: ndarray  # (n_joint, 3) velocities left along the constrained directions
    # (n_joint, 3) on the body after: x, y, moment about the pivot; impulses until a step is made,
    # then forces
    reaction: ndarray
    relative: ndarray  # (n_joint, 3) relative velocity at the pivot
    earlier: ndarray  # (n_joint, 3) relative velocity at the pivot before the step
    corner_rate: ndarray  # (n_joint, 2, 2) corner, xy: relative velocity with bias
    position: ndarray  # (n_body + 2, 3) positions in the middle of the step
    tie: ndarray  # (n_tie, len(TieWork)) by archfrag.physics.status.TieWork
    # (n_tie + 1, n_body + 2 + n_joint, 3) velocities and reactions that a unit impulse of each tie
    # causes; in the last row those without ties
    tie_answer: ndarray
    tie_system: ndarray  # (n_tie, n_tie + 1) equations for the impulses of ties


class Law(NamedTuple):
    """Kernels of a law of joints; they are bound when a kernel that takes `Runs` is compiled."""

    pose: Any  # (runs, step): set up the middle of a step
    solve: Any  # (runs, live): find the velocities after it; returns solved, unsolved
    accept: Any  # (runs, impulse, where): take the solved ones; returns collapsed
    go_on: Any  # (runs, until, outcome): set the size of the next step, and the code
    start: Any  # (runs, output): start where the model does; returns the code
    handle: Any  # (runs, output): do for one run what it waits for; returns the code


@struct()
class Runs(NamedTuple):
    """One run, or four side by side: all that kernels of the stepper take."""

    law: Law
    model: Model
    state: State
    work: Work
    # views (n, 1) or (n, 4) of the arrays whose values a run keeps, with a column for each run
    columns: tuple[ndarray, ...]
    grounds: Any = ()  # archfrag.physics.ground.Grounds
    options: Any = ()  # archfrag.physics.interface.Options
    path: Any = ()  # of rigid joints: archfrag.physics.contact.path.Path
    # Of joints that give: `Faces` of archfrag.physics.steps.face_law, `Memory` and `FaceWork` of
    # archfrag.physics.steps.face_velocities.
    faces: Any = ()
    memory: Any = ()
    own: Any = ()


@functools.lru_cache(maxsize=KEPT)
def model_of(chain: Chain) -> Model:
    """Return the model of a chain, with the ground before and behind it.

    Models are cached, so their arrays are read-only.
    """
    model = new_model(chain)
    for values in model:
        if isinstance(values, ndarray):
            values.flags.writeable = False
    return model


def new_model(chain: Chain) -> Model:
    """Make a new model of a chain, whose arrays may be changed."""

    n_body = chain.mass.size
    n_joint = chain.friction.size
    n_row = n_body + 2 if chain.body is None else int(chain.body.max()) + 2
    row = None if chain.body is None else chain.body + 1

    def framed(values: ndarray) -> ndarray:
        around = [(1, n_row - 1 - n_body), *[(0, 0)] * (values.ndim - 1)]
        return np.pad(values, around)

    assert n_joint in (n_body, n_row - 1)
    corner = np.ascontiguousarray(
        np.stack([chain.face_before, chain.face_after], axis=1)
    )
    along = corner[:, :, 1] - corner[:, :, 0]
    sizes = np.hypot(along[..., 0], along[..., 1])
    rough = np.isinf(chain.friction)
    ray = [np.where(rough, 0.0, 1.0), np.where(rough, 1.0, chain.friction)]
    start = chain.start
    if start is None:
        start = np.pad(chain.centroid, [(0, 0), (0, 1)])
    tie = () if chain.tie is None else chain.tie
    return Model(
        body=row,
        bed=None if row is None else _beds_of(row, n_body + 1),
        ahead=None if row is None else _ahead_of(row, n_row),
        end=n_body + 1,
        mass=framed(chain.mass),
        inertia=framed(chain.inertia),
        inverse_mass=framed(1.0 / chain.mass),
        inverse_inertia=framed(1.0 / chain.inertia),
        centroid=framed(chain.centroid),
        corner=corner,
        tangent=along / sizes[..., None],
        length=sizes.min(axis=1),
        friction=np.array(chain.friction, float),
        ray=np.stack(ray, axis=1),
        start=framed(start),
        tie=np.array(tie, float).reshape(-1, len(Tie)),
        gravity=float(chain.gravity),
        rounding=ROUNDING * float(np.abs(chain.centroid).max()),
    )


def _beds_of(row: ndarray, end: int) -> ndarray:
    """Return `Model.bed` for the rows of the bodies at each joint."""
    bed = np.full(len(row), -1)
    for j, (_, after) in enumerate(row):
        later = np.flatnonzero(row[j + 2 :, 0] == after) + j + 2
        if after < end and later.size:
            bed[later[0] - 1 : later[0] + 1] = j
    return bed


def _ahead_of(row: ndarray, n_row: int) -> ndarray:
    """Return `Model.ahead` for the rows of the bodies at each joint."""
    ahead = np.full((n_row, 2), n_row)
    for j, (before, after) in enumerate(row):
        ahead[before] = j, after
    return ahead


def allocate(kind, model: Model, zeros: Zeros, **first: int):
    """Allocate an instance of the struct `kind`.

    `zeros` makes an array of zeros of a shape. The first dimension of a field is the number of
    joints, unless `first` has another one by the field's name.
    """
    n_joint = model.friction.size
    return kind(
        *(
            zeros((first.get(name, n_joint), *kind.shapes.get(name, ())))
            for name in kind._fields
        )
    )


def new_state(model: Model, zeros: Zeros = np.zeros) -> State:
    """Allocate the state of one run, or of several with `lane_array` as `zeros`."""
    n_row = model.mass.size
    sizes = {"loss": Loss, "clock": Clock, "count": Count, "energy": Energy}
    first = {name: len(entries) for name, entries in sizes.items()}
    first |= {"position": n_row, "velocity": n_row}
    first |= {"peak": len(Peak), "tie": len(model.tie)}
    state: State = allocate(State, model, zeros, **first)
    return state


def new_work(model: Model, zeros: Zeros = np.zeros) -> Work:
    """Allocate the workspace of one run, or of several with `lane_array` as `zeros`."""
    n_row = model.mass.size
    n_tie = len(model.tie)
    rows = dict.fromkeys(("rotated", "free", "solved", "position"), n_row)
    rows["fork"] = 0 if model.bed is None else model.friction.size
    work: Work = allocate(Work, model, zeros, tie=n_tie, **rows)
    columns_of(work.rotated)[::2] = 1.0
    return work._replace(
        tie_answer=zeros((n_tie and n_tie + 1, n_row + model.friction.size, 3)),
        tie_system=zeros((n_tie, n_tie + 1)),
    )


def columns_of(array: ndarray) -> ndarray:
    """View an array as floats, with one column for each run: (n, 1) or (n, 4)."""
    plain = array.reshape(-1).view(ndarray).view(float)
    return plain.reshape(-1, array.itemsize // plain.itemsize)


def new_runs(law: Law, model: Model, zeros: Zeros = np.zeros, **own) -> Runs:
    """Allocate one run, or several with `lane_array` as `zeros`.

    `own` has the fields of `Runs` that its law needs besides.
    """
    state = new_state(model, zeros)
    work = new_work(model, zeros)
    arrays = (*state, work.reaction, work.pivot, *own.get("memory", ()))
    return Runs(law, model, state, work, tuple(map(columns_of, arrays)), **own)
