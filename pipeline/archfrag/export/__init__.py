"""Curves and runs of a study in the formats of other programs.

NRML 0.5 for OpenQuake, a damage database for pelicun, a DFR3 set for IN-CORE, and CSV or Parquet
tables. Units are those that the receiver expects and are named in each file.
"""
