"""What a simulation returns: rest range, response, history, log of the mechanism."""
