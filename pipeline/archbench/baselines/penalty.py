"""The distinct element method with penalty springs, by explicit central differences.

Rigid voussoirs touch at the two corners of each joint through springs without tension and with
Coulomb's friction (Cundall and Strack 1979, *Geotechnique* 29; Cundall 1988, *Int. J. Rock Mech.
Min. Sci.* 25, as in UDEC; reviewed for masonry by Lemos 2007, *Int. J. Archit. Heritage* 1;
used for arches by De Lorenzis, DeJong and Ochsendorf 2007, *Earthq. Eng. Struct. Dyn.* 36).
The step is a part of the critical one, found from the highest frequency of the joints all closed.

Damping is proportional to stiffness: one proportional to mass also brakes motion as rigid bodies,
which nothing in dry masonry does, and the dashpots stand for what impacts dissipate (Vlachakis and
others 2021, *J. Eng. Mech.* 147(11)). A chain at rest is first brought to static equilibrium on
its springs; the energy balance starts there. Every step of the record is computed. After it, the
chain stands once no body has been faster than 1e-3 of the root of gravity times joint length for a
second. In the energy balance, the elastic energy belongs to the potential one, and what dashpots
take stands under impacts. The depth counts as 1 m, as a chain does not know it.
`docs/evidence.md` says what the method gets wrong.
"""

import numpy as np

from archbench.baselines.common import Case, case_of, end_at_rest, finish, stands, start
from archbench.baselines.springs import (
    Springs,
    Sum,
    highest_frequency,
    new_springs,
    press_joints,
    stiffness_matrix,
)
from archfrag.physics.contact.placing import move_faces, place_contacts
from archfrag.physics.ground import Grounds, Impulse, end_of_motion, impulse_between
from archfrag.physics.interface import Chain, Frames, MechanismLog, Options, Outcomes
from archfrag.physics.kernels.kernel import inlined, kernel
from archfrag.physics.shared import log_change
from archfrag.physics.state import Clock
from archfrag.physics.status import Count, Energy, Level, Wait
from archfrag.physics.steps.service import dominant_change, measure_state, write_if_due
from archfrag.physics.steps.step import (
    accept_step,
    count_changes,
    go_to_middle,
    make_step,
)

# A run of more steps than this is refused before it starts.
MOST_STEPS = 1e9
# The chain rests once, after the record, no body has been faster than this, over the square root
# of gravity times joint length, for so long [s]: longer than a rotating point of a motion lasts.
STILL = 1e-3
REST_SPAN = 1.0
# Energy made of nothing, over the largest kinetic energy, at which a run has diverged, and the
# same over weight times joint length, below which no motion has; below ROUNDING it is rounding.
DIVERGED = 0.5
SLIGHT = 1e-6
ROUNDING = 1e-12
# Slip over length after which contacts are far enough from where they were to ask for the
# critical step again.
SHIFT = 0.02
# Iterations to static equilibrium, and the part of their stiffness that open corners keep in it.
NEWTON_ITERATIONS = 200
OPEN_STIFFNESS = 0.02


@kernel
def pose_springs(case, springs):
    """Forces in the middle of the next step, and the velocities after it."""
    model = case.model
    state = case.state
    work = case.work
    time = state.clock[Clock.TIME]
    step = state.clock[Clock.STEP]
    impulse = impulse_between(case.grounds, state.clock, time, time + step)
    go_to_middle(model, state, work, step)
    press_joints(model, state, work, springs, step)
    for i in range(1, state.position.shape[0] - 1):
        fall = impulse.y + step * model.gravity
        for c in range(3):
            mass = model.inertia[i] if c == 2 else model.mass[i]
            outer = impulse.x if c == 0 else (fall if c == 1 else 0.0)
            momentum = step * springs.total[i, c] - mass * outer
            work.solved[i, c] = state.velocity[i, c] + momentum / mass
    return impulse


@kernel
def gather_reactions(case, springs, span):
    """Impulses of the joints over a time `span` [s], about their pivots."""
    work = case.work
    reaction = case.work.reaction
    place_contacts(case.model, case.state.slip, work)
    reaction[:, :] = 0.0
    for j in range(work.slide.size):
        for k in range(2):
            if work.contact[j, k] > 0.5:
                fx = span * springs.force[j, k, 0]
                fy = span * springs.force[j, k, 1]
                px = springs.point[j, k, 0] - work.pivot[j, 0]
                py = springs.point[j, k, 1] - work.pivot[j, 1]
                reaction[j, 0] += fx
                reaction[j, 1] += fy
                reaction[j, 2] += px * fy - py * fx


