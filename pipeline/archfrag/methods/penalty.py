"""The distinct element method with penalty springs, by explicit central differences.

Rigid voussoirs touch at the two corners of each joint through springs without tension and with
Coulomb's friction (Cundall and Strack 1979, *Geotechnique* 29; Cundall 1988, *Int. J. Rock Mech.
Min. Sci.* 25, as in UDEC; reviewed for masonry by Lemos 2007, *Int. J. Archit. Heritage* 1;
used for arches by De Lorenzis, DeJong and Ochsendorf 2007, *Earthq. Eng. Struct. Dyn.* 36).
The step is a part of the critical one, found from the highest frequency of the joints all closed.

Damping is Rayleigh's or Cundall's local one. By default it is proportional to stiffness only: a
mass-proportional or local one also brakes motion as rigid bodies, which nothing in dry masonry
does, and the dashpots stand for what impacts dissipate (Vlachakis and others 2021, *J. Eng.
Mech.* 147(11)); the price is a smaller critical step. A chain at rest is settled first on its
springs by Newton's iteration, or by dynamic relaxation with local damping where that fails, so
that the weight comes without a jolt; the account starts there. There is no rest test in the
record: every step is computed. After it, the chain stands once no body has been faster than
1e-3 of the root of gravity times joint length for a second; elastic ringing below that is rest.

In the account, the elastic energy belongs to the potential one, and what dashpots and the other
damping take stands under impacts. A run whose account is open by half of
the largest kinetic energy has diverged, and has no verdict.

What it gets wrong, measured on the arch of validation A (7 voussoirs; tp 0.3 s) at default damping
and step, for stiffnesses of 1e9, 1e10, 1e11 and 1e12 Pa/m; rigid voussoirs by time stepping:

- Joints that give make the early motion too large: the keystone's displacement under 0.5 g at
  0.4 s, before any impact, by 61, 20, 6.4 and 2.3 %, as the root of stiffness.
- Collapse starts at 0.69, 0.70, 0.67 and 0.67 g (rigid: 0.68), but verdicts are not monotone (at
  1e10 Pa/m it stands again at 0.72 and 0.73 g), and damping shifts them: 0.65 to 0.72 g at
  1e10 Pa/m for 0.1 to 1.0. With tp 0.5 s: 0.43, 0.43, 0.44 and 0.44 g (rigid: 0.44).
- Impacts bounce: after the first one of a block at 1e10 Pa/m (validation, section 3) the amplitude
  is 0.445, 0.429 and 0.421 of alpha at 0.01, 0.3 and 1.0 of critical damping; Housner 0.4202.
  Strong dashpots on soft joints brake the rocking itself (0.30 at 1e7 Pa/m and 1.0).
- Little damped joints ring after impacts, and friction, not impacts, dissipates what they hold.
- A contact that closes within a step makes or loses energy, of second order in the step: 5, 1.6,
  0.5, 0.1 and 0.03 % of the largest kinetic one at 0.8, 0.5, 0.25, 0.1 and 0.05 of the critical
  step. Hence the default of a quarter; without damping, contacts that open and close are
  unstable just below the critical step already.
- The depth is taken to be 1 m, as a chain does not know it.
"""

import numpy as np

from archfrag.mechanics.collapse import (
    collapse_of,
    new_joint_state,
    note_gap,
    note_loss,
    smallest_gap,
    unregained_loss,
)
from archfrag.mechanics.compile import allocating, inlined, kernel
from archfrag.mechanics.energy import kinetic_energy, potential_energy
from archfrag.mechanics.ground import cumulative_impulse, impulse_between
from archfrag.mechanics.kinematics import empty_contacts, move_faces
from archfrag.mechanics.laws import OPEN
from archfrag.mechanics.ledger import (
    book_changes,
    book_motion,
    log_change,
    new_ledger,
    write_frame,
)
from archfrag.mechanics.residuals import measure_state
from archfrag.mechanics.status import Cause, CollapseMode, Count, Energy, Model, Peak, Status
from archfrag.mechanics.types import Outcome
from archfrag.methods.spring_chain import (
    N_CLOCK,
    Clock,
    Run,
    Settings,
    drift,
    find_step,
    kick,
    largest_slip,
    settle,
)
from archfrag.methods.springs import Sum, new_springs, press_joints

STANDING = int(Status.STANDING)
COLLAPSED = int(Status.COLLAPSED)
UNFINISHED = int(Status.UNFINISHED)
NOT_FINITE = int(Status.NOT_FINITE)
WORK_BOUND = int(Status.WORK_BOUND)
NO_MODE = int(CollapseMode.NONE)
ALL = int(Model.ALL_VOUSSOIRS)
BY_START, BY_REST = int(Cause.START), int(Cause.REST)
# What else a stride may stop for, besides a status.
PAUSE = -1

