"""The arch as a linkage of one degree of freedom that jumps to its mirror image at an impact.

The model of Oppenheim (1992, *Earthquake Engng Struct. Dyn.* 21(11), 1005-1017), Clemente (1998,
ibid. 27(5), 513-522) and De Lorenzis, DeJong and Ochsendorf (2007, ibid. 36(14), 2119-2136):

- At rest until the ground acceleration leaves the rest range. Limit analysis at that limit says
  which four hinges open; they stay for as long as the arch moves that way.
- Then three bodies, four pins, one angle, by Lagrange's equation for large rotations
  (`archfrag.mechanics.linkage`), integrated by the pair of Dormand and Prince (1980).
- Where the linkage returns to its undeformed shape all joints close, and the hinges jump to those
  of limit analysis in the other direction: in a symmetric arch the mirror image. Balance of
  impulse for the three bodies of the new linkage gives its speed. It goes on, or rests when that
  speed is negligible and the body force lies inside the rest range.
- Collapse is where it cannot recover: three pins in a row have come into line (`STRAIGHT`), a
  joint has turned by 90 degrees, or a pin would have to pull on a linkage that opens beyond its
  unstable equilibrium (Signorini loss). A pull before that is counted as a loss of contact, and
  the pin holds.

A chain with a free end moves about one hinge: for a single block this is Housner's (1963) rocking
block with his impact. Where the onset mechanism is no linkage, because a joint slides in it, or
where an initial state is none of a linkage's, the run ends as ``Status.NOT_APPLICABLE``.

What the method gets wrong
--------------------------
Hinges do not choose their joints by the load of the moment, nor split, nor wander; no joint
slides once it moves; and after an impact, where many joints of an arch move, the motion is
projected on one mechanism, which throws energy away on the unsafe side. Oppenheim's arch (radius
10 m, thickness 1.5 m, 157.5 degrees, 7 voussoirs, friction 0.7):

- one rectangular pulse of 0.5, 0.7, 1.0 g must last 0.662, 0.375, 0.232 s for collapse; all
  voussoirs need 0.634, 0.365, 0.2197 s: 3 to 6 % less;
- under +a for 0.3 s and then -a/2 for 0.6 s it collapses from a = 1.596 g, without an impact;
  all voussoirs collapse from 0.6805 g: a capacity 2.35 times too large;
- pins hold where they would have to pull: under three of the shipped records scaled to a peak of
  4 g they pull 9 to 21 times in runs that end standing.

The contact laws at closed joints are not looked at while it moves; the residual that a response
reports is how far they are broken.
"""

import numpy as np

from archfrag.mechanics.collapse import new_loss
from archfrag.mechanics.compile import allocating, kernel
from archfrag.mechanics.energy import kinetic_energy, potential_energy
from archfrag.mechanics.ground import acceleration_at, find_breaks
from archfrag.mechanics.kinematics import (
    empty_contacts,
    joint_lengths,
    move_faces,
    place_contacts,
)
from archfrag.mechanics.laws import CLOSED_STICK
from archfrag.mechanics.ledger import book_changes, log_change, new_ledger
from archfrag.mechanics.linkage import build_linkage, new_linkage, new_pose, pose_linkage
from archfrag.mechanics.linkage_motion import carry, inertia_of, speed_after_impact
from archfrag.mechanics.onset import NO_LIMIT, rest_limit
from archfrag.mechanics.status import Cause, CollapseMode, Count, Energy, Model, Status
from archfrag.mechanics.types import Outcome
from archfrag.methods.event_driven.runge_kutta import N_STAGE
from archfrag.methods.linkage_steps import (
    CLOSED,
    COLLAPSED,
    GO,
    N_CLOCK,
    UNFINISHED,
    Case,
    Clock,
    fall_margin,
    measure_moving,
    move,
    note_peaks,
    spread,
    write,
    write_moving,
)
from archfrag.methods.rest import leave_rest

STANDING = int(Status.STANDING)
NOT_APPLICABLE = int(Status.NOT_APPLICABLE)
NO_MODE = int(CollapseMode.NONE)
AT_REST, FOUR_HINGES = int(Model.REST), int(Model.FOUR_HINGES)
BY_START, BY_REST = int(Cause.START), int(Cause.REST)

# Slower than this part of a fall through a joint's length is no motion.
STILL = 1e-7
# Of an initial state, over joint length and the speed of that fall: still a linkage's.
MATCHES = 1e-6


@kernel
def _change_modes(case, mode, cause, model):
    """Take over contact modes, count what joints did, and note it in the log."""
    ledger = case.ledger
    by, joint = book_changes(case.mode, mode, ledger)
    for j in range(mode.size):
        case.mode[j] = mode[j]
    if cause >= 0:
        by, joint = cause, -1
    ledger.count[Count.EVENTS] += 1
    log_change(case.log, ledger, case.clock[Clock.TIME], by, joint, model, case.mode)


