"""Runs of a study: the only place where a study's method becomes a call of `simulate`."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from archfrag.arch import Arch
    from archfrag.motions.motion import Motion
    from archfrag.simulate import Response


def simulate_case(
    method: Mapping[str, Any], arch: "Arch", motion: "Motion", factor: float, history: bool = False
) -> "Response":
    """Simulate an arch under a scaled motion by the method of a study.

    Workers call it, and so does whatever does a run of a study again.

    Parameters
    ----------
    method : mapping
        The study's method as plan and cube store it: `name`, and any other arguments of
        `archfrag.simulate.simulate` by their names.
    arch : Arch
    motion : Motion
        Unscaled.
    factor : float
        On the motion, vertical component included.
    history : bool
        Whether to keep the history and the log of the mechanism.
    """
    from archfrag.simulate import simulate

    arguments = {key: value for key, value in method.items() if key != "name"}
    return simulate(
        arch, motion, scale=factor, method=method["name"], history=history, **arguments
    )


def simulate_cases(
    method: Mapping[str, Any],
    arch: "Arch",
    motions: Sequence["Motion"],
    factors: Sequence[float],
) -> list["Response"]:
    """As `simulate_case` for several runs of one arch, four at a time where the method can.

    Parameters
    ----------
    method, arch
        As in `simulate_case`.
    motions : sequence of Motion
        One for each run, unscaled.
    factors : sequence of float
        On them.
    """
    from archfrag.simulation.many import simulate_runs

    arguments = {key: value for key, value in method.items() if key != "name"}
    responses = simulate_runs(arch, motions, factors, method=method["name"], **arguments)
    if responses is not None:
        return responses
    return [
        simulate_case(method, arch, motion, factor) for motion, factor in zip(motions, factors)
    ]
