"""The methods there are: what schema, help, documentation and tests are made from."""

from collections.abc import Callable
from typing import NamedTuple

AUTO = "auto"


class Parameter(NamedTuple):
    """One setting of a method."""

    name: str
    unit: str
    default: float
    meaning: str


class MethodInfo(NamedTuple):
    """A method of integration; all share one signature (`load`)."""

    name: str
    code: int
    order: int
    meaning: str
    parameters: tuple[Parameter, ...]
    citation: str
    load: Callable[[], Callable]


def _time_stepping():
    from archfrag.methods.time_stepping import run

    return run


METHODS = {
    "time_stepping": MethodInfo(
        name="time_stepping",
        code=1,
        order=2,
        meaning="Moreau-Jean time stepping on all voussoirs; rest is detected and skipped",
        parameters=(
            Parameter("dt", "s", 5e-4, "time step"),
            Parameter("follow", "s", 20.0, "how long to go on past the end of the record"),
        ),
        citation=(
            "Moreau 1988, CISM 302, 1-82; Jean 1999, Comput. Methods Appl. Mech. Engrg. 177, "
            "235-257; Paoli and Schatzman 2002, SIAM J. Numer. Anal. 40(2), 702-733"
        ),
        load=_time_stepping,
    ),
}
AUTO_METHOD = "time_stepping"


def resolve(name: str) -> MethodInfo | None:
    """Method of a given name.

    Parameters
    ----------
    name : str
        A key of `METHODS`, or "auto" for the one that archfrag chooses.

    Returns
    -------
    MethodInfo or None
        None if there is no such method.

    Examples
    --------
    >>> from archfrag.methods.registry import resolve
    >>> resolve("auto").name
    'time_stepping'
    """
    return METHODS.get(AUTO_METHOD if name == AUTO else name)