@kernel
def _impact(case, linkage, other):
    """All joints close and the other linkage takes over: its speed, into ``case.state``."""
    chain, state, energy = case.chain, case.state, case.ledger.energy
    pose_linkage(linkage, 0.0, case.pose)
    carry(chain, linkage, case.pose, state[1], case.position, case.velocity)
    note_peaks(case)
    lost = kinetic_energy(chain.mass, chain.inertia, case.velocity)
    pose_linkage(other, 0.0, case.pose)
    carry(chain, other, case.pose, 1.0, case.position, case.unit)
    speed = max(speed_after_impact(chain, case.unit, case.velocity), 0.0)
    fastest = 0.0
    for k in range(other.count[0]):
        fastest = max(fastest, abs(case.pose.rate[k]))
    if speed * fastest < STILL * case.falling / case.length:
        speed = 0.0
    kept = 0.5 * inertia_of(other, case.pose)[0] * speed * speed
    energy[Energy.IMPACT] += min(kept - lost, 0.0)
    state[0], state[1] = 0.0, speed
    carry(chain, other, case.pose, speed, case.position, case.velocity)


@kernel
def _breaking_side(case):
    """Side on which the body force leaves the rest range now: 0 plus, 1 minus, -1 neither.

    Neither where the ground falls away faster than gravity: an arch lifts off there.
    """
    time, ground, limit = case.clock[Clock.TIME], case.ground, case.rest
    gx = acceleration_at(time, ground.horizontal, ground.time_step)
    gy = acceleration_at(time, ground.vertical, ground.time_step)
    upward = case.chain.gravity + gy
    if upward <= 0.0:
        return -1
    return 0 if limit[0] * upward - gx <= limit[1] * upward + gx else 1


@kernel
def _matches(case, linkage, position, velocity):
    """Whether an initial state is one of a linkage; its angle and speed into ``case.state``."""
    if linkage.count[0] == 0:
        return False
    body = linkage.joint[0]
    q = linkage.sense[0] * position[body, 2]
    speed = linkage.sense[0] * velocity[body, 2]
    if q < 0.0 or (q == 0.0 and speed < 0.0) or not pose_linkage(linkage, q, case.pose):
        return False
    carry(case.chain, linkage, case.pose, speed, case.position, case.velocity)
    for i in range(position.shape[0]):
        for c in range(3):
            size = 1.0 if c == 2 else case.length
            away = abs(case.position[i, c] - position[i, c]) / size
            aside = abs(case.velocity[i, c] - velocity[i, c]) / size
            if away > MATCHES or aside > MATCHES * case.falling / case.length:
                return False
    case.state[0], case.state[1] = q, speed
    return True


@allocating
def _new_case(chain, ground, options, frames, log):
    """Linkages and rest range by limit analysis, and room for a run."""
    n_body, n_joint = chain.mass.size, chain.friction.size
    position = np.zeros((n_body, 3))
    position[:, :2] = chain.centroid
    before, after = np.zeros((n_joint, 2, 2)), np.zeros((n_joint, 2, 2))
    contacts, lengths = empty_contacts(n_body, n_joint), joint_lengths(chain)
    move_faces(chain, position, before, after)
    place_contacts(position, before, after, np.zeros(n_joint), lengths, contacts)
    rest = np.zeros(2)
    plus, minus = new_linkage(n_joint), new_linkage(n_joint)
    for side in range(2):
        sense = 1.0 - 2.0 * side
        limit = rest_limit(
            chain.mass, chain.centroid, contacts.point, contacts.normal, contacts.candidate,
            chain.friction, chain.gravity, sense,
        )  # fmt: skip
        rest[side] = sense * limit.load_factor if limit.found else -NO_LIMIT
        build_linkage(chain, limit.mechanism, plus if side == 0 else minus)
    length = np.min(lengths)
    return Case(
        chain, ground, options, new_ledger(), frames, log, plus, minus, new_pose(), rest,
        find_breaks(ground), length, np.sqrt(chain.gravity * length), np.zeros(3), np.zeros(3),
        np.zeros((N_STAGE, 3)), np.zeros(4), position, np.zeros((n_body, 3)),
        np.zeros((n_body, 3)), before, after, np.zeros((n_joint, 2)), np.zeros((n_joint, 3)),
        np.full(n_joint, CLOSED_STICK, np.int8), lengths, np.zeros(n_joint), contacts,
        np.zeros((n_joint, 3)), np.ones(2), np.zeros(N_CLOCK),
    )  # fmt: skip


