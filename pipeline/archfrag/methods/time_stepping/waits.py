"""Why a run waits, in ``state.clock[Clock.CODE]``."""

# Nothing; modes that are not reconciled; something is due between steps; collapse; the time is
# up, or the work allowed is spent; positions overflowed; at rest for good. Up to PAUSE a run
# goes on.
GO, UNSOLVED, PAUSE, FALLEN, AT_END, EXHAUSTED, BROKEN, IDLE = 0, 1, 2, 3, 4, 5, 6, 7