@kernel
def balance_energy(case, springs, impulse):
    """Bring the energy balance up to the middle of the next step; False if the run diverges.

    The kinetic energy is that which central differences conserve with the elastic one: half the
    mass times the velocities before and after.
    """
    model = case.model
    state = case.state
    sums = springs.sums
    energy = case.state.energy
    if (
        sums[Sum.FRICTION] + sums[Sum.DAMPING] <= 0.0
    ):  # what both gave in sum stays an error
        energy[Energy.FRICTION] += sums[Sum.FRICTION]
        energy[Energy.IMPACT] += sums[Sum.DAMPING]
    sums[Sum.FRICTION] = sums[Sum.DAMPING] = 0.0
    has = sums[Sum.ELASTIC] - state.clock[Clock.START] - energy[Energy.START_KINETIC]
    weight = 0.0
    for i in range(1, state.position.shape[0] - 1):
        old = state.velocity[i]
        new = case.work.solved[i]
        m = model.mass[i]
        has += 0.5 * m * (old[0] * new[0] + old[1] * new[1])
        has += 0.5 * model.inertia[i] * old[2] * new[2]
        has += m * model.gravity * (case.work.position[i, 1] - model.centroid[i, 1])
        # Half of this kick's work belongs to the time before.
        has += 0.5 * m * (impulse.x * old[0] + impulse.y * old[1])
        weight += m * model.gravity
    given = energy[Energy.GROUND] + energy[Energy.FRICTION] + energy[Energy.IMPACT]
    energy[Energy.BALANCE_ERROR] = has - given
    balance_error = abs(has - given)
    scale = weight * model.length[0]
    if balance_error > ROUNDING * scale:
        energy[Energy.BALANCE_ERROR_PEAK] = max(
            energy[Energy.BALANCE_ERROR_PEAK], balance_error
        )
    return balance_error <= max(
        DIVERGED * energy[Energy.LARGEST_KINETIC], SLIGHT * scale
    )


@inlined
def _largest_slip(model, state):
    """Largest slip of any joint up to now, over its length [1]."""
    largest = 0.0
    for j in range(state.slip.size):
        largest = max(largest, abs(state.slip[j]) / model.length[j])
    return largest


@kernel
def take_counted(case, impulse, where):
    """Take a step and count the changes of its joints; springs account for their work."""
    count_changes(case.model, case.state, case.work, where)
    return make_step(case, impulse, where)


@kernel
def make_steps(case, springs, most, shifted):
    """Step until the critical step has to be asked for again, or the run is over."""
    model = case.model
    state = case.state
    work = case.work
    output = case.output
    clock = state.clock
    options = case.options
    until = end_of_motion(case.grounds, clock, options.follow)
    while clock[Clock.CODE] == Wait.GO:
        impulse = pose_springs(case, springs)
        time = clock[Clock.TIME]
        checks = int(state.count[Count.STEPS]) % options.check_interval == 0
        if checks and not balance_energy(case, springs, impulse):
            clock[Clock.CODE] = Wait.BROKEN
            return
        if checks or (output.frames.time.size > 0 and time >= output.due[0]):
            gather_reactions(case, springs, clock[Clock.STEP])
        write_if_due(model, state, work, output)
        cause, joint = dominant_change(state, work)
        collapsed, broken = accept_step(case, impulse, True)
        if checks:
            measure_state(model, state, work)
        if cause >= 0:
            log_change(state, time, cause, joint, Level.ALL_VOUSSOIRS, output)
        if broken or collapsed:
            clock[Clock.CODE] = Wait.BROKEN if broken else Wait.COLLAPSES
        elif stands(state, options, until, springs.moved, REST_SPAN):
            end_at_rest(state, output)
        elif clock[Clock.TIME] >= until:
            clock[Clock.CODE] = Wait.AT_END
        elif state.count[Count.STEPS] >= most:
            clock[Clock.CODE] = Wait.EXHAUSTED
        elif _largest_slip(model, state) > shifted + SHIFT:
            clock[Clock.CODE] = Wait.PAUSE


@kernel
def end_steps(case, springs):
    """Bring the energy balance up to the end."""
    model = case.model
    state = case.state
    work = case.work
    clock = case.state.clock
    if int(clock[Clock.CODE]) not in (Wait.COLLAPSES, Wait.AT_END, Wait.IDLE):
        return
    for i in range(state.position.shape[0]):
        for c in range(3):
            work.position[i, c] = state.position[i, c]
            work.solved[i, c] = state.velocity[i, c]
    press_joints(model, state, work, springs, 0.5 * clock[Clock.STEP])
    if not balance_energy(case, springs, Impulse(0.0, 0.0)):
        clock[Clock.CODE] = Wait.BROKEN
        return
    gather_reactions(case, springs, 1.0)
    measure_state(model, state, work)