@allocating
def run(chain, ground, position, velocity, from_rest, options, frames, log):
    """Move a chain as a linkage of one degree of freedom; the signature of every method.

    Parameters
    ----------
    chain : archfrag.mechanics.types.Chain
    ground : archfrag.mechanics.types.GroundMotion
    position, velocity : ndarray, (n_body, 3)
        Initial state; overwritten with the final one.
    from_rest : bool
        Whether the initial state is the chain at rest in its own geometry.
    options : archfrag.mechanics.types.Options
    frames : archfrag.mechanics.types.Frames
        Overwritten with the history; no reactions at rest. Arrays of length zero for none.
    log : archfrag.mechanics.types.MechanismLog
        Overwritten with the changes of the mechanism; arrays of length zero for none.

    Returns
    -------
    archfrag.mechanics.types.Outcome
    """
    case = _new_case(chain, ground, options, frames, log)
    clock, ledger, state = case.clock, case.ledger, case.state
    stop = (ground.horizontal.size - 1) * ground.time_step + options.follow
    still = np.full(case.mode.size, CLOSED_STICK, np.int8)
    start_height = potential_energy(chain.mass, chain.gravity, position)
    start_energy = kinetic_energy(chain.mass, chain.inertia, velocity)
    clock[Clock.START_ENERGY] = start_energy + start_height
    clock[Clock.START_ENERGY] -= potential_energy(chain.mass, chain.gravity, case.position)
    status, side, at_rest = GO, -1, True
    if not from_rest:
        if _matches(case, case.plus, position, velocity):
            side = 0
        elif _matches(case, case.minus, position, velocity):
            side = 1
        if side < 0:
            status = NOT_APPLICABLE
            case.position[:], case.velocity[:] = position, velocity
        at_rest = status == GO and state[0] == 0.0 and state[1] == 0.0
    if status == GO and not at_rest:
        linkage = case.plus if side == 0 else case.minus
        _change_modes(case, linkage.mode, BY_START, FOUR_HINGES)
    write(case, 0.0)
    clock[Clock.NEXT_FRAME] = options.frame_interval
    while status == GO:
        if at_rest:
            time = clock[Clock.TIME]
            leave, for_good = leave_rest(chain, ground, case.rest, time)
            ledger.model_time[Model.REST] += leave - time
            clock[Clock.TIME] = leave
            if for_good:
                status = STANDING
                break
            side = _breaking_side(case)
            linkage = case.minus if side == 1 else case.plus
            if side < 0 or linkage.count[0] == 0:
                status = NOT_APPLICABLE
                break
            if leave > time:
                write(case, leave)
                clock[Clock.NEXT_FRAME] = leave + options.frame_interval
            _change_modes(case, linkage.mode, BY_START, FOUR_HINGES)
        at_rest = False
        linkage = case.plus if side == 0 else case.minus
        began = clock[Clock.TIME]
        status = move(case, linkage, stop)
        if status != CLOSED:
            break
        status = GO
        if clock[Clock.TIME] == began:
            # The force was outside the rest range for less than time can resolve.
            past = np.floor(began / ground.time_step + 1e-9) + 1.0
            clock[Clock.TIME] = past * ground.time_step
        other = case.minus if side == 0 else case.plus
        if other.count[0] == 0:
            status = NOT_APPLICABLE
            break
        _impact(case, linkage, other)
        at_rest = state[1] == 0.0
        if at_rest:
            _change_modes(case, still, BY_REST, AT_REST)
            ledger.count[Count.RESTS] += 1
            case.reaction[:] = 0.0
            write(case, clock[Clock.TIME])
        else:
            side = 1 - side
            _change_modes(case, other.mode, -1, FOUR_HINGES)
    joint, mode, fell = -1, NO_MODE, np.nan
    if status in (COLLAPSED, UNFINISHED):
        linkage = case.plus if side == 0 else case.minus
        case.trial[:] = state
        spread(case, linkage, 0.0)
        note_peaks(case)
    if status == COLLAPSED:
        _, pin, mode = fall_margin(case, linkage)
        joint, fell = linkage.joint[pin], clock[Clock.TIME]
        measure_moving(case, linkage, 0.0)
        write_moving(case, linkage, 0.0)
    position[:], velocity[:] = case.position, case.velocity
    _close_account(case, position, velocity, start_energy, start_height)
    return Outcome(status, clock[Clock.TIME], fell, joint, mode, new_loss(), ledger)


@kernel
def _close_account(case, position, velocity, start_energy, start_height):
    """Energies of the final state of all voussoirs, and what of them no law explains."""
    chain, energy = case.chain, case.ledger.energy
    energy[Energy.KINETIC] = kinetic_energy(chain.mass, chain.inertia, velocity)
    energy[Energy.POTENTIAL] = potential_energy(chain.mass, chain.gravity, position)
    energy[Energy.POTENTIAL] -= start_height
    stray = energy[Energy.KINETIC] - start_energy + energy[Energy.POTENTIAL]
    stray -= energy[Energy.GROUND] + energy[Energy.IMPACT]
    energy[Energy.STRAY] = stray
    energy[Energy.STRAY_PEAK] = max(energy[Energy.STRAY_PEAK], abs(stray))
    largest = max(energy[Energy.LARGEST_KINETIC], energy[Energy.KINETIC])
    energy[Energy.LARGEST_KINETIC] = largest
