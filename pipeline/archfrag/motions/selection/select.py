"""Records selected from a flatfile so that their spectra are distributed as a target's."""

import os
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from archfrag.errors import InputError, RecordError
from archfrag.files import write_csv
from archfrag.motions.selection.candidates import (
    column_of,
    groups,
    is_column,
    name_of,
    sorted_candidates,
    spectra,
)
from archfrag.motions.selection.match import Limits, best_set, factors, simulate
from archfrag.motions.selection.target import Target

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LARGE_SCALE = 4.0  # a factor that is a caution even where the limit allows it
# Columns of an index of records by those of a flatfile.
_INDEX = {
    "record": "id", "file": "file", "sha256": "sha256", "event": "event", "magnitude": "Mw",
    "distance_km": "distance_km", "vs30_mps": "Vs30_mps", "component": "component",
    "dt_s": "dt_s", "unit": "unit", "station": "station", "accept": "accept",
    "columns": "columns",
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Selection:
    """Selected records with the factors that bring them to the target.

    Attributes
    ----------
    table : pandas.DataFrame
        Rows of the flatfile in the order of their ids, with the factor in column ``scale``; a
        column of that name in the flatfile is replaced.
    target : Target
    ln_sa : numpy.ndarray, shape (count, n_period)
        ln Sa [g] of the records times their factors, at the target's periods.
    seed : int
    candidates : int
        Records that could have been selected.
    """

    table: pd.DataFrame
    target: Target
    ln_sa: NDArray[np.float64]
    seed: int
    candidates: int

    @property
    def median(self) -> NDArray[np.float64]:
        """exp of the mean of ln Sa of the records, shape (n_period,) [g]."""
        return np.exp(self.ln_sa.mean(axis=0))

    @property
    def sd(self) -> NDArray[np.float64]:
        """Standard deviation of ln Sa of the records (n - 1), shape (n_period,)."""
        if len(self.ln_sa) < 2:
            return np.full(self.target.periods.size, np.nan)
        return self.ln_sa.std(axis=0, ddof=1)

    @property
    def errors(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Median and sd over those of the target, less 1; nan where the target's sd is 0."""
        sd = np.where(self.target.sd > 0.0, self.target.sd, np.nan)
        return self.median / self.target.median - 1.0, self.sd / sd - 1.0

    @property
    def cautions(self) -> tuple[str, ...]:
        """What whoever uses the selection should know."""
        found, given = list(self.target.notes), self.target.conditioning
        count = len(self.table)
        if given is not None and not is_column(self.table, given):
            found.append(
                f"Sa({given:g}) of the records is interpolated, which makes their scatter at "
                "periods near it too small; measure them at that period"
            )
        factors = self.table.set_index("record")["scale"].astype(float)
        large = factors.where(factors >= 1.0, 1.0 / factors)
        if (large > LARGE_SCALE).any():
            found.append(
                f"{(large > LARGE_SCALE).sum()} of {count} records are scaled by more than "
                f"{LARGE_SCALE:g} or less than 1/{LARGE_SCALE:g}, up to a factor of "
                f"{large.max():.3g} ({large.idxmax()})"
            )
        events = self.table.get("event", pd.Series(dtype=str)).dropna().astype(str)
        most = events[events.str.strip() != ""].value_counts()
        if most.max() > max(0.25 * count, 1):
            found.append(
                f"{most.max()} of {count} records are of one event ({most.idxmax()}); "
                "`per_event` limits them"
            )
        return tuple(found)

    def facts(self) -> dict[str, Any]:
        """What a command prints as JSON: records, factors, target and differences from it."""
        mean, sd = ([None if np.isnan(e) else float(e) for e in each] for each in self.errors)
        target = self.target
        return {
            "records": self.table["record"].astype(str).tolist(),
            "scale": self.table["scale"].tolist(), "seed": self.seed,
            "candidates": self.candidates, "conditioning_s": target.conditioning,
            "period_s": target.periods.tolist(), "target_median_g": target.median.tolist(),
            "target_sd": target.sd.tolist(), "median_error": mean, "sd_error": sd,
            "cautions": list(self.cautions),
        }  # fmt: skip

    def write(self, path: str | Path, folder: str | Path = ".") -> None:
        """Write the records as an index that a study reads (``motions: index: PATH``).

        Columns are those of an index of records and ``scale``. A study scales each record to
        its own levels and does not apply ``scale``, which is the factor for the target: both
        are equal where the level is Sa(T*) of a conditional spectrum. An empty ``unit`` is
        that of the file.

        Parameters
        ----------
        path : path
            Replaced at once.
        folder : path
            What the column ``file`` of the flatfile is relative to.

        Raises
        ------
        RecordError
            If the flatfile has no column ``file``.
        OutputError
            If the file cannot be written.
        """
        place = Path(os.path.realpath(path))
        column_of(self.table, "file")
        columns = {new: self.table[old] for old, new in _INDEX.items() if old in self.table}
        rows = pd.DataFrame(columns)
        files = [os.path.realpath(Path(folder, str(name))) for name in rows["file"]]
        rows["file"] = [os.path.relpath(file, place.parent) for file in files]
        if "unit" not in rows:
            rows["unit"] = ""
        rows["scale"] = [f"{factor:.9g}" for factor in self.table["scale"]]
        kind = "spectrum" if self.target.sd.any() else "mean spectrum"
        if (given := self.target.given) is not None:
            kind = f"Sa({self.target.conditioning:g}) = {self.target.median[given]:.6g} g"
        rows["selection"] = f"seed {self.seed}, {kind}"
        write_csv(place, [rows])

    def figure(self) -> "Figure":
        """Spectra of target and selection with means and 2.5 and 97.5 percentiles; their sd."""
        from archfrag.motions.selection.figure import draw

        return draw(self)


def select_records(
    table: pd.DataFrame,
    target: Target,
    count: int,
    seed: int,
    *,
    max_scale: float = 4.0,
    per_event: int | None = None,
) -> Selection:
    """Select records whose scaled spectra are distributed as the target's.

    Spectra are drawn from the target, the nearest record is matched to each, and then one
    record after the other is replaced by whichever brings mean and standard deviation of the
    set nearest to the target's: Jayaram, Lin and Baker (2011), Earthquake Spectra 27(3),
    797-815; Baker and Lee (2018), J. Earthquake Eng., doi 10.1080/13632469.2016.1264334. No two
    components of one recording (same event and station) are selected.

    Parameters
    ----------
    table : pandas.DataFrame
        Flatfile: columns ``record`` and ``T0.100S`` (Sa in g at that period) and so on;
        ``event`` and ``station`` as far as known. `screen` it first by magnitude and the like.
    target : Target
        See `conditional_spectrum`, `spectrum_target` and `read_target`. With a conditioning
        period every record is scaled to Sa there; without one each by the least-squares factor
        to the drawn spectrum, which for a target that is a mean only is the target.
    count : int
        How many records.
    seed : int
        The same table, whatever the order of its rows, and the same seed give the same set.
    max_scale : float
        No factor is above it or below its inverse.
    per_event : int, optional
        Most records of one event.

    Returns
    -------
    Selection

    Raises
    ------
    RecordError
        If the flatfile lacks a column or period, or fewer records than wanted may be selected,
        with what each condition leaves.
    InputError
        If another argument cannot be used.

    Examples
    --------
    >>> import numpy as np, pandas as pd
    >>> from archfrag.motions.selection import select_records, spectrum_target
    >>> rng = np.random.default_rng(1)
    >>> flatfile = pd.DataFrame({
    ...     "record": [f"r{i:03d}" for i in range(200)],
    ...     "T0.200S": 0.5 * np.exp(0.6 * rng.standard_normal(200)),
    ...     "T1.000S": 0.2 * np.exp(0.6 * rng.standard_normal(200)),
    ... })
    >>> target = spectrum_target([0.2, 1.0], [0.6, 0.2], [0.5, 0.6])
    >>> selected = select_records(flatfile, target, count=20, seed=1)
    >>> selected.median.round(1), selected.sd.round(1)
    (array([0.6, 0.2]), array([0.5, 0.6]))
    """
    for name, value, least in (
        ("count", count, 1), ("seed", seed, 0), ("max_scale", max_scale, 1),
        ("per_event", 1 if per_event is None else per_event, 1),
    ):  # fmt: skip
        if not value >= least:
            raise InputError(f"{name} = {value} must be at least {least}")
    records, ln_sa, limits = _candidates(table, target, count, max_scale, per_event)
    start = simulate(target, count, np.random.default_rng(seed))
    chosen, ln_factor = best_set(ln_sa, target, start, limits)
    order = np.argsort(chosen)
    selected = records.iloc[chosen[order]].reset_index(drop=True)
    selected["scale"] = np.exp(ln_factor[order])
    scaled = (ln_sa[chosen] + ln_factor[:, None])[order]
    return Selection(selected, target, scaled, seed, len(records))


def _candidates(
    table: pd.DataFrame, target: Target, count: int, max_scale: float, per_event: int | None
) -> tuple[pd.DataFrame, NDArray[np.float64], Limits]:
    """Records that may be selected, their ln Sa, and which of them may be together."""
    records = sorted_candidates(table)
    ln_sa = spectra(records, target.periods)
    usable = np.flatnonzero(np.isfinite(ln_sa).all(axis=1))
    story = f"of {len(records)} candidates {usable.size} have Sa at all periods of the target"
    records, ln_sa = records.iloc[usable].reset_index(drop=True), ln_sa[usable]
    limit = float(np.log(max_scale))
    if target.given is not None:
        # Rounding must not put a record that needs no factor beyond a limit of 1.
        ln_factor = factors(ln_sa, target, target.ln_mean, limit)
        near = np.flatnonzero(np.abs(ln_factor) <= limit + 1e-12)
        records, ln_sa = records.iloc[near].reset_index(drop=True), ln_sa[near]
        story += f", {len(records)} of them a factor from 1/{max_scale:g} to {max_scale:g}"
    recording = groups(records, ("event", "station"))
    rules, most = [(recording, 1)], len(set(recording))
    story += f"; {most} are different recordings"
    if per_event is not None:
        column_of(records, "event")
        event = groups(records, ("event",))
        rules.append((event, per_event))
        of_event = Counter(dict(set(zip(recording, event))).values())
        most = sum(min(number, per_event) for number in of_event.values())
        story += f", {most} with at most {per_event} of one event"
    if most < count:
        raise RecordError(
            f"{name_of(table)}: {count} records are wanted and {most} may be selected; {story}"
        )
    return records, ln_sa, Limits(limit, tuple(rules))