def damp(case: Case, springs: Springs) -> None:
    """Bring a chain at rest on unloaded springs to its equilibrium under its weight.

    By Newton's iteration, with some stiffness left to open corners. Where it does not converge,
    soft springs do not bear the chain; it is left where it was.
    """
    model = case.model
    state = case.state
    work = case.work
    weight = model.gravity * np.stack(
        [0.0 * model.mass, model.mass, 0.0 * model.mass], axis=1
    )
    rounding = springs.normal_stiffness.max() * model.rounding
    undamped = springs._replace(damping=0.0)
    start = state.position.copy()
    for number in range(NEWTON_ITERATIONS):
        work.contact[:] *= number > 0
        work.position[:] = state.position
        press_joints(model, state, work, undamped, 1.0)
        force = (springs.total - weight)[1:-1] if number > 0 else -weight[1:-1]
        if np.abs(force / (1.0, 1.0, model.length[0])).max() < rounding:
            break
        part = np.maximum(work.contact, OPEN_STIFFNESS if number > 0 else 1.0)
        stiffness = stiffness_matrix(model, state, work, springs, part)
        state.velocity[1:-1] = np.linalg.solve(stiffness, force.ravel()).reshape(-1, 3)
        state.position[:] += state.velocity
        move_faces(model, state.position, work)
    else:
        state.position[:] = start
        for array in (springs.shear, springs.dashpot, work.contact):
            array[:] = 0.0
    state.velocity[:] = 0.0
    move_faces(model, state.position, work)


def critical_step(frequency: float, damping: float) -> float:
    """Largest stable step [s] at the highest frequency [rad/s] with dashpots over springs [s].

    Central differences with lagging dashpots are stable up to
    ``2 / omega (sqrt(1 + xi^2) - xi)`` at the highest frequency omega and its damping ratio xi
    (Belytschko, Liu and Moran 2000, *Nonlinear Finite Elements*, section 6.6).
    """
    ratio = 0.5 * damping * frequency
    return 2.0 / frequency * float(np.sqrt(1.0 + ratio * ratio) - ratio)


def _start(case: Case, springs: Springs, from_rest: bool) -> float:
    """Load the springs; returns their elastic energy, where the energy balance starts [J]."""
    model = case.model
    state = case.state
    work = case.work
    if from_rest:
        damp(case, springs)
    work.contact[:] = state.contact
    work.slide[:] = state.slide
    work.position[:] = state.position
    press_joints(model, state, work, springs, 0.0)
    state.contact[:] = work.contact
    state.slide[:] = work.slide
    elastic = float(springs.sums[Sum.ELASTIC])
    springs.sums[:] = 0.0
    height = (state.position[1:-1, 1] - model.centroid[1:-1, 1]) @ model.mass[1:-1]
    state.clock[Clock.START] = elastic + model.gravity * height
    return elastic


def run(
    chain: Chain,
    grounds: Grounds,
    factor: float,
    position: np.ndarray,
    velocity: np.ndarray,
    from_rest: bool,
    options: Options,
    frames: Frames,
    log: MechanismLog,
    stiffness: float,
    shear_ratio: float,
    damping_stiffness: float,
    step_fraction: float,
    rounding: float,
) -> Outcomes:
    """Integrate one chain; arguments and result as `archfrag.physics.steps.run.run`.

    ``options.max_steps`` counts steps of its size; smaller ones are allowed as many more.
    """
    case = case_of(chain, grounds, factor, False, options, frames, log)
    model = case.model
    state = case.state
    work = case.work
    still = STILL * float(np.sqrt(model.gravity * model.length[0]))
    law = case.law._replace(accept=take_counted)
    case = case._replace(law=law, options=case.options._replace(still=still))
    start(case, position, velocity, False)
    springs = new_springs(model, stiffness, shear_ratio, rounding)
    frequency = highest_frequency(model, state, work, springs)
    springs = springs._replace(damping=2.0 * damping_stiffness / frequency)
    clock = state.clock
    nominal = options.time_step
    until = (grounds.horizontal.size - 1) * grounds.time_step[0] + options.follow
    elastic = np.nan
    while clock[Clock.CODE] == Wait.GO:
        critical = critical_step(frequency, springs.damping)
        parts = max(np.ceil(nominal / (step_fraction * critical)), 1.0)
        clock[Clock.STEP] = nominal / parts
        most = state.count[Count.STEPS] + parts * (
            options.max_steps - clock[Clock.TIME] / nominal
        )
        if not until * parts < MOST_STEPS * nominal:
            clock[Clock.CODE] = Wait.EXHAUSTED
            break
        if np.isnan(elastic):
            elastic = _start(case, springs, from_rest)
        make_steps(
            case, springs, float(most), float((abs(state.slip) / model.length).max())
        )
        if clock[Clock.CODE] == Wait.PAUSE:
            clock[Clock.CODE] = Wait.GO
            frequency = highest_frequency(model, state, work, springs)
    end_steps(case, springs)
    results = finish(case, position, velocity)
    results.energy[0, Energy.POTENTIAL] += springs.sums[Sum.ELASTIC] - elastic
    return results
