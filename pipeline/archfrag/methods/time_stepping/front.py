"""Time stepping as a method: from a chain and its ground motions to results."""

import numpy as np

from archfrag.mechanics.ground import Grounds
from archfrag.mechanics.model import Clock, Model, model_of
from archfrag.mechanics.numbers import LANES
from archfrag.mechanics.status import Count
from archfrag.mechanics.types import Chain, Frames, MechanismLog, Options, Results
from archfrag.methods.common import begin, new_results, no_output, output_to, ready
from archfrag.methods.time_stepping.rest import rest_range
from archfrag.methods.time_stepping.run import (
    Jobs,
    finish_one,
    new_four,
    new_one,
    run_four,
    start_at_rest,
    start_given,
)

UNKNOWN = (np.nan, np.nan)


def rest_of(model: Model) -> tuple[float, float]:
    """Rest range of a chain in its own geometry [g]; nan where no load leaves it at rest."""
    one = new_one(model)
    begin(model, one.state, one.work, 0, 0.0)
    found, plus, minus = rest_range(model, one.state, one.work)
    return (plus, minus) if found else UNKNOWN


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
) -> Results:
    """Integrate one chain under one ground motion; the signature of every method.

    Parameters
    ----------
    chain : archfrag.mechanics.types.Chain
    grounds : archfrag.mechanics.ground.Grounds
        One ground motion.
    factor : float
        On it.
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
    archfrag.mechanics.types.Results
        One row.
    """
    model, results = model_of(chain), new_results(1)
    options = ready(options, model, rest_of(model) if from_rest else UNKNOWN)
    state, work, path = new_one(model)[:3]
    output = output_to(frames, log, options.frame_interval)
    state.clock[Clock.FACTOR] = factor
    if from_rest and not np.isnan(options.rest_plus):
        start_at_rest(model, grounds, state, work, path, options, output)
    else:
        state.position[1:-1], state.velocity[1:-1] = position, velocity
        start_given(model, state, work, options, output)
    finish_one(model, grounds, state, work, path, options, output, results, 0)
    position[:], velocity[:] = state.position[1:-1], state.velocity[1:-1]
    results.count[0, Count.FRAMES], results.count[0, Count.LOG_ENTRIES] = output.written
    return results


def run_many(
    chain: Chain, grounds: Grounds, motion: np.ndarray, factor: np.ndarray, options: Options
) -> Results:
    """Integrate one chain from rest under many scaled ground motions, four at a time.

    Parameters
    ----------
    chain : archfrag.mechanics.types.Chain
    grounds : archfrag.mechanics.ground.Grounds
    motion : ndarray, (n_run,)
        Which of them moves each run.
    factor : ndarray, (n_run,)
        On it.
    options : archfrag.mechanics.types.Options

    Returns
    -------
    archfrag.mechanics.types.Results
        A row for each run, the same as of `run`.
    """
    model, results = model_of(chain), new_results(len(motion))
    options = ready(options, model, rest_of(model))
    jobs = Jobs(
        np.ascontiguousarray(motion, np.int64),
        np.ascontiguousarray(factor, float),
        np.zeros(1, np.int64),
        np.full(LANES, -1),
    )
    output = no_output(chain.mass.size, chain.friction.size)
    run_four(model, grounds, new_four(model), new_one(model), options, jobs, output, results)
    return results
