"""Outcomes that kernels return instead of raising."""

from enum import IntEnum


class Status(IntEnum):
    """How a run or a contact problem ended; `archfrag.errors` has a sentence for each."""

    STANDING = 0
    COLLAPSED = 1
    UNFINISHED = 2
    NO_CONTACT_SOLUTION = 3
    DOES_NOT_STAND = 4
    NOT_FINITE = 5
    WORK_BOUND = 6


class CollapseMode(IntEnum):
    """How the joint that lost contact was moving before it did."""

    NONE = 0
    HINGING = 1
    SLIDING = 2
    LIFT_OFF = 3
    OVERTURNING = 4
