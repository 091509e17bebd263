"""The ladder of models: at every instant the smallest whose assumptions hold, and that pays.

Rest while the body force stays in the rest range; then the few mega-voussoirs that move relative
to each other, with four hinges in closed form; all voussoirs where events follow each other so
closely that locating each costs more than stepping over them. The second level certifies every
step down, an event causes every step up, and the mechanism log says which.
"""

from archfrag.methods import event_driven

# An event costs about as much as so many time steps of the whole chain.
STEPS_PER_EVENT = 3.0


def run(chain, ground, position, velocity, from_rest, options, frames, log):
    """Integrate one chain under one ground motion; arguments as `event_driven.run`.

    Returns
    -------
    archfrag.mechanics.types.Outcome
    """
    crowding = STEPS_PER_EVENT * options.time_step
    return event_driven.run(
        chain, ground, position, velocity, from_rest, options._replace(crowding=crowding),
        frames, log,
    )  # fmt: skip
