"""Flatfiles, and the selection of records.

A flatfile is one table of the measures of many records, with columns named as in those of NGA.
Records are selected so that their spectra are distributed as a target's. Spectral accelerations
are in g here, as in flatfiles and ground-motion models.
"""

import csv
import io
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from archfrag.errors import InputError, RecordError, reason_of
from archfrag.files import (
    Named,
    number,
    parse_table,
    read_text,
    relative_path,
    stated_unit,
    unquoted,
    write_csv,
)
from archfrag.motions.channel import STANDARD_GRAVITY, Samples
from archfrag.motions.index import COLUMNS, load_index
from archfrag.motions.measures import measure
from archfrag.motions.motion import Motion
from archfrag.motions.target import Target, spectrum_target

LARGEST_TABLE = 200_000_000  # [bytes]
_FIXED = r"T[0-9.]+S|period_s|Sa_g|sd|scale"  # columns whose name states a unit
_LEADING_ZERO = re.compile(r"[-+]?0[0-9]")  # such as 007, which pandas takes for 7
PERIODS = (
    0.01,
    0.02,
    0.03,
    0.05,
    0.075,
    0.1,
    0.15,
    0.2,
    0.25,
    0.3,
    0.4,
    0.5,
    0.75,
    1.0,
    1.5,
    2.0,
    3.0,
    4.0,
    5.0,
    7.5,
    10.0,
)
# By column: the measure, and the unit of the column in SI. Spectra come after the peaks.
_PEAKS = {
    "PGA_g": ("PGA", STANDARD_GRAVITY),
    "PGV_cms": ("PGV", 0.01),
    "PGD_cm": ("PGD", 0.01),
}
_INTEGRALS = {
    "arias_mps": ("Arias", 1.0),
    "CAV_mps": ("CAV", 1.0),
    "CAVstd_mps": ("CAVstd", 1.0),
    "D5_95_s": ("D5_95", 1.0),
    "HI_cm": ("HI", 0.01),
}
# Columns of facts, by their types.
_FACTS: Named = {
    "file": "string",
    "event": "string",
    "station": "string",
    "magnitude": float,
    "distance_km": float,
    "vs30_mps": float,
    "component": "string",
}
_TYPES = {"record": "string", **_FACTS}
# Number of simulated sets, of 20 and nearest to the target, that are improved; the best is kept.
STARTS = 5
# Columns of an index of records that have other names in a flatfile.
_RENAMED = {"record": "id", "magnitude": "Mw", "vs30_mps": "Vs30_mps"}
Rows = NDArray[np.int64]
# For each rule: the number of the group of each record, and how many records of a group may be
# selected.
Groups = list[tuple[Rows, int]]


def measure_records(
    motions: Iterable[Motion], periods: Sequence[float] = PERIODS
) -> pd.DataFrame:
    """Return a table of the measures of motions, with one row for each.

    Its columns are ``record``, facts, ``scale``, ``dt_s`` and the measures. Sa [g] at each of the
    `periods` [s] is in a column such as ``T0.100S``. InputError if a period has more than three
    decimals.
    """
    for t in periods:
        if round(t, 3) != t:
            raise InputError(f"period {t:g} s must have no more than three decimals")
    spectrum = {f"T{t:.3f}S": (f"Sa({float(t)!r})", STANDARD_GRAVITY) for t in periods}
    columns = _PEAKS | spectrum | _INTEGRALS
    rows = []
    for motion in motions:
        about = motion.metadata
        row: Named = {
            "record": motion.id,
            **{column: about.get(column) for column in _FACTS},
            "distance_km": about.get("distance_km") or about.get("epicentral_km"),
            "scale": about.get("scale", 1.0),
            "dt_s": motion.dt,
        }
        measures = {
            c: measure(motion, name) / unit for c, (name, unit) in columns.items()
        }
        rows.append(row | measures)
    return pd.DataFrame(rows).astype(_TYPES)


def read_flatfile(path: str | Path) -> pd.DataFrame:
    """Read all columns of a flatfile; InputError unless it is CSV with a column ``record``."""
    table = read_table(path, "the flatfile", dtype=_TYPES)
    for name in table.columns[table.dtypes == "string"]:
        table[name] = table[name].map(unquoted, na_action="ignore")
    if "record" not in table:
        raise InputError(
            f"{path}: has no column 'record', by which a flatfile names its records"
        )
    return table


