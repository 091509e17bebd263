"""Curves from verdicts of other programs and of experiments."""

from collections.abc import Mapping, Sequence
from typing import Any

from archfrag.api.results import PathLike, Results
from archfrag.study.answer.fits import fit_runs
from archfrag.study.answer.outside import read_runs


def fit(
    table: Any,
    columns: Mapping[str, str] | None = None,
    measure: str | None = None,
    unit: str | None = None,
    states: Sequence[str] = (),
    confidence: float = 0.9,
    output: PathLike | None = None,
) -> Results:
    """Fit fragility curves to verdicts of any program or experiment, as a study's are fitted.

    Parameters
    ----------
    table : path, DataFrame, or what makes one
        A row for each run, with columns record, event, intensity and verdict (collapsed or
        survived, 1 or 0; unfinished or failed if it shows neither); or for each record, with
        lower and upper: the highest level that stood and the lowest that collapsed, one of which
        may be empty. Without a column record, each row has a motion of its own. Runs of several
        structures have a column arch.
    columns : dict, optional
        Names of columns by what they hold, such as ``{"intensity": "PGA", "verdict": "fell"}``.
    measure, unit : str, optional
        Of the intensity, if the name of its column does not state them as ``PGA [g]`` does.
    states : sequence of str
        Damage states in order, from none to collapse, of a column damage state.
    confidence : float
        Of all bands and intervals.
    output : path, optional
        Folder for the report; results/NAME of the table if not given.

    Raises
    ------
    InputError
        If a row cannot be used; it names row, column, value and what is allowed.

    Examples
    --------
    >>> import archfrag as af
    >>> fell = [0, 0, 1, 0, 1, 1, 0, 1]
    >>> tests = {"PGA [g]": [0.1, 0.2, 0.25, 0.3, 0.35, 0.5, 0.28, 0.6], "verdict": fell}
    >>> af.fit(tests).curve
    <Curve structure: median 0.292 g PGA (90 %: 0.190–0.436), dispersion 0.37 (0.14–1.14)>
    """
    study, cube = read_runs(table, columns, measure, unit, states, confidence, output)
    return Results(study, fit_runs(study, cube))
