"""The event-driven method from a chain and its ground motion to an outcome."""

import numpy as np

from archfrag.mechanics.collapse import NO_MODE
from archfrag.mechanics.contact.path import new_path
from archfrag.mechanics.ground import find_breaks
from archfrag.mechanics.mega_voussoirs.assemble import new_mega_voussoirs
from archfrag.mechanics.model import model_of, new_state, new_work
from archfrag.mechanics.status import Count, Energy, Peak, Status
from archfrag.mechanics.types import (
    Chain,
    Frames,
    GroundMotion,
    MechanismLog,
    Options,
    Outcome,
)
from archfrag.methods.event_driven.events import Motion, Scales, new_laws
from archfrag.methods.event_driven.integrate import FIRST, Pace, Run
from archfrag.methods.event_driven.phases import (
    BY_UNSOLVED,
    CROWD,
    follow_phases,
)
from archfrag.methods.event_driven.runge_kutta import FIFTH_ORDER, THIRD_ORDER, new_stages
from archfrag.methods.time_stepping.at_impacts import Steps
from archfrag.methods.time_stepping.front import joined_grounds, limits_of, outcome_of, rest_of
from archfrag.methods.time_stepping.recording import output_to
from archfrag.methods.time_stepping.service import new_results

# Tolerances above this are met by the method of order 3.
COARSE = 2e-4
# A run is refused that makes or loses more energy than this many times its accuracy, over the
# largest kinetic energy, or whose bodies overlap by more than this many times it, over a joint's
# length; less energy than ROUNDING times weight times length is rounding.
ENERGY_ALLOWED, LEAST_ENERGY = 10.0, 1e-2
OVERLAP_ALLOWED, LEAST_OVERLAP = 0.1, 1e-4
ROUNDING = 1e-12


def is_accurate(chain: Chain, options: Options, outcome: Outcome) -> bool:
    """Whether a run that ended is as good as its tolerance allows, by what it measured itself.

    Parameters
    ----------
    chain : archfrag.mechanics.types.Chain
    options : archfrag.mechanics.types.Options
    outcome : archfrag.mechanics.types.Outcome

    Returns
    -------
    bool
        False where more energy than `ENERGY_ALLOWED` times the accuracy was made or lost, or
        bodies overlapped by more than `OVERLAP_ALLOWED` times it; an accuracy finer than the
        default counts as the default.
    """
    energy, peak = outcome.ledger.energy, outcome.ledger.peak
    largest = max(energy[Energy.LARGEST_KINETIC], energy[Energy.START_KINETIC])
    allowed = max(ENERGY_ALLOWED * options.accuracy, LEAST_ENERGY) * largest
    length = float(model_of(chain).length.max())
    allowed += ROUNDING * chain.gravity * float(chain.mass.sum()) * length
    overlap = max(OVERLAP_ALLOWED * options.accuracy, LEAST_OVERLAP)
    return bool(energy[Energy.STRAY_PEAK] <= allowed and peak[Peak.OVERLAP] <= overlap)


def new_run(chain: Chain, ground: GroundMotion, options: Options, rest: tuple) -> Run:
    model = model_of(chain)
    n_joint, length = model.friction.size, float(model.length.min())
    pace, speed = np.zeros(len(Pace)), float(np.sqrt(model.gravity * length))
    pace[Pace.STEP], pace[Pace.QUIET_UNTIL] = FIRST * length / speed, -np.inf
    pace[Pace.SWITCH] = BY_UNSOLVED
    resolved = model.gravity * min(1.0, max(1e-3, 1e3 * options.tolerance))
    per_weight = 1.0 / (model.gravity * float(model.mass.sum()))
    scales = Scales(length, speed, resolved, per_weight, float(options.tolerance))
    scheme = THIRD_ORDER if options.tolerance > COARSE else FIFTH_ORDER
    laws, step = new_laws(n_joint), float(options.time_step)
    return Run(
        model=model,
        state=new_state(model),
        work=new_work(model),
        mega=new_mega_voussoirs(model),
        motion=Motion(model, new_stages(model.mass.size), scheme, laws, scales),
        pace=pace,
        recent=np.full(CROWD, -np.inf),
        outward=np.zeros(model.mass.size),
        ground=ground,
        next_break=find_breaks(ground),
        grounds=joined_grounds([ground]),
        steps=Steps(step, step, 1.0),
        path=new_path(model),
        limits=limits_of(model, options, rest),
        most_steps=int(options.max_steps),
        crowding=float(options.crowding),
    )


def run(
    chain: Chain,
    ground: GroundMotion,
    position: np.ndarray,
    velocity: np.ndarray,
    from_rest: bool,
    options: Options,
    frames: Frames,
    log: MechanismLog,
) -> Outcome:
    """Integrate one chain under one ground motion; the signature of every method.

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
        Overwritten with the history; arrays of length zero for none.
    log : archfrag.mechanics.types.MechanismLog
        Overwritten with the changes of the mechanism; arrays of length zero for none.

    Returns
    -------
    archfrag.mechanics.types.Outcome
    """
    scaled = ground._replace(
        horizontal=ground.factor * ground.horizontal,
        vertical=ground.factor * ground.vertical,
        factor=1.0,
    )
    model, grounds = model_of(chain), joined_grounds([scaled])
    rest = rest_of(model, options, grounds) if from_rest else (np.nan, np.nan)
    given, results = new_run(chain, scaled, options, rest), new_results(1)
    state, output = given.state, output_to(frames, log, options.frame_interval)
    at_rest = from_rest and not np.isnan(rest[0])
    state.position[1:-1], state.velocity[1:-1] = position, velocity
    follow_phases(given, at_rest, output, results)
    position[:], velocity[:] = state.position[1:-1], state.velocity[1:-1]
    results.count[0, Count.FRAMES], results.count[0, Count.LOG_ENTRIES] = output.written
    outcome = outcome_of(results, 0)
    ended = outcome.status in (Status.STANDING, Status.COLLAPSED)
    if ended and not is_accurate(chain, options, outcome):
        refused = int(Status.INACCURATE)
        return outcome._replace(
            status=refused, collapse_time=np.nan, collapse_joint=-1, collapse_mode=NO_MODE
        )
    return outcome