def read_table(path: str | Path, what: str, **form) -> pd.DataFrame:
    """Read a table in CSV by pandas; InputError, which names the file, if that is not possible.

    `what` names the table in messages, `form` are options of pandas.
    """
    text = read_text(Path(path), LARGEST_TABLE, InputError, what)
    try:
        names, rows = parse_table(text, comments=False)
        for head, (name, unit) in zip(names, map(stated_unit, names)):
            if unit is not None and re.fullmatch(_FIXED, name):
                raise InputError(
                    f"column {head!r}: Sa is in g, periods in s and sd of ln Sa; write its name "
                    "without a unit"
                )
        plain = io.StringIO()
        csv.writer(plain).writerows([names, *(cells for _, cells in rows)])
        plain.seek(0)
        table = pd.read_csv(plain, **form)
        for place, kind in enumerate(table.dtypes):
            for _, cells in rows:
                cell = cells[place] if kind.kind in "iuf" and cells[place:] else ""
                if _LEADING_ZERO.match(cell):
                    number(cell)
        return table
    except (InputError, ValueError) as error:
        raise InputError(
            f"{path}: {what} cannot be read as CSV ({reason_of(error)})"
        ) from None


def numbers(table: pd.DataFrame, column: str, source: str) -> Samples:
    """Return a column as numbers, nan in empty cells; RecordError if it is missing or has text."""
    try:
        return pd.to_numeric(table[column]).to_numpy(float)
    except KeyError:
        raise RecordError(f"{source}: column {column!r} is missing") from None
    except ValueError as error:
        raise RecordError(f"{source}: {column}: {error}") from None


def spectrum_columns(table: pd.DataFrame) -> dict[float, str]:
    """Return the columns of Sa in a flatfile by their periods [s]."""
    matches = (
        re.fullmatch(r"T(\d+(?:\.\d+)?)S", str(column)) for column in table.columns
    )
    return {float(match[1]): match[0] for match in matches if match}


def read_targets(path: str | Path) -> dict[float | None, Target]:
    """Read targets from a table with the columns ``period_s``, ``Sa_g`` and, if any, ``sd``.

    `spectrum_target` says what they mean. They are by the level in a column ``level``, above 0; a
    table without it has one target, of the level None.
    """
    targets: dict[float | None, Target] = {}
    for level, spectrum in _spectra(path).items():
        at = "" if level is None else f", level {level:g}"
        if at and not 0.0 < level < np.inf:  # type: ignore[operator]
            raise InputError(f"{path}{at}: a level must be a number above 0")
        periods, median, sd = spectrum
        targets[level] = spectrum_target(periods, median, sd, f"{path}{at}")
    return targets


def _spectra(path: str | Path) -> dict[float | None, Samples]:
    """Read periods [s], median [g] and standard deviation of ln Sa (0 without such a column).

    They are (3, n_period), by the number in the column ``level``; None without it.
    """
    rows = read_table(path, "the target")
    rows["sd"] = rows.get("sd", 0.0)
    names = ("period_s", "Sa_g", "sd")
    spectra = np.array([numbers(rows, name, str(path)) for name in names])
    if "level" not in rows:
        return {None: spectra}
    level = numbers(rows, "level", str(path))
    return {float(one): spectra[:, level == one] for one in np.unique(level)}


