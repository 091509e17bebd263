"""Ground motions: read, process, measure, scale, make."""
