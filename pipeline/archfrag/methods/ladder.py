"""The ladder of models: at every instant the smallest whose assumptions hold, and that pays.

Rest while the body force stays in the rest range; then the few mega-voussoirs that move relative
to each other, with four hinges in closed form; all voussoirs where events follow each other so
closely that locating each costs more than stepping over them. The second level certifies every
step down, an event causes every step up, and the mechanism log says which. Where the tolerance is
coarse no event is worth locating, and all voussoirs are stepped from onset on. A run that is not
as accurate as its tolerance asks, by its own measures, is made again with a tighter one.
"""

from archfrag.mechanics.status import Count, Status
from archfrag.methods import event_driven, time_stepping

# A run that is refused is made again, at most so often, with a tolerance smaller by this factor
# and a step that goes with it.
ATTEMPTS = 3
TIGHTER = 0.1
STEP_POWER = 0.6


def run(
    chain, ground, position, velocity, from_rest, options, frames, log, hand_over, coarse
):  # fmt: skip
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
        return time_stepping.run(
            chain, ground, position, velocity, from_rest, options, frames, log
        )
    start = position.copy(), velocity.copy()
    for attempt in range(ATTEMPTS):
        position[:], velocity[:] = start
        factor = TIGHTER**attempt
        tried = options._replace(
            tolerance=factor * options.tolerance,
            time_step=factor**STEP_POWER * options.time_step,
            crowding=hand_over * factor**STEP_POWER * options.time_step,
        )
        outcome = event_driven.run(
            chain, ground, position, velocity, from_rest, tried, frames, log
        )
        if outcome.status != Status.INACCURATE:
            break
    outcome.ledger.count[Count.REFINED] = attempt
    return outcome