# A run of more steps than this is refused before it starts.
MOST_STEPS = 1e9
# Steps between looks at joints that keep their contact, and at peaks.
LOOK_INTERVAL = 4
# The chain rests once, after the record, no body has been faster than this, over the square root
# of gravity times joint length, for so long [s]: longer than a turning point of a motion lasts.
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


@inlined
def _stored(run, position):
    potential = potential_energy(run.chain.mass, run.chain.gravity, position)
    return potential + run.springs.sums[Sum.ELASTIC]


@kernel
def measure_energy(run, position, velocity):
    """Bring the account up to now; what no law explains is booked as stray work.

    The kinetic energy is that which central differences conserve with the elastic one: half the
    mass times the velocities before and after.

    Returns
    -------
    bool
        Whether the account still says that this is a motion, and not a divergence.
    """
    energy, sums, clock, old = run.ledger.energy, run.springs.sums, run.clock, run.old
    lost = clock[Clock.DISSIPATED] + sums[Sum.DAMPING]
    if sums[Sum.FRICTION] + lost <= 0.0:  # what both gave in sum stays stray
        energy[Energy.FRICTION] += sums[Sum.FRICTION]
        energy[Energy.IMPACT] += lost
    sums[Sum.FRICTION] = sums[Sum.DAMPING] = clock[Clock.DISSIPATED] = 0.0
    kinetic = 0.0
    for i in range(velocity.shape[0]):
        kinetic += run.chain.mass[i] * (old[i, 0] * velocity[i, 0] + old[i, 1] * velocity[i, 1])
        kinetic += run.chain.inertia[i] * old[i, 2] * velocity[i, 2]
    energy[Energy.KINETIC] = 0.5 * kinetic
    energy[Energy.POTENTIAL] = _stored(run, position) - clock[Clock.START_ENERGY]
    explained = energy[Energy.GROUND] + energy[Energy.FRICTION] + energy[Energy.IMPACT]
    explained += clock[Clock.START_KINETIC]
    stray = energy[Energy.KINETIC] + energy[Energy.POTENTIAL] - explained
    energy[Energy.STRAY] = stray
    if abs(stray) > ROUNDING * clock[Clock.SCALE]:
        energy[Energy.STRAY_PEAK] = max(energy[Energy.STRAY_PEAK], abs(stray))
    bound = max(DIVERGED * energy[Energy.LARGEST_KINETIC], SLIGHT * clock[Clock.SCALE])
    return abs(stray) <= bound


@kernel
def _gather_reactions(run, position):
    """Faces, and reactions about their middles, at the instant of the positions."""
    springs, reaction = run.springs, run.reaction
    move_faces(run.chain, position, run.before, run.after)
    for j in range(springs.slip.size):
        reaction[j, 0] = reaction[j, 1] = reaction[j, 2] = 0.0
        px = 0.25 * (run.before[j, 0, 0] + run.before[j, 1, 0])
        py = 0.25 * (run.before[j, 0, 1] + run.before[j, 1, 1])
        px += 0.25 * (run.after[j, 0, 0] + run.after[j, 1, 0])
        py += 0.25 * (run.after[j, 0, 1] + run.after[j, 1, 1])
        run.pivot[j, 0], run.pivot[j, 1] = px, py
        for c in range(2):
            if springs.touch[j, c]:
                fx, fy = springs.force[j, c, 0], springs.force[j, c, 1]
                reaction[j, 0] += fx
                reaction[j, 1] += fy
                reaction[j, 2] += (springs.point[j, c, 0] - px) * fy
                reaction[j, 2] -= (springs.point[j, c, 1] - py) * fx


@kernel
def _write_frame(run, position):
    _gather_reactions(run, position)
    write_frame(
        run.frames, run.ledger, run.clock[Clock.TIME], run.chain, position, run.mean,
        run.reaction, run.springs.mode, 1.0,
    )  # fmt: skip


@allocating
def _measure(run, position):
    """Note how far the present state is from the contact laws."""
    _gather_reactions(run, position)
    measure_state(
        run.chain, position, run.mean, run.before, run.after, run.springs.length,
        run.springs.slip, run.reaction, run.pivot, 1.0, run.contacts, run.relative,
        run.ledger.peak,
    )  # fmt: skip


@kernel
def _note_changes(run, position):
    """Book the joints that changed their mode since the step before."""
    springs, joints, ledger = run.springs, run.joints, run.ledger
    cause, joint = book_changes(joints.mode, springs.mode, ledger)
    if cause < 0:
        return
    time = run.clock[Clock.TIME]
    for j in range(springs.mode.size):
        mode = springs.mode[j]
        if mode != OPEN:
            joints.last_contact[j] = mode
        elif joints.mode[j] != OPEN:
            joints.slip[j] = springs.slip[j]
            note_loss(j, time, position, springs.length, joints)
        joints.mode[j] = mode
    log_change(run.log, ledger, time, cause, joint, ALL, joints.mode)


