"""Curves and runs of a study for other programs: NRML 0.5, pelicun, IN-CORE, CSV and Parquet."""
