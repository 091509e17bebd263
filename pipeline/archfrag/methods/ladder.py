"""The ladder of models: at every instant the smallest whose assumptions hold, and that pays.

Rest while the body force stays in the rest range; then the few mega-voussoirs that move relative
to each other, with four hinges in closed form; all voussoirs where events follow each other so
closely that locating each costs more than stepping over them. The second level certifies every
step down, an event causes every step up, and the mechanism log says which. Where the tolerance is
coarse no event is worth locating, and all voussoirs are stepped from onset on.
"""

from archfrag.methods import event_driven, time_stepping


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
    case = chain, ground, position, velocity, from_rest
    if options.tolerance > coarse:
        return time_stepping.run(*case, options, frames, log)
    crowding = hand_over * options.time_step
    return event_driven.run(*case, options._replace(crowding=crowding), frames, log)
