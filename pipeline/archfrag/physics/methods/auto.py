"""`auto`: the cheapest of our methods that holds a tolerance.

1. Rest, while the body force stays inside the range of rest: nothing is integrated.
2. Steps on all voussoirs, located at impacts, for ground motions as they are recorded; four or
   eight runs at a time.
3. Mega-voussoirs from event to event for tolerances of `COARSE` and below, and for a history of
   `SMALL_CHAIN` bodies under a ground motion with rare breaks: there events are rare, so that
   they cost little and give peaks and histories exactly. A chain that is not to rest wherever it
   can goes this way, too: a slip in progress keeps its sense, where a step may lock it.
4. A run that has made or lost more energy, or let bodies overlap more, than its tolerance allows,
   or whose contacts were not solved, is made again by the other method, and then by equal steps.
   Several spans go by steps only.
   If none of them holds the tolerance, the run is refused.

The mechanism log of a run states which of the methods moved it when.
"""

from collections.abc import Callable, Sequence
from types import ModuleType

import numpy as np

from archfrag.physics.events import phases as events
from archfrag.physics.ground import Grounds
from archfrag.physics.interface import Chain, Frames, MechanismLog, Options, Outcomes
from archfrag.physics.shared import is_accurate, new_results, refuse
from archfrag.physics.status import Count, Status
from archfrag.physics.steps import run as stepper
from archfrag.physics.steps.run import Given, Lanes

# Outcomes for which another method is tried.
AGAIN_BY_OTHERS = (int(Status.INACCURATE), int(Status.NO_CONTACT_SOLUTION))
# Up to the tolerance COARSE runs go by events whatever moves them, up to COARSEST where events are
# rare.
COARSE = 2e-4
COARSEST = 0.01
AGAIN = 2e-5  # tolerance by events of runs that steps made inaccurately
SMALL_CHAIN = 10
MOST_BREAKS = 50
# Where events follow each other more closely than so many steps, all voussoirs are stepped. These
# steps are `STEADY` times as long as those at impacts.
SWITCH_STEPS = 3.0
STEADY = 2.0
# Equal steps that are made again are shorter by this factor.
SHORTER = 0.25


def count_breaks(grounds: Grounds) -> int:
    """Return the number of samples at which the slope of the ground acceleration changes."""
    return int(np.unique(grounds.next_break).size) - 1


def goes_by_events(tolerance: float, n_body: int = 0, n_break: float = np.inf) -> bool:
    """Return whether `auto` integrates from event to event rather than by steps on all voussoirs.

    `n_break` is `count_breaks` where a history is asked for, else infinite.

    Examples
    --------
    >>> from archfrag.physics.methods.auto import goes_by_events
    >>> goes_by_events(1e-3), goes_by_events(1e-3, 7, n_break=4), goes_by_events(1e-4)
    (False, True, True)
    """
    rare = n_body <= SMALL_CHAIN and n_break <= MOST_BREAKS
    return tolerance <= COARSE or (rare and tolerance <= COARSEST)


def _attempts(
    chain: Chain, options: Options, by_events: bool
) -> list[tuple[ModuleType, Options]]:
    """List the methods to try, with their options.

    Runs that one of them makes inaccurately are made again by the next.
    """
    step = options.time_step
    shorter = options._replace(time_step=SHORTER * step)
    if chain.joint is not None:
        return [(stepper, options), (stepper, shorter)]
    grows = options.largest_step > step
    steady = STEADY * step if grows else step
    # Equal steps at once are made again by shorter ones.
    equal = (options if grows else shorter)._replace(largest_step=0.0)
    last = [(stepper, options), (stepper, equal)]
    if chain.body is not None:
        return last
    if by_events:
        close = SWITCH_STEPS * steady if options.tolerance <= COARSE else 0.0
        return [(events, options._replace(time_step=steady, crowding=close)), *last]
    fine = min(options.tolerance, AGAIN)
    again = options._replace(tolerance=fine, crowding=0.0, time_step=steady)
    return [last[0], (events, again), last[1]]


def _made_well(
    chain: Chain,
    attempts: Sequence[tuple[ModuleType, Options]],
    results: Outcomes,
    make: Callable[[ModuleType, Options, np.ndarray], Outcomes],
) -> Outcomes:
    """Repeat inaccurate runs of the first attempt, in `results`, by the next; return `results`.

    `make` takes a method, its options and the numbers of the runs to make. Runs that are still
    inaccurate after the last attempt are refused.
    """
    rows = np.arange(len(results.status))
    for number, (method, given) in enumerate(attempts):
        made = make(method, given, rows) if number else results
        made.count[:, Count.REFINED] = number
        for gathered, part in zip(results, made) if number else ():
            gathered[rows] = part
        good = is_accurate(chain, given, made) & ~np.isin(made.status, AGAIN_BY_OTHERS)
        rows = rows[~good]
        if rows.size == 0:
            break
    refuse(results, rows[results.status[rows] != Status.NO_CONTACT_SOLUTION])
    return results


def run_many(
    chain: Chain,
    grounds: Grounds,
    motion: np.ndarray,
    factor: np.ndarray,
    options: Options,
) -> Outcomes:
    """Make many runs, and inaccurate ones again by other methods; return a row for each.

    Run k has motion number ``motion[k]`` times ``factor[k]``, from rest. Arguments are those of
    `archfrag.physics.steps.run.run_many`. A run that no method makes well enough is refused.
    """
    attempts = _attempts(chain, options, goes_by_events(options.tolerance))

    def make(method: ModuleType, given: Options, rows: np.ndarray) -> Outcomes:
        return method.run_many(chain, grounds, motion[rows], factor[rows], given)

    first = make(*attempts[0], np.arange(len(motion)))
    return _made_well(chain, attempts, first, make)


def lanes(chain: Chain, options: Options) -> Lanes | None:
    """Return lanes for runs of a chain; None if its runs do not go side by side."""
    attempts = _attempts(chain, options, goes_by_events(options.tolerance))

    def check(results: Outcomes, given: Sequence[Given]) -> Outcomes:
        def make(method: ModuleType, options: Options, rows: np.ndarray) -> Outcomes:
            made = new_results(rows.size)
            for to, row in enumerate(rows.tolist()):
                ground, factor, own = given[row]
                options = options._replace(max_steps=own.max_steps)
                alone = method.run_many(chain, ground, [0], [factor], options)
                for gathered, part in zip(made, alone):
                    gathered[to] = part[0]
            return made

        return _made_well(chain, attempts, results, make)

    method, given = attempts[0]
    return stepper.lanes(chain, given, check) if method is stepper else None


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
    """Integrate one chain under one ground motion.

    Arguments are those of `archfrag.physics.steps.run.run`.
    """
    start = position.copy(), velocity.copy()

    def make(method: ModuleType, given: Options, rows: np.ndarray) -> Outcomes:
        position[:], velocity[:] = start
        return method.run(
            chain, grounds, factor, position, velocity, from_rest, given, frames, log
        )

    n_break = count_breaks(grounds) if frames.time.size else np.inf
    by_events = (
        goes_by_events(options.tolerance, chain.mass.size, n_break) or not options.rests
    )
    attempts = _attempts(chain, options, by_events)
    return _made_well(chain, attempts, make(*attempts[0], np.zeros(1, int)), make)
