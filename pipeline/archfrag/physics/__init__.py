"""Mechanics of rigid bodies in contact."""
