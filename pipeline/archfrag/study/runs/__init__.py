"""The runs of a study: asked for, fanned out, stored."""
