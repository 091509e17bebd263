"""Table of the methods, from which schema, help, documentation and tests are made.

`archbench` registers the baselines that it compares them with.
"""

import math
from collections.abc import Callable
from importlib import import_module
from typing import NamedTuple

AUTO = "auto"


class Parameter(NamedTuple):
    """One setting of a method; values from `least` to `most` are allowed."""

    name: str
    unit: str
    default: float
    meaning: str
    least: float = 0.0
    most: float = math.inf


class MethodInfo(NamedTuple):
    """A method of integration: a module with a function `run`, whose signature all methods share.

    A method that scales ground motions itself also has `run_many`, as
    `archfrag.physics.steps.run`, which makes many runs at once. Parameters that only one method
    has follow the shared arguments, by keyword.
    """

    name: str
    meaning: str
    parameters: tuple[Parameter, ...]
    citation: str
    module: str
    needs: str | None = None  # package that it cannot run without
    # Function of a tolerance and a number of bodies. It returns the step at impacts and the
    # largest step, over the root of the shortest joint's length over gravity [1]; equal ones are
    # fixed.
    step_rule: Callable[[float, int], tuple[float, float]] | None = None

    def load(self, function: str = "run") -> Callable | None:
        """Import the method's module, and return a function of it; None if it has none."""
        return getattr(import_module(self.module), function, None)


# Default step of time stepping over the root of the shortest joint's length over gravity, so that
# it scales with the arch. 0.5 ms for a joint of 1.5 m.
OWN_STEP = 1.28e-3


def own_step(rtol: float, n_body: int) -> tuple[float, float]:
    """Return `OWN_STEP` twice: the steps of methods that use time steps as a fallback.

    Arguments and result are those of `steps_of_tolerance`.
    """
    return OWN_STEP, OWN_STEP


# Arches of more voussoirs take longer steps: each impact involves a smaller part of the arch, and
# fragility curves are the same (docs/limits.md).
FEW_VOUSSOIRS = 20


def steps_of_tolerance(rtol: float, n_body: int) -> tuple[float, float]:
    """Return the steps at impacts, and the largest between them, that go with a tolerance.

    Both are over the root of the shortest joint's length over gravity [1]. For joints of 1.5 m at
    the default tolerance they are 0.4 and 4 ms, with more than 20 voussoirs 1.6 and 8 ms. Where
    impacts follow each other closely, the error of time stepping is of first order in the step at
    impacts; else, and through lone impacts, of second order in the largest step.

    Examples
    --------
    >>> from archfrag.physics.methods.registry import steps_of_tolerance
    >>> [round(steps_of_tolerance(rtol, 7)[0], 6) for rtol in (1e-1, 1e-2, 1e-3, 1e-4, 1e-9)]
    [0.016229, 0.004077, 0.001024, 0.000257, 4.1e-05]
    """
    impact, largest = (0.8, 8.0) if n_body <= FEW_VOUSSOIRS else (3.2, 16.0)
    scale = rtol / 1e-3
    impact *= OWN_STEP * min(max(scale**0.6, 0.04), 32.0)
    return impact, max(largest * OWN_STEP * min(max(scale**0.4, 0.1), 4.0), impact)


# Methods that take joints that give, and several spans. With joints that give their equal steps
# are this part of the largest step with rigid ones.
BY_STEPS = (AUTO, "time_stepping")
FACE_STEP = 0.5


_OWN = (
    "if not given, it follows the root of the shortest joint's length: 0.5 ms for 1.5 m"
)
FIXED = Parameter("dt", "s", 5e-4, "fixed time step; if not given, steps follow rtol")
FOLLOW = Parameter("follow", "s", 20.0, "how long to go on past the end of the record")
METHODS = {
    "time_stepping": MethodInfo(
        name="time_stepping",
        meaning=(
            "Moreau-Jean time stepping on all voussoirs, steps short at impacts and long between "
            "them; rest is detected and skipped"
        ),
        parameters=(
            Parameter("rtol", "1", 1e-3, "relative error that steps are chosen for"),
            FIXED,
            FOLLOW,
        ),
        citation=(
            "Moreau 1988, CISM 302, 1-82; Jean 1999, Comput. Methods Appl. Mech. Engrg. 177, "
            "235-257; Paoli and Schatzman 2002, SIAM J. Numer. Anal. 40(2), 702-733"
        ),
        module="archfrag.physics.steps.run",
        step_rule=steps_of_tolerance,
    ),
    "event_driven": MethodInfo(
        name="event_driven",
        meaning=(
            "mega-voussoirs between located events (Sinopoli's semi-analytical approach); time "
            "stepping only while events accumulate"
        ),
        parameters=(
            Parameter("rtol", "1", 1e-6, "relative error allowed between events"),
            Parameter("dt", "s", 5e-4, f"time step while events accumulate; {_OWN}"),
            FOLLOW,
        ),
        citation=(
            "A. Sinopoli, A semi-analytical approach for masonry arch dynamics; Dormand and "
            "Prince 1980, J. Comput. Appl. Math. 6(1), 19-26"
        ),
        module="archfrag.physics.events.phases",
        step_rule=own_step,
    ),
    AUTO: MethodInfo(
        name=AUTO,
        meaning=(
            "the cheapest that holds the tolerance: rest, steps on all voussoirs located at "
            "impacts, mega-voussoirs from event to event for fine tolerances"
        ),
        parameters=(
            Parameter("rtol", "1", 1e-3, "relative error allowed"),
            FIXED,
            FOLLOW,
        ),
        citation="as event_driven (Dormand and Prince 1980) and time_stepping (Moreau 1988)",
        module="archfrag.physics.methods.auto",
        step_rule=steps_of_tolerance,
    ),
}

_REGISTERED: dict[str, MethodInfo] = {}


def register(*methods: MethodInfo) -> None:
    """Add methods of other packages for `archfrag.simulate`; studies use `METHODS` only."""
    _REGISTERED.update({method.name: method for method in methods})


def known_methods() -> dict[str, MethodInfo]:
    """Return all methods by their names: `METHODS`, then those registered."""
    return METHODS | _REGISTERED
