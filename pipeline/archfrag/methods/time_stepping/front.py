"""Time stepping as a method: from a chain and its ground motions to outcomes."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from archfrag.mechanics.contact.path import Path
from archfrag.mechanics.model import Clock, Model, State, Work, model_of
from archfrag.mechanics.numbers import LANES
from archfrag.mechanics.status import Count
from archfrag.mechanics.types import (
    Chain,
    Diagnostics,
    Frames,
    GroundMotion,
    MechanismLog,
    Options,
    Outcome,
)
from archfrag.methods.time_stepping.at_impacts import Steps
from archfrag.methods.time_stepping.motion import Grounds, grounds_of
from archfrag.methods.time_stepping.recording import Output, no_output, output_to
from archfrag.methods.time_stepping.rest import rest_range
from archfrag.methods.time_stepping.run import (
    Jobs,
    new_four,
    new_one,
    run_four,
    run_given,
    run_one,
)
from archfrag.methods.time_stepping.service import STILL, Limits, Results, begin, new_results


def steps_of(options: Options) -> Steps:
    """Sizes of steps that options ask for: fixed ones where largest and shortest are equal."""
    shortest = float(options.time_step)
    return Steps(max(float(options.largest_step), shortest), shortest)


def limits_of(model: Model, options: Options, rest: tuple[float, float]) -> Limits:
    return Limits(
        follow=float(options.follow),
        loss_limit=float(options.loss_limit),
        check_interval=int(options.check_interval),
        still=float(STILL * np.sqrt(model.gravity * model.length.max())),
        rest_plus=rest[0],
        rest_minus=rest[1],
    )


def joined_grounds(grounds: Sequence[GroundMotion]) -> Grounds:
    return grounds_of([(g.horizontal, g.vertical, g.time_step) for g in grounds])


def rest_of(model: Model, options: Options, grounds: Grounds) -> tuple[float, float]:
    """Rest range of a chain in its own geometry [g]; nan where no load leaves it at rest."""
    one = new_one(model)
    limits = limits_of(model, options, (np.nan, np.nan))
    begin(model, grounds, one.state, one.work, steps_of(options), limits, 0, 0.0)
    found, plus, minus = rest_range(model, one.state, one.work)
    return (plus, minus) if found else (np.nan, np.nan)


class Case(NamedTuple):
    """All that one run takes."""

    model: Model
    grounds: Grounds
    state: State
    work: Work
    path: Path
    steps: Steps
    limits: Limits
    output: Output
    results: Results


def case_of(
    chain: Chain, ground: GroundMotion, from_rest: bool, options: Options, frames: Frames,
    log: MechanismLog,
) -> Case:  # fmt: skip
    """A case that has not been started; its range of rest is known where it begins at rest."""
    model, grounds = model_of(chain), joined_grounds([ground])
    rest = rest_of(model, options, grounds) if from_rest else (np.nan, np.nan)
    one = new_one(model)
    one.state.clock[Clock.FACTOR] = ground.factor
    return Case(
        model,
        grounds,
        one.state,
        one.work,
        one.path,
        steps_of(options),
        limits_of(model, options, rest),
        output_to(frames, log, options.frame_interval),
        new_results(1),
    )


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
    case = case_of(chain, ground, from_rest, options, frames, log)
    state, results = case.state, case.results
    if from_rest and not np.isnan(case.limits.rest_plus):
        run_one(*case)
    else:
        state.position[1:-1], state.velocity[1:-1] = position, velocity
        run_given(*case)
    position[:], velocity[:] = state.position[1:-1], state.velocity[1:-1]
    results.count[0, Count.FRAMES], results.count[0, Count.LOG_ENTRIES] = case.output.written
    return results


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
    """Integrate one chain from rest under many scaled ground motions, four at a time.

    Parameters
    ----------
    chain : archfrag.mechanics.types.Chain
    grounds : sequence of archfrag.mechanics.types.GroundMotion
        Unscaled.
    motion : ndarray, (n_run,)
        Which of them moves each run.
    factor : ndarray, (n_run,)
        On it.
    options : archfrag.mechanics.types.Options

    Returns
    -------
    Results
        A row for each run, the same as of `run`.
    """
    model, joined, results = model_of(chain), joined_grounds(grounds), new_results(len(motion))
    rest = rest_of(model, options, joined)
    jobs = Jobs(
        np.ascontiguousarray(motion, np.int64),
        np.ascontiguousarray(factor, float),
        np.zeros(1, np.int64),
        np.full(LANES, -1),
    )
    output = no_output(chain.mass.size, chain.friction.size)
    limits, steps = limits_of(model, options, rest), steps_of(options)
    four, one = new_four(model), new_one(model)
    run_four(model, joined, four, one, steps, limits, jobs, output, results)
    return results


def outcome_of(results: Results, row: int) -> Outcome:
    """One row of results as what every method returns."""
    diagnostics = Diagnostics(
        results.count[row].astype(np.int64),
        results.energy[row],
        results.model_time[row],
        results.peak[row],
    )
    return Outcome(
        int(results.status[row]),
        float(results.end_time[row]),
        float(results.collapse_time[row]),
        int(results.collapse_joint[row]),
        int(results.collapse_mode[row]),
        results.loss[row],
        diagnostics,
    )