@dataclass(frozen=True, eq=False)
class Selection:
    """Selected records with the factors that bring them to the target."""

    table: pd.DataFrame  # rows of the flatfile by id, with the factors as column scale
    target: Target
    ln_sa: Samples  # of the records times their factors, (count, n_period) [ln g]
    seed: int
    candidates: int  # records that could have been selected

    @property
    def sd(self) -> Samples:
        """Return the standard deviation (n - 1) of ln Sa, (n_period,); nan for a single record."""
        return _deviation(self.ln_sa, np.nan * self.ln_sa[0])

    @property
    def cautions(self) -> tuple[str, ...]:
        """Return what users of the selection should know."""
        count = len(self.table)
        events = self.table.get("event", pd.Series(dtype=str)).fillna("").astype(str)
        most = events[events.str.strip() != ""].value_counts()
        messages = self.target.messages
        if most.max() > max(0.25 * count, 1):
            messages += (
                f"{most.max()} of {count} records are of one event ({most.idxmax()}); "
                "`per_event` limits them",
            )
        return messages

    def facts(self) -> Named:
        """Return records, factors, target and differences from it as plain values.

        ``median_error`` and ``sd_error`` are the ratio to the target's, less 1. At periods where
        the target's sd is 0, ``sd_error`` is None.
        """
        target = self.target
        median = np.exp(self.ln_sa.mean(axis=0)) / target.median
        sd = self.sd / np.where(target.sd > 0.0, target.sd, np.nan)
        errors = [
            [None if np.isnan(e) else float(e) for e in ratio - 1.0]
            for ratio in (median, sd)
        ]
        return {
            "records": self.table["record"].astype(str).tolist(),
            "scale": self.table["scale"].tolist(),
            "seed": self.seed,
            "candidates": self.candidates,
            "conditioning_s": target.conditioning,
            "period_s": target.periods.tolist(),
            "target_median_g": target.median.tolist(),
            "target_sd": target.sd.tolist(),
            "median_error": errors[0],
            "sd_error": errors[1],
            "cautions": list(self.cautions),
        }

    def write(self, path: str | Path, folder: str | Path = ".") -> None:
        """Write the records as an index that a study reads (``motions: index: PATH``).

        A study does not apply the column ``scale``, the factor for the target: it scales each
        record to its own levels, by the same factor if a level is Sa(T*) of a conditional
        spectrum. `folder` is what the column ``file`` of the flatfile is relative to. The target
        is written beside the index (`target_file`), for the report of the study.
        """
        write_selected({None: self}, path, folder)

    def index_rows(self, place: Path, folder: str | Path) -> pd.DataFrame:
        """Return the rows of an index at `place`; `folder` is as of `write`."""
        if "file" not in self.table:
            raise RecordError("the flatfile: column 'file' is missing")
        columns = [*COLUMNS, "station", "accept", "columns"]
        rows = self.table.rename(columns=_RENAMED).filter(items=columns)
        files = [os.path.realpath(Path(folder, str(name))) for name in rows["file"]]
        rows["file"] = [relative_path(file, place.parent) for file in files]
        rows["unit"] = rows.get("unit", "")
        rows["scale"] = [f"{factor:.9g}" for factor in self.table["scale"]]
        target = self.target
        kind = "spectrum" if target.sd.any() else "mean spectrum"
        if target.given is not None:
            level = target.median[target.given]
            kind = f"Sa({target.conditioning:g}) = {level:.6g} g"
        rows["selection"] = f"seed {self.seed}, {kind}"
        return rows


def write_selected(
    selected: Mapping[float | None, Selection],
    path: str | Path,
    folder: str | Path = ".",
) -> None:
    """Write the records selected for each level as one index, as `Selection.write` does.

    A record may be there at several levels, which the column ``level`` of index and target has. A
    study runs each record at its levels alone. The level None has no such column.
    """
    place = Path(os.path.realpath(path))
    tables: list[list[pd.DataFrame]] = [[], []]
    for level, chosen in selected.items():
        target = chosen.target
        shown = {"period_s": target.periods, "Sa_g": target.median, "sd": target.sd}
        own = {} if level is None else {"level": f"{level:.12g}"}
        parts = chosen.index_rows(place, folder), pd.DataFrame(shown)
        for table, part in zip(tables, parts):
            table.append(part.assign(**own))
    write_csv(place, [pd.concat(tables[0])])
    write_csv(target_file(place), [pd.concat(tables[1])], float_format="%.6g")


def target_file(index: str | Path) -> Path:
    """Return the path of the target beside an index of selected records: NAME.target.csv."""
    return Path(index).with_suffix(".target.csv")


