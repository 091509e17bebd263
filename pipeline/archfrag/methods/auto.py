"""`auto`: the cheapest of our methods that holds a tolerance.

1. Rest, while the body force stays inside the range of rest: nothing is integrated.
2. Mega-voussoirs from event to event for tolerances of `coarse` (2e-4) and below: after impacts
   steps are of first order, and a hundredth of the error would take a hundred times as many.
   Above it, too, where events are rare and so cheaper and far more accurate than steps: for
   `FEWEST_BODIES` bodies, or for `SMALL_CHAIN` whose ground motion has at most `SHORT_PULSE`
   breaks, as a pulse. Where many events follow each other more closely than `switch_steps`
   steps, all voussoirs are stepped.
3. Otherwise steps on all voussoirs, short at impacts and long between them, or equal ones for
   more than 20 voussoirs: per step a linear problem or two, and four runs at a time.
4. A run that has made or lost more energy, or let bodies overlap more, than its tolerance
   allows is made again with a tenth of it, and again by steps; then it is refused.

The mechanism log of a run states which of them moved it when.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from types import ModuleType

import numpy as np

from archfrag.mechanics.model import model_of
from archfrag.mechanics.status import Count, Status
from archfrag.mechanics.types import Chain, Frames, GroundMotion, MechanismLog, Options, Outcome
from archfrag.methods.base import is_accurate, refuse
from archfrag.methods.event_driven import front as events
from archfrag.methods.time_stepping import front as stepper
from archfrag.methods.time_stepping.service import Results

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
FEWEST_BODIES, SMALL_CHAIN, SHORT_PULSE = 2, 10, 50
# Tolerances above these ask for no more than some long steps: with up to `SHORT_PULSE` breaks,
# and with more.
COARSEST, COARSEST_OF_MANY = 0.2, 0.01


def goes_by_events(n_body: int, n_break: int, tolerance: float, coarse: float) -> bool:
    """Whether runs go from event to event rather than by steps on all voussoirs.

    Parameters
    ----------
    n_body : int
    n_break : int
        Times at which the ground acceleration is not linear (`count_breaks`).
    tolerance, coarse : float

    Examples
    --------
    >>> from archfrag.methods.auto import goes_by_events
    >>> [goes_by_events(7, n_break, 1e-3, 2e-4) for n_break in (4, 4000)]
    [True, False]
    """
    if tolerance <= coarse:
        return True
    pulse = n_body <= SMALL_CHAIN and n_break <= SHORT_PULSE and tolerance <= COARSEST
    return coarse > 0.0 and (pulse or (n_body <= FEWEST_BODIES and tolerance <= COARSEST_OF_MANY))


def count_breaks(*parts: np.ndarray) -> int:
    """Number of samples at which the components of a ground acceleration are not linear in time.

    Parameters
    ----------
    *parts : ndarray, (n_sample,)

    Examples
    --------
    >>> import numpy as np
    >>> from archfrag.methods.auto import count_breaks
    >>> count_breaks(np.where(np.arange(900) < 300, 1.0, 0.0), np.zeros(900))
    2
    """
    largest = max(float(np.abs(part).max()) for part in parts)
    bend = sum(np.abs(np.diff(part, 2)) for part in parts)
    return int(np.count_nonzero(bend > 1e-12 * largest))


def _sparse(chain: Chain, ground: GroundMotion, options: Options, coarse: float) -> bool:
    n_break = count_breaks(ground.horizontal, ground.vertical)
    return goes_by_events(chain.mass.size, n_break, options.tolerance, coarse)


def _rests(ground: GroundMotion, factor: float, gravity: float, rest: tuple) -> bool:
    """Whether the body force never leaves the range of rest [g]; then nothing is integrated."""
    upward, across = gravity + factor * ground.vertical, factor * ground.horizontal
    if not upward.min() > 0.0:
        return False
    return bool((rest[0] * upward > across).all() and (rest[1] * upward > -across).all())


def refined(options: Options, factor: float) -> Options:
    """Options for a tolerance smaller by a factor."""
    return options._replace(
        tolerance=factor * options.tolerance,
        time_step=factor**IMPACT_POWER * options.time_step,
        largest_step=factor**LARGEST_POWER * options.largest_step,
    )


def _attempts(
    options: Options, by_events: bool, switch_steps: float, coarse: float
) -> Iterator[tuple[ModuleType, Options]]:
    """Methods and their options, each for runs that the one before did not make well enough."""
    if not by_events:
        for number in range(ATTEMPTS):
            yield stepper, refined(options, TIGHTER**number)
        return
    fixed = options.largest_step <= options.time_step
    # Where events are rare, those that follow each other closely are soon over.
    closest = switch_steps if options.tolerance <= coarse else 0.0
    for number in range(ATTEMPTS - 1):
        given = refined(options, TIGHTER**number)
        step = given.time_step if fixed else STEADY * given.time_step
        yield events, given._replace(time_step=step, crowding=closest * step)
    yield stepper, refined(options, TIGHTER)


def _made_well(
    chain: Chain,
    attempts: Iterator[tuple[ModuleType, Options]],
    n_run: int,
    make: Callable[[ModuleType, Options, np.ndarray], Results],
) -> Results:
    """Runs, again by the next attempt where they are not accurate; refused after the last."""
    results, rows = None, np.arange(n_run)
    for number, (method, given) in enumerate(attempts):
        made = make(method, given, rows)
        made.count[:, Count.REFINED] = number
        good = is_accurate(chain, given, made, NEGLIGIBLE) & (made.status != Status.INACCURATE)
        if results is None:
            results = made
        else:
            for gathered, part in zip(results, made):
                gathered[rows] = part
        rows = rows[~good]
        if rows.size == 0:
            break
    assert results is not None
    refuse(results, rows)
    return results


def run_many(
    chain: Chain,
    grounds: Sequence[GroundMotion],
    motion: np.ndarray,
    factor: np.ndarray,
    options: Options,
    switch_steps: float,
    coarse: float,
) -> Results:
    """Many runs; as `archfrag.methods.time_stepping.front.run_many`, settings as for `run`."""

    def make(runs: np.ndarray, method: ModuleType, given: Options, rows: np.ndarray) -> Results:
        chosen = runs[rows]
        return method.run_many(chain, grounds, motion[chosen], factor[chosen], given)

    sparse = np.array([_sparse(chain, ground, options, coarse) for ground in grounds])[motion]
    if sparse.any():
        model, joined = model_of(chain), stepper.joined_grounds(grounds)
        rest = stepper.rest_of(model, options, joined)
        for row in np.flatnonzero(sparse):
            sparse[row] = not _rests(grounds[motion[row]], factor[row], chain.gravity, rest)
    results = stepper.new_results(len(motion))
    for by_events in (False, True):
        runs = np.flatnonzero(sparse == by_events)
        if runs.size:
            attempts = _attempts(options, by_events, switch_steps, coarse)
            made = _made_well(chain, attempts, runs.size, partial(make, runs))
            for gathered, part in zip(results, made):
                gathered[runs] = part
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
    switch_steps: float,
    coarse: float,
) -> Outcome:
    """Integrate one chain under one ground motion; arguments as `time_stepping.front.run`.

    Parameters
    ----------
    switch_steps : float
        Mean time between events, in time steps, below which all voussoirs are stepped.
    coarse : float
        Tolerance above which all voussoirs are stepped, unless events are rare; 0: always.

    Returns
    -------
    archfrag.mechanics.types.Outcome
    """
    start = position.copy(), velocity.copy()

    def make(method: ModuleType, given: Options, rows: np.ndarray) -> Results:
        position[:], velocity[:] = start
        return method.results_of(chain, ground, position, velocity, from_rest, given, frames, log)

    sparse = _sparse(chain, ground, options, coarse)
    if sparse and from_rest:
        rest = stepper.rest_of(model_of(chain), options, stepper.joined_grounds([ground]))
        sparse = not _rests(ground, ground.factor, chain.gravity, rest)
    attempts = _attempts(options, sparse, switch_steps, coarse)
    return stepper.outcome_of(_made_well(chain, attempts, 1, make), 0)
