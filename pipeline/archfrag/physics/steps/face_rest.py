"""Rest on joints that give: the first mode, and the equilibrium under the weight where runs start.

Equilibrium is found by implicit steps from rest. Each of them starts with no velocity and ends at
the instant at which the laws of the joints are asked. Without friction each lowers the energy, so
that a chain that can rest comes to rest, and one that cannot moves on.
"""

import functools
import math

import numpy as np

from archfrag.physics.contact.placing import relative_velocity
from archfrag.physics.ground import Impulse
from archfrag.physics.interface import Chain, pairs_of
from archfrag.physics.kernels.kernel import kernel
from archfrag.physics.numbers import larger
from archfrag.physics.state import KEPT, Clock, Model, model_of
from archfrag.physics.status import Joint, Status
from archfrag.physics.steps.face_law import Faces, overlap_moments
from archfrag.physics.steps.face_step import LEAST_DELAY, new_face_runs, remember
from archfrag.physics.steps.face_velocities import find_velocities
from archfrag.physics.steps.step import pose_step

# Steps to equilibrium, over the period of the first mode: the first, how they grow, the largest.
FIRST_STEP = 0.1
GROWTH = 1.3
LARGEST_STEP = 20.0
# Equilibrium is reached if no body moves by more than SETTLED joint lengths in a step of at least
# LONG_ENOUGH periods. There is none if a body has moved by FAR joint lengths. At most MOST_STEPS
# are made.
SETTLED = 1e-9
LONG_ENOUGH = 0.5
FAR = 0.5
MOST_STEPS = 4000
BALANCED = 1e-9
# A chain rests if, after the motion, its mean speed stays below STILL and that of every body below
# FASTEST_STILL, both times the root of gravity times joint length. It must do so for REST_SPAN
# times the root of its size over gravity: a turning point lasts less long, and a loose voussoir
# rattles for long.
STILL = 1e-2
FASTEST_STILL = 3e-2
REST_SPAN = 2.0
RESTS = int(Status.STANDING)
FALLS = int(Status.DOES_NOT_STAND)
MOVES_ON = int(Status.NO_CONTACT_SOLUTION)
# Steps may damp the first mode by so much more than is asked: a part of the critical damping, and
# a part of what is asked.
DAMPED_MORE = 0.01
DAMPED_MORE_OF = 0.1
# Largest stiffness of a joint times the square of a step, over the mass of the lightest body.
STIFFEST = 2000.0


def first_frequency(model: Model, chain: Chain) -> float:
    """Return the frequency of the first mode [Hz].

    All joints are closed, and as stiff as at first contact.
    """
    assert chain.joint is not None
    n_row = model.mass.size
    bodies = slice(1, model.end)
    pair = pairs_of(len(chain.joint), chain.body)
    kept = []
    for j, (k, along, _, points) in enumerate(chain.joint.tolist()):
        length = float(model.length[j])
        _, _, turn = overlap_moments(-1.0, 0.0, 0.5 * length, points)
        tx, ty = model.tangent[j, 0]
        for (dx, dy, w), size in (
            ((ty, -tx, 0.0), k * length),
            ((tx, ty, 0.0), along * length),
            ((0, 0, 1.0), k * turn),
        ):
            row = np.zeros((n_row, 3))
            for side, sign in enumerate((-1.0, 1.0)):
                x, y = model.corner[j, side].mean(axis=0)
                turns = sign * (w + x * dy - y * dx)
                row[pair[j, side] + 1] = sign * dx, sign * dy, turns
            kept.append(math.sqrt(size) * row[bodies].ravel())
    inverse = np.stack(
        [model.inverse_mass, model.inverse_mass, model.inverse_inertia], axis=1
    )
    rows = np.array(kept) * np.sqrt(inverse[bodies].ravel())
    return math.sqrt(max(float(np.linalg.eigvalsh(rows.T @ rows)[0]), 0.0)) / (
        2.0 * math.pi
    )


def damping_of_steps(chain: Chain, step: float) -> float:
    """Return the damping ratio that steps [s] give to the first mode if none is asked for."""
    return math.pi * first_frequency(model_of(chain), chain) * LEAST_DELAY * step


