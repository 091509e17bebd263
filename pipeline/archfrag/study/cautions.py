"""What must be known before a curve is used: runs that decide nothing, motions scaled far."""

from collections.abc import Sequence

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from archfrag.fragility.counts import VerdictCounts, count_verdicts
from archfrag.study.config import Study
from archfrag.study.fits import open_cube

MOST_UNDECIDED = 0.05  # fraction of the runs at a level
MOST_SCALING = 10.0


def study_cautions(study: Study) -> list[str]:
    """All that a study's cube gives reason to say, levels in the study's unit.

    Returns
    -------
    list of str
        Sentences; none for a cube in order.

    Raises
    ------
    InputError, OutputError
        See `archfrag.study.fits.open_cube`.
    """
    levels = [f"{level:.4g} {study.intensity.unit}" for level in study.intensity.given]
    with open_cube(study) as cube:
        found = [
            f"{name}: {sentence}"
            for number, name in enumerate(cube["arch"].values)
            if (sentence := undecided(_counts(cube, number), levels))
        ]
        return found + [sentence for sentence in (scaled_far(cube, levels),) if sentence]


def _counts(cube: xr.Dataset, arch: int) -> VerdictCounts:
    return count_verdicts(cube["verdict"].isel(arch=arch).transpose("record", "level").values)


def undecided(counts: VerdictCounts, levels: Sequence[str]) -> str:
    """Sentence on unfinished and failed runs; empty if at no level they are too many.

    Parameters
    ----------
    counts : VerdictCounts
    levels : sequence of str, (n_level,)
        With their unit.
    """
    lost = counts.unfinished + counts.solver_failures
    share = lost / np.maximum(counts.runs, 1)
    many = int(np.count_nonzero(share > MOST_UNDECIDED))
    if not many:
        return ""
    worst = int(share.argmax())
    return (
        f"more than {100 * MOST_UNDECIDED:g} % of the runs are unfinished or failed at {many} of "
        f"{len(levels)} levels (most: {lost[worst]} of {counts.runs[worst]} at {levels[worst]}); "
        "they count neither as collapse nor as survival, and the curve may be off by more than "
        "its band"
    )


def scaled_far(cube: xr.Dataset, levels: Sequence[str]) -> str:
    """Sentence on motions that are scaled too far; empty if there is none.

    Parameters
    ----------
    cube : xarray.Dataset
    levels : sequence of str, (n_level,)
        With their unit.
    """
    factors: NDArray[np.float64] = cube["scale_factor"].transpose("record", "level").values
    far = int(np.count_nonzero((factors > MOST_SCALING).any(axis=1)))
    if not far:
        return ""
    record, level = map(int, np.unravel_index(int(np.nanargmax(factors)), factors.shape))
    return (
        f"{far} of {len(factors)} motions are scaled by more than {MOST_SCALING:g} (most: "
        f"{cube['record'].values[record]!s} by {factors[record, level]:.3g} at {levels[level]}), "
        "which makes weak motions into strong ones of another kind"
    )


def accepted_records(cube: xr.Dataset) -> str:
    """Sentence on records that the study accepts against a doubt; empty if there is none."""
    if "accepted" not in cube:
        return ""
    named = [
        f"{record!s} ({doubt})"
        for record, doubt in zip(cube["record"].values, cube["accepted"].values.astype(str))
        if doubt
    ]
    return f"accepted although something is odd about them: {', '.join(named)}" if named else ""
