"""Outcomes that kernels return instead of raising."""

from enum import IntEnum


class Status(IntEnum):
    """Outcome of a run; `archfrag.simulation.response` has a message for each."""

    STANDING = 0
    COLLAPSED = 1
    UNFINISHED = 2
    NO_CONTACT_SOLUTION = 3
    DOES_NOT_STAND = 4
    NOT_FINITE = 5
    WORK_BOUND = 6
    NOT_APPLICABLE = 7
    INACCURATE = 8


class Wait(IntEnum):
    """Why a run waits or ends: ``state.clock[Clock.CODE]``. Up to PAUSE it goes on afterwards."""

    GO = 0
    UNSOLVED = 1  # contact modes that are not reconciled
    PAUSE = 2  # something is due between steps
    COLLAPSES = 3
    AT_END = 4  # the time is up
    EXHAUSTED = 5  # the work allowed is spent
    BROKEN = 6  # positions overflowed
    IDLE = 7  # at rest for good


class Stretch(IntEnum):
    """How a stretch of motion between two events ends."""

    COMPLETE = 0  # at the time given
    EVENT = 1
    FALL = 2  # with a collapse
    SPENT = 3  # with the work allowed
    STUCK = 4  # where the equations of motion have no solution


class Phase(IntEnum):
    """What a run by events does next."""

    IMPACT = 0
    MODES = 1
    ASSEMBLE = 2
    INTEGRATE = 3
    UPON_EVENT = 4
    STILL = 5
    ALL_VOUSSOIRS = 6
    DONE = 7


class CollapseMode(IntEnum):
    """How the joint that lost contact was moving before it did."""

    NONE = 0
    HINGING = 1
    SLIDING = 2
    LIFT_OFF = 3
    OVERTURNING = 4


class Loss(IntEnum):
    """Entries of ``State.loss``."""

    TIME = 0  # of the first loss of contact that counted [s]; nan if there was none
    JOINT = 1  # where; -1 if nowhere
    MODE = 2  # CollapseMode of that joint
    WIDEST = 3  # largest gap at both corners of a joint, over its length [1]


class Level(IntEnum):
    """Levels of the model of a chain, from the smallest to that of all voussoirs."""

    REST = 0
    FOUR_HINGES = 1
    MEGA_VOUSSOIRS = 2
    ALL_VOUSSOIRS = 3


class Cause(IntEnum):
    """Why a mechanism, or the model of it, changed."""

    START = 0  # the initial state, or the body force left the range of rest
    HINGE = 1  # the thrust reached the edge of a joint
    SLIDE = 2  # Coulomb's limit was reached
    STICK = 3  # a slip came to its end or reversed
    IMPACT = 4  # an open joint closed
    LOSS = 5  # the force at a hinge vanished: contact lost
    CLOSE = 6  # a hinge that was not rotating became a closed joint without an impact
    REST = 7  # the chain came to rest
    ACCUMULATION = 8  # events accumulated: switched to time stepping
    UNSOLVED = 9  # a law could not be met on mega-voussoirs: switched to time stepping
    QUIESCENT = 10  # taken back from time stepping
    END = 11  # the run ended
    TIE = 12  # a tie became taut or slack, yielded or broke


class Count(IntEnum):
    """Entries of ``Outcomes.count``."""

    STEPS = 0  # integration steps, of whatever method
    ITERATIONS = 1  # linear contact problems solved on all voussoirs
    PATHS = 2  # contact problems that needed the solution path
    COMPLIANT = 3  # contact problems solved with compliant joints
    SHORTENED = 4  # steps halved: contact problem unsolved, or error above tolerance
    IMPACTS = 5  # joints that closed
    OPENINGS = 6
    SLIDES = 7
    LOSSES = 8  # times that a joint was left without contact
    RESTS = 9
    EVENTS = 10  # instants located at which the mechanism changed
    LEVELS = 11  # contact problems solved by the first and second level
    LEVEL_ITERATIONS = 12  # of these, those that needed more than one iteration
    GENERAL = 13  # contact problems that were left to the general solver
    SWITCHES = 14  # times that event-driven integration switched to time stepping
    FRAMES = 15  # frames of the history written
    LOG_ENTRIES = 16  # changes of the mechanism
    SWEEPS = 17  # passes over all contacts, by methods that relax them one by one
    UNCONVERGED = (
        18  # steps taken with contact problems that the method's solver left unsolved
    )
    REFUSED = 19  # states refused, since bringing them onto their contacts moves bodies too far
    REFINED = 20  # times that a run was made again with a tighter tolerance


class Energy(IntEnum):
    """Entries of ``Outcomes.energy`` [J]."""

    GROUND = 0  # work of the inertia forces of the ground motion
    POTENTIAL = 1  # gained in gravity
    KINETIC = 2  # at the end
    FRICTION = 3
    IMPACT = 4
    BALANCE_ERROR = 5  # work that no law explains: the integrator's error
    BALANCE_ERROR_PEAK = 6  # its largest magnitude in between
    LARGEST_KINETIC = 7
    START_KINETIC = 8  # of the initial state


class Peak(IntEnum):
    """Entries of ``Outcomes.peak``."""

    ROTATION = 0  # of any body [rad]
    DISPLACEMENT = 1  # of any centroid [m]
    RESIDUAL = 2  # largest contact residual measured [1]
    OVERLAP = (
        3  # deepest overlap of two bodies at a corner, over the joint's length [1]
    )
    END_ROTATION = 4  # largest of any body at the end of the run [rad]
    END_DISPLACEMENT = 5  # largest of any centroid at the end of the run [m]
    MOVED_BEFORE = 6  # one if the chain still moved at the time noted


class Tie(IntEnum):
    """Columns of ``Model.tie``."""

    BODY_0 = 0  # row of the body at each end; those of the grounds are the first and the last
    BODY_1 = 1
    X_0 = 2  # ends in the frames of the bodies [m]
    Y_0 = 3
    X_1 = 4
    Y_1 = 5
    STIFFNESS = 6  # [N/m]
    LENGTH = 7  # without a force [m]
    STRENGTH = 8  # force at which it yields; inf: elastic [N]
    RUPTURE = 9  # elongation at which it breaks; inf: never [m]


class Joint(IntEnum):
    """Columns of ``Chain.joint``."""

    STIFFNESS = 0  # normal one, of a metre of the joint [N/m2]
    SHEAR = 1  # [N/m2]
    DAMPING = 2  # of the first mode with all joints closed, over the critical one [1]
    POINTS = 3  # at which a joint bears, 2 or 3; 0: all along it


class TieMode(IntEnum):
    """Law that a tie follows."""

    SLACK = 0
    TAUT = 1
    YIELDS = 2
    RUPTURED = 3


class TieState(IntEnum):
    """Columns of ``State.tie``."""

    MODE = 0
    SET = 1  # elongation that stays without a force [m]


class TieWork(IntEnum):
    """Columns of ``Work.tie``."""

    DX = 0  # unit vector from end 0 to end 1
    DY = 1
    ARM_0 = 2  # its moment about the body at each end [m]
    ARM_1 = 3
    RATE = 4  # of elongation before the step [m/s]
    ENERGY = 5  # before the step [J]
    KNOWN = 6  # impulse: this plus GAIN times the rate after the step [N s]
    GAIN = 7
    MOST = 8  # impulse where it yields [N s]
    MODE = 9
    ASKED = 10
    IMPULSE = 11  # [N s]
    TRIAL = 12  # impulse if it were elastic [N s]
    GUESS = 13  # impulse by the tension before the step [N s]
