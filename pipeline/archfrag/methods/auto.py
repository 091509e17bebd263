"""`auto`: the cheapest of our methods that holds a tolerance.

1. Rest, while the body force stays inside the rest range: nothing is integrated.
2. Steps on all voussoirs for tolerances above `coarse` (2e-4), short at impacts and long between
   them, or equal ones for more than 20 voussoirs: per step a linear problem or two, and four
   runs at a time; the cheapest at the accuracy that a fragility curve or the outcome of a run
   after impacts can use.
3. Mega-voussoirs from event to event for finer tolerances: after impacts steps are of first order,
   and a hundredth of the error would take a hundred times as many. Where events follow each other
   more closely than `hand_over` steps, all voussoirs are stepped.
4. A run that has made or lost more energy, or let bodies overlap more, than its tolerance
   allows is made again with a tenth of it, and again; then it is refused.

The mechanism log of a run says which of them moved it when.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from archfrag.mechanics.collapse import NO_MODE
from archfrag.mechanics.model import model_of
from archfrag.mechanics.status import Count, Energy, Peak, Status
from archfrag.mechanics.types import (
    Chain,
    Frames,
    GroundMotion,
    MechanismLog,
    Options,
    Outcome,
)
from archfrag.methods import event_driven
from archfrag.methods.time_stepping import front as stepper
from archfrag.methods.time_stepping.service import Results, new_results

# A run that is not accurate is made again with a tolerance smaller by this factor, and with the
# steps that go with it.
TIGHTER = 0.1
IMPACT_POWER, LARGEST_POWER = 0.6, 0.4
ATTEMPTS = 3
# Energy that would lift the chain by this part of its longest joint counts for nothing: motions
# that hardly are one end within the first steps.
NEGLIGIBLE = 1e-6
# Between events all voussoirs are stepped at so many times the step that steps at impacts take.
STEADY = 2.0


def refined(options: Options, factor: float) -> Options:
    """Options for a tolerance smaller by a factor."""
    return options._replace(
        tolerance=factor * options.tolerance,
        time_step=factor**IMPACT_POWER * options.time_step,
        largest_step=factor**LARGEST_POWER * options.largest_step,
    )


def _attempts(options: Options) -> Iterator[tuple[int, Options]]:
    for number in range(ATTEMPTS):
        yield number, refined(options, TIGHTER**number)


def is_accurate(chain: Chain, options: Options, results: Results) -> np.ndarray:
    """Which runs are as good as their tolerance allows, by what they measured themselves.

    Parameters
    ----------
    chain : archfrag.mechanics.types.Chain
    options : archfrag.mechanics.types.Options
    results : archfrag.methods.time_stepping.service.Results

    Returns
    -------
    ndarray of bool, (n_run,)
        As `archfrag.methods.event_driven.front.is_accurate`; True for runs that have not ended.
    """
    energy, overlap = results.energy, results.peak[:, Peak.OVERLAP]
    allowed = max(event_driven.ENERGY_ALLOWED * options.accuracy, event_driven.LEAST_ENERGY)
    largest = np.maximum(energy[:, Energy.LARGEST_KINETIC], energy[:, Energy.START_KINETIC])
    weight = chain.gravity * float(np.sum(chain.mass))
    tiny = NEGLIGIBLE * weight * float(model_of(chain).length.max())
    deepest = max(event_driven.OVERLAP_ALLOWED * options.accuracy, event_driven.LEAST_OVERLAP)
    good = energy[:, Energy.STRAY_PEAK] <= allowed * largest + tiny
    ended = np.isin(results.status, (int(Status.STANDING), int(Status.COLLAPSED)))
    return ~ended | (good & (overlap <= deepest))


def _as_good_as_asked(chain: Chain, options: Options, outcome: Outcome) -> bool:
    row = new_results(1)
    row.status[0], row.energy[0], row.peak[0] = outcome.status, *outcome.ledger[1::2]
    return bool(is_accurate(chain, options, row)[0])


def _refuse(results: Results, rows: np.ndarray) -> None:
    results.status[rows] = int(Status.INACCURATE)
    results.collapse_time[rows] = np.nan
    results.collapse_joint[rows] = -1
    results.collapse_mode[rows] = NO_MODE


def run_many(
    chain: Chain,
    grounds: Sequence[GroundMotion],
    motion: np.ndarray,
    factor: np.ndarray,
    options: Options,
) -> Results:
    """Many runs by steps at impacts; as `archfrag.methods.time_stepping.front.run_many`."""
    rows = np.arange(len(motion))
    results = None
    for number, given in _attempts(options):
        made = stepper.run_many(chain, grounds, motion[rows], factor[rows], given)
        made.count[:, Count.REFINED] = number
        good = is_accurate(chain, options, made)
        if results is None:
            results = made
        else:
            for whole, part in zip(results, made):
                whole[rows] = part
        rows = rows[~good]
        if rows.size == 0:
            break
    assert results is not None
    _refuse(results, rows)
    return results


def _run_stepped(
    chain: Chain,
    ground: GroundMotion,
    position: np.ndarray,
    velocity: np.ndarray,
    from_rest: bool,
    options: Options,
    frames: Frames,
    log: MechanismLog,
) -> Outcome:
    start = position.copy(), velocity.copy()
    for number, given in _attempts(options):
        position[:], velocity[:] = start
        results = stepper.results_of(
            chain, ground, position, velocity, from_rest, given, frames, log
        )
        results.count[:, Count.REFINED] = number
        bad = np.flatnonzero(~is_accurate(chain, options, results))
        if bad.size == 0:
            break
    _refuse(results, bad)
    return stepper.outcome_of(results, 0)


def run(
    chain: Chain,
    ground: GroundMotion,
    position: np.ndarray,
    velocity: np.ndarray,
    from_rest: bool,
    options: Options,
    frames: Frames,
    log: MechanismLog,
    hand_over: float,
    coarse: float,
) -> Outcome:
    """Integrate one chain under one ground motion; arguments as `event_driven.run`.

    Parameters
    ----------
    hand_over : float
        Mean time between events, in time steps, below which all voussoirs are stepped.
    coarse : float
        Tolerance above which all voussoirs are stepped throughout.

    Returns
    -------
    archfrag.mechanics.types.Outcome
    """
    if options.tolerance > coarse:
        return _run_stepped(chain, ground, position, velocity, from_rest, options, frames, log)
    start = position.copy(), velocity.copy()
    scaled = ground._replace(
        horizontal=ground.factor * ground.horizontal,
        vertical=ground.factor * ground.vertical,
        factor=1.0,
    )
    fixed = options.largest_step <= options.time_step
    for number in range(ATTEMPTS):
        position[:], velocity[:] = start
        given = refined(options, TIGHTER ** min(number, 1))
        if number == ATTEMPTS - 1:
            outcome = stepper.run(chain, ground, position, velocity, from_rest, given, frames, log)
        else:
            step = given.time_step if fixed else STEADY * given.time_step
            given = given._replace(time_step=step, crowding=hand_over * step)
            outcome = event_driven.run(
                chain, scaled, position, velocity, from_rest, given, frames, log
            )
        outcome.ledger.count[Count.REFINED] = number
        if not _as_good_as_asked(chain, options, outcome):
            outcome = outcome._replace(
                status=int(Status.INACCURATE),
                collapse_time=np.nan,
                collapse_joint=-1,
                collapse_mode=NO_MODE,
            )
        if outcome.status != Status.INACCURATE:
            break
    return outcome