def target_of_index(
    index: str | Path | None,
) -> tuple[Samples, dict[str, float]] | None:
    """Return the target that the records of an index were selected for, and their factors.

    The target has the rows periods [s], median [g] and standard deviation of ln Sa, (3, n_period).
    The factors bring the records to it, by their ids. None if the index has no target, or one for
    each level.
    """
    if index is None or not target_file(index).is_file():
        return None
    target = _spectra(target_file(index)).get(None)
    rows = load_index(index)
    factors = {row.id: float(row.metadata.get("scale") or np.nan) for row in rows}
    return None if target is None else (target, factors)


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

    Spectra are drawn from the target, the nearest record is matched to each, and then one record
    after the other is replaced by whichever brings mean and standard deviation of the set nearest
    to the target's: Jayaram, Lin and Baker (2011), Earthquake Spectra 27(3), 797-815; Baker and
    Lee (2018), J. Earthquake Eng., doi 10.1080/13632469.2016.1264334. No two components of one
    recording (same event and station) are selected.

    If the target has a conditioning period, every record is scaled to Sa at this period. If not,
    each is scaled to its drawn spectrum by least squares. No factor is above `max_scale` or below
    its inverse. Equal tables, whatever the order of their rows, and equal seeds give the same set.
    RecordError if a column or period is missing or too few records may be selected, InputError if
    an argument is out of range.
    """
    limits = {
        "count": count,
        "max_scale": max_scale,
        "per_event": per_event,
        "seed + 1": seed + 1,
    }
    for name, value in limits.items():
        if value is not None and not value >= 1:
            raise InputError(f"{name} = {value} must be at least 1")
    for column in ("record",) if per_event is None else ("record", "event"):
        if column not in table:
            raise RecordError(f"the flatfile: column {column!r} is missing")
    limit = np.log(max_scale)
    records, ln_sa, groups = _candidates(table, target, count, limit, per_event)

    values, vectors = np.linalg.eigh(target.covariance)
    # Published correlations are not quite positive definite. The symmetric root does not hang on
    # the signs of eigenvectors, which differ between machines.
    root = (vectors * np.sqrt(np.clip(values, 0.0, None))) @ vectors.T
    normal = np.random.default_rng(seed).standard_normal((20, count, values.size))
    drawn = target.ln_mean + normal @ root
    sd = drawn.std(axis=1, ddof=1) if count > 1 else np.zeros_like(drawn[:, 0])
    sets = []
    order = np.argsort(_error(target, drawn.mean(axis=1), sd))
    for spectra in drawn[order[:STARTS]]:
        chosen = np.empty(0, dtype=np.int64)
        # By place in the set and record.
        factors = np.array([_factors(ln_sa, target, row, limit) for row in spectra])
        for spectrum, own in zip(spectra, factors):
            apart = ((ln_sa + own[:, None] - spectrum) ** 2).sum(axis=1)
            apart[_excluded(groups, chosen)] = np.inf
            chosen = np.append(chosen, int(apart.argmin()))
        _improve(chosen, ln_sa, factors, target, groups)
        factors = factors[np.arange(count), chosen]
        held = ln_sa[chosen] + factors[:, None]
        error = _error(target, held.mean(axis=0), _deviation(held, target.sd))
        sets.append((error, chosen, factors, held))
    _, chosen, factors, held = min(sets, key=lambda improved: improved[0])
    order = np.argsort(chosen)
    selected = records.iloc[chosen[order]].reset_index(drop=True)
    selected["scale"] = np.exp(factors[order])
    return Selection(selected, target, held[order], seed, len(records))


def _deviation(ln_sa: Samples, of_one: Samples) -> Samples:
    """Return the standard deviation (n - 1) of ln Sa over records, (n_period,).

    It is `of_one` if there is one record only.
    """
    return ln_sa.std(axis=0, ddof=1) if len(ln_sa) > 1 else of_one


def _error(target: Target, mean: Samples, sd: Samples) -> Samples:
    """Return weighted squared errors of mean and sd of ln Sa, summed over periods."""
    # The scatter about a mean only is kept small.
    weight = 2.0 if target.sd.any() else 0.1
    errors = (mean - target.ln_mean) ** 2, (sd - target.sd) ** 2
    return errors[0].sum(-1) + weight * errors[1].sum(-1)


def _factors(
    ln_sa: Samples, target: Target, spectrum: Samples, limit: float
) -> Samples:
    """Return ln of the factors on records, (n_record,).

    If the target has a conditioning period, they bring Sa there to the target's. If not, they
    bring records to a `spectrum` [ln g] by least squares, from -`limit` to `limit`.
    """
    if target.given is not None:
        return target.ln_mean[target.given] - ln_sa[:, target.given]
    return np.clip((spectrum - ln_sa).mean(axis=1), -limit, limit)


def _excluded(groups: Groups, chosen: Rows) -> NDArray[np.bool_]:
    """Tell which records may not join those chosen, shape (n_record,)."""
    return np.any(
        [
            np.bincount(group[chosen], minlength=group.max() + 1)[group] >= most
            for group, most in groups
        ],
        axis=0,
    )


def _improve(
    chosen: Rows, ln_sa: Samples, factors: Samples, target: Target, groups: Groups
) -> None:
    """Replace the `chosen` records in place, one by one, until no other record improves the set.

    The method is that of Jayaram et al. (2011). `factors` are ln of the factors by place in the
    set and record.
    """
    count = len(chosen)
    from_mean = ln_sa - target.ln_mean
    held = from_mean[chosen] + factors[np.arange(count), chosen][:, None]
    for _ in range(50 if count > 1 else 0):
        before = chosen.copy()
        for place, own in enumerate(factors):
            candidates = from_mean + own[:, None]
            others = np.delete(held, place, axis=0)
            mean = (others.sum(axis=0) + candidates) / count
            squares = (others**2).sum(axis=0) + candidates**2
            sd = np.sqrt(np.clip(squares - count * mean**2, 0.0, None) / (count - 1))
            error = _error(target, mean + target.ln_mean, sd)
            error[_excluded(groups, np.delete(chosen, place))] = np.inf
            best = int(error.argmin())
            if error[best] < error[chosen[place]]:
                chosen[place] = best
                held[place] = candidates[best]
        if (chosen == before).all():
            break


def _candidates(
    table: pd.DataFrame, target: Target, count: int, limit: float, per_event: int | None
) -> tuple[pd.DataFrame, Samples, Groups]:
    """Return the records that may be selected, their ln Sa [ln g], and the rules for groups.

    `limit` is ln of the largest factor. RecordError if a column is missing, a record is there
    twice, or fewer than `count` records may be selected.
    """
    ids = table["record"].astype(str)
    twice = ids[ids.duplicated()]
    if twice.size:
        raise RecordError(f"the flatfile: record {twice.iloc[0]!r} is there twice")
    records = table.iloc[np.argsort(ids.to_numpy(dtype=str))].reset_index(drop=True)
    have = spectrum_columns(table)
    columns = []
    for period in target.periods:
        near = min(have, key=lambda measured: abs(measured - period), default=np.inf)
        if abs(near - period) > 2e-3 * period:
            raise RecordError(
                f"the flatfile: no column T{period:.3f}S; measure at that period too"
            )
        columns.append(numbers(records, have[near], "the flatfile"))
    sa = np.column_stack(columns)
    # nan where Sa is missing or not positive (-999).
    ln_sa = np.log(np.where(sa > 0.0, sa, np.nan))
    usable = np.isfinite(ln_sa).all(axis=1)
    story = f"of {len(records)} candidates {usable.sum()} have Sa at all periods of the target"
    if target.given is not None:
        # Rounding must not put a record that needs no factor beyond a limit of 1.
        factors = _factors(ln_sa, target, target.ln_mean, limit)
        usable &= np.abs(factors) <= limit + 1e-12
        story += f", {usable.sum()} of them with a factor within the limit"
    records = records.iloc[np.flatnonzero(usable)].reset_index(drop=True)
    ln_sa = ln_sa[usable]
    recording = _groups(records, ["event", "station"])
    groups = [(recording, 1)]
    most = np.unique(recording).size
    story += f"; {most} are different recordings"
    if per_event is not None:
        event = _groups(records, ["event"])
        groups.append((event, per_event))
        events = np.unique(np.stack([event, recording]), axis=1)[0]
        most = np.bincount(events).clip(max=per_event).sum()
        story += f", {most} with at most {per_event} of one event"
    if most < count:
        raise RecordError(
            f"the flatfile: {count} records were asked for, only {most} can be selected; {story}"
        )
    return records, ln_sa, groups


def _groups(table: pd.DataFrame, columns: list[str]) -> Rows:
    """Return a number for each row, equal if all columns agree; unique if any cell is empty."""
    facts = table.reindex(columns=columns).astype("string")
    facts = facts.replace(r"^\s*$", pd.NA, regex=True)
    same = facts.groupby(columns, sort=False).ngroup()
    alone = np.where(facts.isna().any(axis=1), -1 - np.arange(len(table)), same)
    return np.unique(alone, return_inverse=True)[1]
