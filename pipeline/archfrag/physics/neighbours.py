"""Neighbours of bodies and joints: in a row, or by the tables of a bridge of several spans.

Kernels are compiled twice: where the tables are None, what they would say is known.
"""

from archfrag.physics.kernels.kernel import inlined


@inlined
def _row(body, j, side):
    if body is None:
        return j + side
    return body[j, side]


@inlined
def row_of(model, j, side):
    """Return the row of the body before joint `j` (`side` 0), or of the one after it (1)."""
    return _row(model.body, j, side)


@inlined
def _end(body, end, of):
    if body is None:
        return of.shape[0] - 1
    return end


@inlined
def end_of(model, of):
    """Return the number of the row behind the last body, of an array with a row for each."""
    return _end(model.body, model.end, of)


@inlined
def _bed(bed, j):
    if bed is None:
        return -1
    return bed[j]


@inlined
def bed_of(model, j):
    """Return the joint below the top course at which joint `j` of a spine lies; -1 if at none."""
    return _bed(model.bed, j)


@inlined
def is_behind_fork(model, j):
    """Return whether the body before joint `j` is a top course, which has three joints."""
    bed = bed_of(model, j)
    return bed >= 0 and bed == bed_of(model, j - 1)


@inlined
def _ahead(ahead, i, side):
    if ahead is None:
        return i + side
    return ahead[i, side]


@inlined
def ahead_of(model, i):
    """Return the last joint of body `i` to be eliminated, and the row of the body behind it."""
    return _ahead(model.ahead, i, 0), _ahead(model.ahead, i, 1)


@inlined
def follows(model, j):
    """Return whether joint `j` shares a body with joint ``j - 1``."""
    return j > 0 and row_of(model, j, 0) == row_of(model, j - 1, 1)
