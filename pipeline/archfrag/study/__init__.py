"""Studies: many simulations planned, run in portions, gathered into one cube."""

WORK = ".archfrag"  # in the folder of a study's results: all that is not for people
