"""Study files: their keys, checked, and what they name: arches and records."""
