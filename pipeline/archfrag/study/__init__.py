"""Studies: many simulations planned, run in portions, gathered into one cube."""
