"""The runs of a study: how they are requested, distributed to workers and stored."""
