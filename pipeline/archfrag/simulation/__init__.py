"""Results of a simulation: rest range, response, history, log of the mechanism."""
