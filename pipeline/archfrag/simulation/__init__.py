"""What a simulation tells: rest range, response, history, log of the mechanism."""