def longest_step(chain: Chain) -> float:
    """Return the longest step that may be made [s].

    With it the first mode is hardly damped by more than is asked, and the velocities of stiff
    joints are found.
    """
    assert chain.joint is not None
    stiffness = (chain.joint[:, Joint.STIFFNESS] * model_of(chain).length).max()
    asked = float(chain.joint[0, Joint.DAMPING])
    more = max(DAMPED_MORE_OF * asked, DAMPED_MORE - DAMPED_MORE_OF * asked)
    solved = math.sqrt(STIFFEST * float(chain.mass.min()) / float(stiffness))
    return min(solved, (asked + more) / damping_of_steps(chain, 1.0))


@kernel
def settle(runs, period, limit):
    """Bring a chain from where it is to equilibrium under its weight; return whether it rests.

    `period` is that of the first mode [s], and `limit` a joint's length [m]. The result is RESTS,
    FALLS, or MOVES_ON if the chain does neither in the most steps.
    """
    model = runs.model
    state = runs.state
    work = runs.work
    step = FIRST_STEP * period
    still = Impulse(0.0, 0.0)
    for _ in range(MOST_STEPS):
        state.velocity[:] = 0.0
        state.clock[Clock.STEP] = step
        pose_step(runs, still)
        # What is not balanced moves bodies by its acceleration times the square of the step.
        balanced = BALANCED * min(1.0, (period / step) ** 2)
        solved, _ = find_velocities(runs, step, step, balanced, True)
        if not solved:
            step *= 0.25
            continue
        relative_velocity(
            runs.model, work.position, work.solved, work.pivot, work.relative
        )
        stored = moved = away = 0.0
        for j in range(state.slip.size):
            stored += remember(j, runs, (step, step), True)[0]
        for i in range(1, model.end):
            for c in range(3):
                size = model.length[0] if c == 2 else 1.0
                change = step * work.solved[i, c]
                state.position[i, c] += change
                moved = larger(moved, size * abs(change))
                away = larger(
                    away, size * abs(state.position[i, c] - model.start[i, c])
                )
        state.clock[Clock.STORED] = stored
        if away > FAR * limit or math.isnan(away):
            return FALLS
        if moved < SETTLED * limit and step >= LONG_ENOUGH * period:
            return RESTS
        step = min(GROWTH * step, LARGEST_STEP * period)
    return MOVES_ON


@functools.lru_cache(maxsize=KEPT)
def settled(chain: Chain) -> tuple[Model, Faces] | Status:
    """Return the model of a chain in equilibrium on joints that give, and its `Faces`.

    If there is no equilibrium, return a status: that the chain falls, or that the steps find
    neither. The model starts in equilibrium. Results are cached.
    """
    assert chain.joint is not None
    model = model_of(chain)
    joint = np.ascontiguousarray(chain.joint.T)
    frequency = first_frequency(model, chain)
    square = float(model.gravity * model.length.max())
    # A slender body is as long as its radius of gyration says.
    longest = np.sqrt(12.0 * (chain.inertia / chain.mass).max())
    size = float(np.ptp(chain.centroid, axis=0).max() + longest)
    zeros = np.zeros(model.friction.size)
    faces = Faces(
        stiffness=joint[Joint.STIFFNESS].copy(),
        shear=joint[Joint.SHEAR].copy(),
        slip=np.zeros((zeros.size, 3)),
        touching=zeros,
        half=zeros.copy(),
        stored=0.0,
        delay=0.0,
        points=float(joint[Joint.POINTS, 0]),
        calm=REST_SPAN * math.sqrt(size / chain.gravity),
        sway=0.5 * STILL**2 * square * float(chain.mass.sum()),
        still=FASTEST_STILL * math.sqrt(square),
    )
    runs = new_face_runs(model, faces)
    runs.state.position[:] = model.start
    runs.memory.touching[:] = model.length
    found = settle(runs, 1.0 / frequency, float(model.length.min()))
    if found != RESTS:
        return Status(found)
    rest = faces._replace(
        **runs.memory._asdict(),
        stored=float(runs.state.clock[Clock.STORED]),
        delay=float(joint[Joint.DAMPING, 0]) / (math.pi * frequency),
    )
    return model._replace(start=runs.state.position.copy()), rest
