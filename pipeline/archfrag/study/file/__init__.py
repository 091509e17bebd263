"""The study file: what may stand in it, and the arches, records and hazard that it names."""
