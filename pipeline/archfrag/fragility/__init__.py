"""Statistics of collapse against intensity, on plain arrays."""
