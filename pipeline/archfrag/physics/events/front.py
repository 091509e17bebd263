"""Event-driven method: from a chain and its ground motions to results."""

import numpy as np

from archfrag.physics import shared
from archfrag.physics.contact.path import new_path
from archfrag.physics.events.integrate import FIRST, Progress, Run
from archfrag.physics.events.locate import new_motion
from archfrag.physics.events.phases import ACCUMULATION, BY_UNSOLVED, follow_phases
from archfrag.physics.events.runge_kutta import FIFTH_ORDER, THIRD_ORDER
from archfrag.physics.ground import Grounds, one_of
from archfrag.physics.interface import Chain, Frames, MechanismLog, Options, Outcomes
from archfrag.physics.mega_voussoirs.assemble import new_mega_voussoirs
from archfrag.physics.state import Model, model_of, new_state, new_work
from archfrag.physics.status import Count
from archfrag.physics.steps.run import RIGID, UNKNOWN, rest_of

# Tolerances above this are met by the method of order 3: what only grazes a joint needs order 5.
COARSE = 1e-3
# Steps that end with a sample of the ground motion, and what events and errors add to them.
STEPS_PER_SAMPLE = 4


def new_run(
    model: Model, grounds: Grounds, options: Options, rest: tuple[float, float]
) -> Run:
    """Set up a run under one ground motion."""
    scheme = THIRD_ORDER if options.tolerance > COARSE else FIFTH_ORDER
    motion = new_motion(model, scheme, options.tolerance)
    progress = np.zeros(len(Progress))
    progress[Progress.STEP] = FIRST * motion.length / motion.speed
    progress[Progress.QUIESCENT_UNTIL] = -np.inf
    progress[Progress.SWITCH] = BY_UNSOLVED
    most = int(options.max_steps) + STEPS_PER_SAMPLE * grounds.horizontal.size
    options = options._replace(
        largest_step=0.0, max_steps=most, first_steps=float(most)
    )
    state = new_state(model)
    return Run(
        law=RIGID,
        model=model,
        state=state,
        work=new_work(model),
        mega=new_mega_voussoirs(model, state.tie),
        motion=motion,
        progress=progress,
        recent=np.full(ACCUMULATION, -np.inf),
        outward=np.zeros(model.mass.size),
        grounds=grounds,
        path=new_path(model),
        options=shared.ready(options, model, rest),
    )


def _refused(chain: Chain, options: Options, results: Outcomes) -> Outcomes:
    shared.refuse(results, np.flatnonzero(~shared.is_accurate(chain, options, results)))
    return results


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
) -> Outcomes:
    """Integrate one chain; arguments and result as `archfrag.physics.steps.run.run`."""
    model = model_of(chain)
    results = shared.new_results(1)
    rest = rest_of(model) if from_rest else UNKNOWN
    given = new_run(model, one_of(grounds, 0, factor), options, rest)
    state = given.state
    output = shared.output_to(frames, log, options.frame_interval)
    state.position[1:-1] = position
    state.velocity[1:-1] = velocity
    at_rest = from_rest and not np.isnan(given.options.rest_plus)
    follow_phases(given, at_rest, output, results, 0)
    position[:] = state.position[1:-1]
    velocity[:] = state.velocity[1:-1]
    results.count[0, Count.FRAMES], results.count[0, Count.LOG_ENTRIES] = output.written
    return _refused(chain, options, results)


def run_many(
    chain: Chain,
    grounds: Grounds,
    motion: np.ndarray,
    factor: np.ndarray,
    options: Options,
) -> Outcomes:
    """Make runs one after the other; arguments are those of
    `archfrag.physics.steps.run.run_many`.
    """
    model = model_of(chain)
    results = shared.new_results(len(motion))
    rest = rest_of(model)
    output = shared.no_output(chain.mass.size, chain.friction.size)
    for row, (number, by) in enumerate(zip(motion, factor)):
        given = new_run(model, one_of(grounds, number, by), options, rest)
        given.state.position[:] = model.start
        follow_phases(given, not np.isnan(rest[0]), output, results, row)
    return _refused(chain, options, results)