@kernel
def _look(run, position):
    """Joint, mode and time of a collapse, as `collapse_of`."""
    springs, joints = run.springs, run.joints
    move_faces(run.chain, position, run.before, run.after)
    for j in range(springs.slip.size):
        joints.slip[j] = springs.slip[j]
        if joints.mode[j] == OPEN:
            note_gap(j, smallest_gap(j, run.before, run.after) / springs.length[j], joints)
    return collapse_of(
        position, run.before, run.after, springs.length, joints, run.options.loss_limit,
        run.clock[Clock.TIME],
    )  # fmt: skip


@inlined
def _changed(springs, joints):
    """Whether any joint has another mode than before, and whether any is open."""
    change = is_open = False
    for j in range(springs.mode.size):
        change = change or springs.mode[j] != joints.mode[j]
        is_open = is_open or springs.mode[j] == OPEN
    return change, is_open


@allocating
def _stride(run, position, velocity, stop):
    """Step until a pause is due or the run is over.

    Returns
    -------
    int
        PAUSE or a status.
    """
    chain, springs, clock, ledger = run.chain, run.springs, run.clock, run.ledger
    count, energy, settings = ledger.count, ledger.energy, run.settings
    sampling = run.ground.time_step
    while True:
        step, previous, time = clock[Clock.STEP], clock[Clock.PREVIOUS], clock[Clock.TIME]
        press_joints(chain, springs, position, velocity, previous, clock[Clock.DAMPING])
        start, end = time - 0.5 * previous, time + 0.5 * step
        span = end - start
        shake_x = impulse_between(start, end, run.ground.horizontal, run.impulse_x, sampling)
        shake_y = impulse_between(start, end, run.ground.vertical, run.impulse_y, sampling)
        shake_x /= span
        shake_y /= span
        along = 0.5 * previous * (clock[Clock.SHAKE_X] + shake_x)
        up = 0.5 * previous * (clock[Clock.SHAKE_Y] + shake_y)
        for i in range(position.shape[0]):
            momentum = along * velocity[i, 0] + up * velocity[i, 1]
            energy[Energy.GROUND] -= chain.mass[i] * momentum
        clock[Clock.SHAKE_X], clock[Clock.SHAKE_Y] = shake_x, shake_y
        clock[Clock.DISSIPATED] += kick(
            run, velocity, shake_x, shake_y, span, settings.local_damping
        )
        count[Count.STEPS] += 1
        change, is_open = _changed(springs, run.joints)
        if change:
            _note_changes(run, position)
        looks = count[Count.STEPS] % LOOK_INTERVAL == 0
        fallen = False
        if looks or is_open:
            fastest = book_motion(chain, position, run.mean, springs.length[0], ledger)
            if np.isnan(fastest):
                return NOT_FINITE
            if fastest > clock[Clock.STILL]:
                clock[Clock.RESTLESS] = max(clock[Clock.RESTLESS], time)
            fallen = _look(run, position)[0] >= 0
        if run.frames.time.size > 0 and (fallen or time >= clock[Clock.NEXT_FRAME]):
            _write_frame(run, position)
            clock[Clock.NEXT_FRAME] += run.options.frame_interval
        resting = time - clock[Clock.RESTLESS] >= REST_SPAN
        ends = fallen or resting or time >= stop
        if ends or count[Count.STEPS] % run.options.check_interval == 0:
            if not measure_energy(run, position, velocity):
                return NOT_FINITE
            _measure(run, position)
            if ends:
                return COLLAPSED if fallen else (STANDING if resting else UNFINISHED)
        if count[Count.STEPS] >= clock[Clock.MOST_STEPS]:
            return WORK_BOUND
        drift(position, velocity, step)
        clock[Clock.TIME] += step
        clock[Clock.PREVIOUS] = step
        ledger.model_time[Model.ALL_VOUSSOIRS] += step
        if looks and largest_slip(springs) > clock[Clock.SHIFT] + SHIFT:
            return PAUSE


