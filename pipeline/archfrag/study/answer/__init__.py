"""What follows from the runs of a study: the cube, its curves, classes of arches and risk."""
