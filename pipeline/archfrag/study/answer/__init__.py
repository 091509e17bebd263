"""Results of a study's runs: the cube, its curves, classes of arches and risk."""
