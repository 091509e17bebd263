"""Records selected from a flatfile so that their spectra are distributed as a target's."""

import os
import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from archfrag.errors import InputError, RecordError
from archfrag.files import write_csv
from archfrag.motions.selection.match import Limits, best_set, factors, simulate
from archfrag.motions.selection.models import Array
from archfrag.motions.selection.target import Target, column_of, name_of, numbers

LARGE_SCALE = 4.0  # a factor that is a caution even where the limit allows it
TRUTH = {"true": True, "false": False, "1": True, "0": False, "1.0": True, "0.0": False}
_SPECTRAL = re.compile(r"T(\d+(?:\.\d+)?)S")
_SAME = 1e-6  # difference of ln T of periods that are the same
_WIDEST = 2.0  # ratio of neighbouring periods between which ln Sa is interpolated
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

    `table` has rows of the flatfile in the order of their ids, with the factor in column
    ``scale``; `ln_sa` (count, n_period) is ln Sa [g] of the records times their factors at the
    target's periods; `candidates` is how many records could have been selected.
    """

    table: pd.DataFrame
    target: Target
    ln_sa: Array
    seed: int
    candidates: int

    @property
    def median(self) -> Array:
        """exp of the mean of ln Sa of the records, shape (n_period,) [g]."""
        return np.exp(self.ln_sa.mean(axis=0))

    @property
    def sd(self) -> Array:
        """Standard deviation of ln Sa of the records (n - 1), shape (n_period,)."""
        if len(self.ln_sa) < 2:
            return np.full(self.target.periods.size, np.nan)
        return self.ln_sa.std(axis=0, ddof=1)

    @property
    def errors(self) -> tuple[Array, Array]:
        """Median and sd over those of the target, less 1; nan where the target's sd is 0."""
        sd = np.where(self.target.sd > 0.0, self.target.sd, np.nan)
        return self.median / self.target.median - 1.0, self.sd / sd - 1.0

    @property
    def cautions(self) -> tuple[str, ...]:
        """What users of the selection should know."""
        found, given = list(self.target.notes), self.target.conditioning
        count = len(self.table)
        if given is not None and (np.abs(np.log(_columns(self.table)[0] / given)) >= _SAME).all():
            found.append(
                f"Sa({given:g}) of the records is interpolated, which makes their scatter at "
                "periods near it too small; measure them at that period"
            )
        scale = self.table.set_index("record")["scale"].astype(float)
        large = scale.where(scale >= 1.0, 1.0 / scale)
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
        that of the file. `folder` is what the column ``file`` of the flatfile is relative to.
        RecordError if there is no such column, OutputError if the file cannot be written.
        """
        place = Path(os.path.realpath(path))
        column_of(self.table, "file")
        rows = pd.DataFrame({
            new: self.table[old] for old, new in _INDEX.items() if old in self.table
        })  # fmt: skip
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

    `table` is a flatfile with columns ``record``, ``T0.100S`` (Sa in g at that period) and so on,
    and ``event`` and ``station`` as far as known. With a conditioning period every record is
    scaled to Sa there, without one each by the least-squares factor to the drawn spectrum, or to
    a target that is a mean only; no factor is above `max_scale` or below its inverse. At most
    `per_event` records are of one event. The same table, whatever the order of its rows, and the
    same seed give the same set. RecordError if the flatfile lacks a column or period, or fewer
    records than wanted may be selected, InputError for another argument.
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
) -> tuple[pd.DataFrame, Array, Limits]:
    """Records that may be selected, their ln Sa, and which of them may be together."""
    ids = column_of(table, "record").astype(str)
    if table.empty:
        raise RecordError(f"{name_of(table)}: has no record")
    if ids.duplicated().any():
        twice = ids[ids.duplicated()].iloc[0]
        raise RecordError(f"{name_of(table)}: record {twice!r} is there twice")
    records = table.iloc[np.argsort(ids.to_numpy(dtype=str))].reset_index(drop=True)
    ln_sa = _spectra(records, target.periods)
    usable = np.isfinite(ln_sa).all(axis=1)
    story = f"of {len(records)} candidates {usable.sum()} have Sa at all periods of the target"
    limit = float(np.log(max_scale))
    if target.given is not None:
        # Rounding must not put a record that needs no factor beyond a limit of 1.
        usable &= np.abs(factors(ln_sa, target, target.ln_mean, limit)) <= limit + 1e-12
        story += f", {usable.sum()} of them a factor from 1/{max_scale:g} to {max_scale:g}"
    records, ln_sa = records.iloc[np.flatnonzero(usable)].reset_index(drop=True), ln_sa[usable]
    recording = _groups(records, ["event", "station"])
    rules, most = [(recording, 1)], len(set(recording))
    story += f"; {most} are different recordings"
    if per_event is not None:
        column_of(records, "event")
        event = _groups(records, ["event"])
        rules.append((event, per_event))
        of_event = Counter(dict(set(zip(recording, event))).values())
        most = sum(min(number, per_event) for number in of_event.values())
        story += f", {most} with at most {per_event} of one event"
    if most < count:
        raise RecordError(
            f"{name_of(table)}: {count} records are wanted and {most} may be selected; {story}"
        )
    return records, ln_sa, Limits(limit, tuple(rules))


def _columns(table: pd.DataFrame) -> tuple[Array, list[str]]:
    """Rising periods [s] and the names of their columns of Sa."""
    names = [str(column) for column in table.columns]
    found = sorted((float(m[1]), name) for name in names if (m := _SPECTRAL.fullmatch(name)))
    return np.array([period for period, _ in found]), [name for _, name in found]


def _spectra(table: pd.DataFrame, periods: ArrayLike) -> Array:
    """ln Sa [g] of the records of a flatfile, shape (n_record, n_period).

    Linear in ln T between columns ``T0.100S`` (g) that are at most a factor 2 apart; nan where a
    value is missing or not positive (-999 in NGA flatfiles).
    """
    have, names = _columns(table)
    if not names:
        raise RecordError(f"{name_of(table)}: has no column of Sa, such as T0.100S in g")
    wanted = np.atleast_1d(np.asarray(periods, dtype=np.float64))
    outside = wanted[(wanted < have[0] * (1.0 - 1e-6)) | (wanted > have[-1] * (1.0 + 1e-6))]
    if outside.size:
        given = f"has Sa from {have[0]:g} to {have[-1]:g} s"
        raise RecordError(f"{name_of(table)}: {given}, the target asks for {outside[0]:g} s")
    place = np.interp(np.log(wanted), np.log(have), np.arange(have.size))
    near, before = np.rint(place).astype(int), np.maximum(np.ceil(place).astype(int) - 1, 0)
    same, after = np.abs(np.log(have[near] / wanted)) < _SAME, np.ceil(place).astype(int)
    apart = ~same & (have[after] / have[before] > _WIDEST * (1.0 + 1e-6))
    if apart.any():
        first = int(apart.argmax())
        raise RecordError(
            f"{name_of(table)}: has no Sa between {have[before[first]]:g} and "
            f"{have[after[first]]:g} s, too far apart to interpolate the target's "
            f"{wanted[first]:g} s"
        )
    ln_sa = np.column_stack([numbers(table, name) for name in names])
    with np.errstate(invalid="ignore", divide="ignore"):
        ln_sa = np.log(np.where(ln_sa > 0.0, ln_sa, np.nan))
    part = place - before
    between = (1.0 - part) * ln_sa[:, before] + part * ln_sa[:, after]
    return np.where(same, ln_sa[:, near], between)


def _groups(table: pd.DataFrame, columns: list[str]) -> NDArray[np.int64]:
    """A number for each row, the same where all these columns agree; one alone if any is empty."""
    known = table.reindex(columns=columns).astype("string").fillna("")
    full = (known.apply(lambda column: column.str.strip()) != "").all(axis=1).to_numpy(bool)
    same = known.groupby(columns, sort=False).ngroup()
    return np.unique(np.where(full, same, -1 - np.arange(len(table))), return_inverse=True)[1]
