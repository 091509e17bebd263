"""The event-driven method from a chain and its ground motion to an outcome."""

from collections.abc import Sequence

import numpy as np

from archfrag.mechanics.contact.path import new_path
from archfrag.mechanics.ground import find_breaks
from archfrag.mechanics.mega_voussoirs.assemble import new_mega_voussoirs
from archfrag.mechanics.model import model_of, new_state, new_work
from archfrag.mechanics.status import Count
from archfrag.mechanics.types import Chain, Frames, GroundMotion, MechanismLog, Options, Outcome
from archfrag.methods.base import is_accurate, refuse
from archfrag.methods.event_driven.events import Motion, Scales, new_laws
from archfrag.methods.event_driven.integrate import FIRST, Progress, Run
from archfrag.methods.event_driven.phases import ACCUMULATION, BY_UNSOLVED, follow_phases
from archfrag.methods.event_driven.runge_kutta import FIFTH_ORDER, THIRD_ORDER, new_stages
from archfrag.methods.time_stepping.at_impacts import Steps
from archfrag.methods.time_stepping.front import joined_grounds, limits_of, outcome_of, rest_of
from archfrag.methods.time_stepping.recording import no_output, output_to
from archfrag.methods.time_stepping.service import Results, new_results

# Tolerances above this are met by the method of order 3: what only grazes a joint needs order 5.
COARSE = 1e-3
# Steps that end with a sample of the ground motion, and what events and errors add to them.
STEPS_PER_SAMPLE = 4
# Less energy than this, over weight times length, is rounding.
ROUNDING = 1e-12


def new_run(chain: Chain, ground: GroundMotion, options: Options, rest: tuple) -> Run:
    model = model_of(chain)
    n_joint, length = model.friction.size, float(model.length.min())
    progress, speed = np.zeros(len(Progress)), float(np.sqrt(model.gravity * length))
    progress[Progress.STEP], progress[Progress.QUIESCENT_UNTIL] = FIRST * length / speed, -np.inf
    progress[Progress.SWITCH] = BY_UNSOLVED
    resolved = model.gravity * min(1.0, max(1e-3, 1e3 * options.tolerance))
    per_weight = 1.0 / (model.gravity * float(model.mass.sum()))
    scales = Scales(length, speed, resolved, per_weight, float(options.tolerance))
    scheme = THIRD_ORDER if options.tolerance > COARSE else FIFTH_ORDER
    laws, step = new_laws(n_joint), float(options.time_step)
    most_steps = int(options.max_steps) + STEPS_PER_SAMPLE * ground.horizontal.size
    return Run(
        model=model,
        state=new_state(model),
        work=new_work(model),
        mega=new_mega_voussoirs(model),
        motion=Motion(model, new_stages(model.mass.size), scheme, laws, scales),
        progress=progress,
        recent=np.full(ACCUMULATION, -np.inf),
        outward=np.zeros(model.mass.size),
        ground=ground,
        next_break=find_breaks(ground),
        grounds=joined_grounds([ground]),
        steps=Steps(step, step),
        path=new_path(model),
        limits=limits_of(model, options, rest)._replace(first_steps=float(most_steps)),
        most_steps=most_steps,
        crowding=float(options.crowding),
    )


def _scaled(ground: GroundMotion, factor: float) -> GroundMotion:
    return ground._replace(
        horizontal=factor * ground.horizontal, vertical=factor * ground.vertical, factor=1.0
    )


def _refused(chain: Chain, options: Options, results: Results) -> Results:
    refuse(results, np.flatnonzero(~is_accurate(chain, options, results, ROUNDING)))
    return results


def results_of(
    chain: Chain,
    ground: GroundMotion,
    position: np.ndarray,
    velocity: np.ndarray,
    from_rest: bool,
    options: Options,
    frames: Frames,
    log: MechanismLog,
) -> Results:
    """As `run`, as the one row of results."""
    scaled = _scaled(ground, ground.factor)
    model, grounds = model_of(chain), joined_grounds([scaled])
    rest = rest_of(model, options, grounds) if from_rest else (np.nan, np.nan)
    given, results = new_run(chain, scaled, options, rest), new_results(1)
    state, output = given.state, output_to(frames, log, options.frame_interval)
    state.position[1:-1], state.velocity[1:-1] = position, velocity
    follow_phases(given, from_rest and not np.isnan(rest[0]), output, results)
    position[:], velocity[:] = state.position[1:-1], state.velocity[1:-1]
    results.count[0, Count.FRAMES], results.count[0, Count.LOG_ENTRIES] = output.written
    return _refused(chain, options, results)


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
    """Integrate one chain; arguments and result as `archfrag.methods.time_stepping.front.run`."""
    return outcome_of(
        results_of(chain, ground, position, velocity, from_rest, options, frames, log), 0
    )


def run_many(
    chain: Chain,
    grounds: Sequence[GroundMotion],
    motion: np.ndarray,
    factor: np.ndarray,
    options: Options,
) -> Results:
    """One run after the other; as `archfrag.methods.time_stepping.front.run_many`."""
    model, results = model_of(chain), new_results(len(motion))
    rest = rest_of(model, options, joined_grounds(grounds))
    output = no_output(chain.mass.size, chain.friction.size)
    for row, (number, by) in enumerate(zip(motion, factor)):
        given = new_run(chain, _scaled(grounds[number], by), options, rest)
        given.state.position[1:-1, :2] = chain.centroid
        one = new_results(1)
        follow_phases(given, not np.isnan(rest[0]), output, one)
        for gathered, part in zip(results, one):
            gathered[row] = part[0]
    return _refused(chain, options, results)