@allocating
def run(
    chain,
    ground,
    position,
    velocity,
    from_rest,
    options,
    frames,
    log,
    stiffness,
    shear_ratio,
    damping_stiffness,
    damping_mass,
    damping_frequency,
    local_damping,
    step_fraction,
    rounding,
):
    """Integrate one chain under one ground motion; the signature of every method.

    Parameters
    ----------
    chain : archfrag.mechanics.types.Chain
    ground : archfrag.mechanics.types.GroundMotion
    position, velocity : ndarray, (n_body, 3)
        Initial state; overwritten with the final one.
    from_rest : bool
        Whether the initial state is the chain at rest in its own geometry. It is then settled
        on its springs first; in any other state they take up the weight in the first instants.
    options : archfrag.mechanics.types.Options
        ``max_steps`` counts steps of its size; smaller ones are allowed as many more.
    frames : archfrag.mechanics.types.Frames
        Overwritten with the history; arrays of length zero for none.
    log : archfrag.mechanics.types.MechanismLog
        Overwritten with the changes of the mechanism; arrays of length zero for none.
    stiffness : float
        Normal stiffness of the joints for each unit of their area [Pa/m]; the depth counts as
        1 m, as a chain knows its masses but not its depth.
    shear_ratio : float
        Shear over normal stiffness.
    damping_stiffness : float
        Stiffness-proportional damping, over critical at the highest frequency.
    damping_mass : float
        Mass-proportional damping, over critical at `damping_frequency` [Hz].
    damping_frequency : float
    local_damping : float
        Part of the unbalanced force that opposes each motion (Cundall).
    step_fraction : float
        Of the critical step; unstable above one.
    rounding : float
        Slip, over joint length, either side of which a vertex has passed the other.

    Returns
    -------
    archfrag.mechanics.types.Outcome
    """
    n_body, n_joint = chain.mass.size, chain.friction.size
    settings = Settings(
        damping_stiffness,
        4.0 * np.pi * damping_mass * damping_frequency,
        local_damping,
        step_fraction,
    )
    this = Run(
        chain, ground, options, settings,
        new_springs(chain, stiffness, shear_ratio, rounding),
        new_joint_state(n_joint), new_ledger(), frames, log,
        cumulative_impulse(ground.horizontal, ground.time_step),
        cumulative_impulse(ground.vertical, ground.time_step),
        np.zeros((n_joint, 2, 2)), np.zeros((n_joint, 2, 2)),
        np.zeros((n_body, 3)), velocity.copy(), np.zeros((n_joint, 3)), np.zeros((n_joint, 2)),
        empty_contacts(n_body, n_joint), np.zeros((n_joint, 3)), np.zeros(N_CLOCK),
    )  # fmt: skip
    clock, ledger, springs = this.clock, this.ledger, this.springs
    record_end = (ground.horizontal.size - 1) * ground.time_step
    stop = record_end + options.follow
    find_step(this, position)
    if not stop / clock[Clock.STEP] < MOST_STEPS:
        return Outcome(WORK_BOUND, 0.0, np.nan, -1, NO_MODE, this.joints.loss, ledger)
    if from_rest:
        settle(this, position, velocity)
    press_joints(chain, springs, position, velocity, 0.0, 0.0)
    springs.sums[:] = 0.0
    press_joints(chain, springs, position, velocity, 0.0, clock[Clock.DAMPING])
    for j in range(n_joint):
        this.joints.mode[j] = springs.mode[j]
        if springs.mode[j] == OPEN:
            note_loss(j, 0.0, position, springs.length, this.joints)
    clock[Clock.START_ENERGY] = _stored(this, position)
    clock[Clock.START_KINETIC] = kinetic_energy(chain.mass, chain.inertia, velocity)
    clock[Clock.SCALE] = chain.gravity * np.sum(chain.mass) * springs.length[0]
    clock[Clock.STILL] = STILL * np.sqrt(chain.gravity * springs.length[0])
    clock[Clock.RESTLESS] = record_end
    log_change(log, ledger, 0.0, BY_START, -1, ALL, this.joints.mode)
    status = PAUSE
    while status == PAUSE:
        status = _stride(this, position, velocity, stop)
        if status == PAUSE:
            find_step(this, position)
    ledger.peak[Peak.OVERLAP] = max(ledger.peak[Peak.OVERLAP], springs.sums[Sum.OVERLAP])
    collapse_joint, collapse_mode, collapse_time = -1, NO_MODE, np.nan
    if status == COLLAPSED:
        collapse_joint, collapse_mode, collapse_time = _look(this, position)
    elif status == UNFINISHED:
        _look(this, position)
        collapse_joint, collapse_mode, collapse_time = unregained_loss(
            position, this.before, this.after, springs.length, this.joints, clock[Clock.TIME]
        )
        if collapse_joint >= 0:
            status = COLLAPSED
    if status == STANDING:
        ledger.count[Count.RESTS] += 1
        log_change(log, ledger, clock[Clock.TIME], BY_REST, -1, ALL, this.joints.mode)
    velocity[:] = this.mean
    return Outcome(
        status, clock[Clock.TIME], collapse_time, collapse_joint, collapse_mode,
        this.joints.loss, ledger,
    )  # fmt: skip
