"""Runs of a study: the only place where a study's method becomes a call of `simulate`."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

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


def tabulate_cases(
    method: Mapping[str, Any], arch: "Arch", motions: Sequence["Motion"], factors: Sequence[float]
) -> tuple[dict[str, NDArray], NDArray[np.float64]]:
    """As `simulate_case` for several runs of one arch, four at a time where the method can."""
    from archfrag.simulation.many import results_of_runs
    from archfrag.study.outcome import columns_of, table_of

    arguments = {key: value for key, value in method.items() if key != "name"}
    runs = results_of_runs(arch, motions, factors, method=method["name"], **arguments)
    if runs is not None:
        return columns_of(runs.results), runs.wall_time
    responses = [
        simulate_case(method, arch, motion, factor) for motion, factor in zip(motions, factors)
    ]
    return table_of(responses), np.array([response.wall_time for response in responses])
