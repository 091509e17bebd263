"""Study files: their keys and checks, and the arches and records that they name."""
