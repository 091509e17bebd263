"""Studies and their results, for Python."""
