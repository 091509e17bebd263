"""The ladder of models: at every instant the smallest whose assumptions hold, and that pays.

Rest while the body force stays in the rest range; then the few mega-voussoirs that move relative
to each other, with four hinges in closed form; all voussoirs where events follow each other so
closely that locating each costs more than stepping over them. The second level certifies every
step down, an event causes every step up, and the mechanism log says which. Where the tolerance is
coarse no event is worth locating, and all voussoirs are stepped from onset on. A run that is not
as accurate as its tolerance asks, by its own measures, is made again with a tighter one, and where
that does not help by steps alone; then it is refused.
"""

import numpy as np

from archfrag.mechanics.collapse import NO_MODE
from archfrag.mechanics.kinematics import joint_lengths
from archfrag.mechanics.status import Count, Status
from archfrag.methods import event_driven, time_stepping

# A run that is not accurate is made again with a tolerance smaller by this factor, and with the
# step that goes with it.
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
    start = position.copy(), velocity.copy()

    def attempt(method, factor):
        position[:], velocity[:] = start
        step = factor**STEP_POWER * options.time_step
        given = options._replace(
            tolerance=factor * options.tolerance, time_step=step, crowding=hand_over * step
        )
        return method.run(chain, ground, position, velocity, from_rest, given, frames, log)

    if options.tolerance > coarse:
        return attempt(time_stepping, 1.0)
    lengths = joint_lengths(chain)
    for number, (method, factor) in enumerate(
        ((event_driven, 1.0), (event_driven, TIGHTER), (time_stepping, TIGHTER))
    ):
        outcome = attempt(method, factor)
        outcome.ledger.count[Count.REFINED] = number
        ended = outcome.status in (Status.STANDING, Status.COLLAPSED)
        if ended and not event_driven.is_accurate(chain, lengths, options, outcome.ledger):
            outcome = outcome._replace(
                status=int(Status.INACCURATE),
                collapse_time=np.nan,
                collapse_joint=-1,
                collapse_mode=NO_MODE,
            )
        if outcome.status != Status.INACCURATE:
            break
    return outcome
