"""Numbers by which kernels return outcomes, and indices into their arrays."""

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
    """Why a run waits or has ended: ``state.clock[Clock.CODE]``.

    Up to PAUSE a run goes on afterwards.
    """

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

    COMPLETE = 0  # the time given is reached
    EVENT = 1  # a law of the mechanism ends
    FALL = 2  # the chain collapses
    SPENT = 3  # the work allowed is spent
    STUCK = 4  # the equations of motion have no solution, or steps get too short


class Phase(IntEnum):
    """What an event-driven run does next."""

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
    """Indices into ``State.loss`` and columns of ``Outcomes.loss``."""

    TIME = 0  # of the first loss of contact that counted [s]; nan if there was none
    JOINT = 1  # joint of that loss; -1 if there was none
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
    """Indices into ``State.count`` and columns of ``Outcomes.count``."""

    STEPS = 0  # integration steps, of whatever method
    ITERATIONS = 1  # linear contact problems solved on all voussoirs
    PATHS = 2  # contact problems that needed a solution path
    COMPLIANT = 3  # contact problems solved with compliant joints
    SHORTENED = 4  # steps halved: contact problem unsolved, or error above tolerance
    IMPACTS = 5  # joints that closed
    OPENINGS = 6
    SLIDES = 7
    LOSSES = 8  # times that a joint was left without contact
    RESTS = 9
    EVENTS = 10  # instants located at which the mechanism changed
    LEVELS = 11  # contact problems at events
    LEVEL_ITERATIONS = 12  # contact problems at events that needed several iterations
    GENERAL = 13  # contact problems at events that were left to solution paths
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
    """Indices into ``State.energy`` and columns of ``Outcomes.energy`` [J]."""

    GROUND = 0  # work of the inertia forces of the ground motion
    POTENTIAL = 1  # potential energy gained
    KINETIC = 2  # kinetic energy at the end
    FRICTION = 3  # work of friction, and of ties that yield or break
    IMPACT = 4  # work of impacts, and of dashpots in joints that give
    BALANCE_ERROR = 5  # work that no law explains: the integrator's error
    BALANCE_ERROR_PEAK = 6  # largest magnitude of that error during the run
    LARGEST_KINETIC = 7  # largest kinetic energy during the run
    START_KINETIC = 8  # kinetic energy of the initial state


class Peak(IntEnum):
    """Indices into ``State.peak`` and columns of ``Outcomes.peak``."""

    ROTATION = 0  # largest rotation of any body [rad]
    DISPLACEMENT = 1  # largest displacement of any centroid [m]
    RESIDUAL = 2  # largest contact residual measured [1]
    OVERLAP = (
        3  # deepest overlap of two bodies at a corner, over the joint's length [1]
    )
    END_ROTATION = 4  # largest rotation of any body at the end [rad]
    END_DISPLACEMENT = 5  # largest displacement of any centroid at the end [m]
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
    LENGTH = 7  # length without a force [m]
    STRENGTH = 8  # force at which it yields; inf: elastic [N]
    RUPTURE = 9  # elongation at which it breaks; inf: never [m]


class Joint(IntEnum):
    """Columns of ``Chain.joint``."""

    STIFFNESS = 0  # normal stiffness of a metre of the joint [N/m2]
    SHEAR = 1  # shear stiffness of a metre of the joint [N/m2]
    DAMPING = 2  # damping ratio of the first mode with all joints closed [1]
    POINTS = 3  # number of points at which a joint bears, 2 or 3; 0: all along it


class TieMode(IntEnum):
    """Mode of a tie: the law that it follows."""

    SLACK = 0
    TAUT = 1
    YIELDS = 2
    RUPTURED = 3


class TieState(IntEnum):
    """Columns of ``State.tie``."""

    MODE = 0  # TieMode
    SET = 1  # elongation at which the tie has no force, from yielding [m]


class TieWork(IntEnum):
    """Columns of ``Work.tie``."""

    DX = 0  # unit vector from end 0 to end 1
    DY = 1
    ARM_0 = 2  # moment of the unit vector about the body at each end [m]
    ARM_1 = 3
    RATE = 4  # rate of elongation before the step [m/s]
    ENERGY = 5  # elastic energy before the step [J]
    KNOWN = 6  # impulse if taut: this plus GAIN times the rate after the step [N s]
    GAIN = 7
    MOST = 8  # impulse if it yields [N s]
    MODE = 9  # TieMode that the contact problem is solved for
    ASKED = 10  # TieMode that the solution asks for
    IMPULSE = 11  # impulse in the solution [N s]
    TRIAL = 12  # impulse if it were elastic [N s]
    GUESS = 13  # impulse by its tension in the mode before the step [N s]
