"""Motions for Python, read from patterns of files as a study reads them."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, SupportsIndex, overload

import pandas as pd

from archfrag.errors import InputError
from archfrag.motions.index import INDEX_NAME
from archfrag.motions.motion import STANDARD_GRAVITY, Motion
from archfrag.study.file.motions import Motions
from archfrag.study.file.records import read_sources
from archfrag.study.keys import at

if TYPE_CHECKING:
    from archfrag.motions.formats.columns import Columns

_MOST_ROWS = 20
_MEASURE = "PGA"  # a measure that needs one component


class MotionList(list[Motion]):
    """Motions in a list that shows itself as a table.

    Attributes
    ----------
    asked : Motions or None
        How a study file asks for them; None if the list was made of motions, or changed.
    """

    def __init__(self, motions: Iterable[Motion] = (), asked: Motions | None = None) -> None:
        super().__init__(motions)
        self._read = asked, tuple(self)

    @overload
    def __getitem__(self, place: SupportsIndex) -> Motion: ...
    @overload
    def __getitem__(self, place: slice) -> MotionList: ...
    @overload
    def __getitem__(self, place: str) -> Motion: ...
    def __getitem__(self, place: SupportsIndex | slice | str) -> Motion | MotionList:
        """Motion by its place or id (else KeyError), or several by a slice."""
        if isinstance(place, str):
            return {motion.id: motion for motion in self}[place]
        found = super().__getitem__(place)
        return MotionList(found) if isinstance(found, list) else found

    @property
    def asked(self) -> Motions | None:
        asked, motions = self._read
        return asked if list(map(id, self)) == list(map(id, motions)) else None

    @property
    def table(self) -> pd.DataFrame:
        """A row for each motion: id, PGA [g], duration and time step [s], and what is known."""
        rows = [
            {
                "id": motion.id, "PGA [g]": round(motion.pga / STANDARD_GRAVITY, 4),
                "duration [s]": round(motion.duration, 4), "dt [s]": motion.dt,
                "vertical": "yes" if motion.vertical is not None else "",
                "event": about.get("event") or about.get("event_id") or "",
                "M": about.get("Mw") or about.get("magnitude") or "",
                "distance [km]": about.get("distance_km") or "", "station": about.get("station"),
            }
            for motion in self
            for about in (motion.metadata,)
        ]  # fmt: skip
        found = pd.DataFrame(rows)
        return found[[name for name in found if found[name].astype(str).ne("").any()]]

    def __repr__(self) -> str:
        return self.table.to_string(max_rows=_MOST_ROWS) if self else "no motions"

    def _repr_html_(self) -> str:
        return self.table.to_html(max_rows=_MOST_ROWS) if self else "no motions"


def read_motions(
    *paths: str | Path, vertical: bool = False, unit: str | None = None,
    select: Sequence[str] | None = None, processing: Sequence[Any] = (),
    columns: Columns | str | None = None, accept: Sequence[str] = (),
) -> MotionList:  # fmt: skip
    """Read every horizontal component of record files, as a study does.

    Parameters
    ----------
    *paths : str or Path
        Files, folders, or patterns with * and ?, in any format of `read_motion`. At most one may
        be an `index.csv` of records, or a folder that has one.
    vertical : bool
        Whether each motion gets its vertical, from the same file or from one whose name differs
        in the direction only. Without it verticals are left out.
    unit, columns, accept
        As of `read_motion`, for all files.
    select : sequence of str, optional
        Ids of the motions to keep, in this order.
    processing : sequence
        Steps as in a study file: names, or mappings such as {"bandpass": {"lowest": 0.1}}.

    Raises
    ------
    RecordError
        With the file and what is wrong with it, such as a vertical that is missing.
    InputError
        If a pattern matches no file, or an option cannot be used.

    Examples
    --------
    >>> from pathlib import Path
    >>> import archfrag as af
    >>> lines = ["PEER", "Event, 1/1/1999, Station, 90", "ACCELERATION IN UNITS OF G"]
    >>> lines += ["NPTS=  4, DT=  .0100 SEC", " .1E+00 -.2E+00 .1E+00 .0E+00"]
    >>> for name in ("A090.AT2", "A180.AT2"):
    ...     _ = Path(name).write_text("\\n".join(lines) + "\\n")
    >>> af.read_motions("A*.AT2")
         id  PGA [g]  duration [s]  dt [s]  event  station
    0  A090      0.2          0.03    0.01  Event  Station
    1  A180      0.2          0.03    0.01  Event  Station
    """
    given: dict[str, Any] = {"vertical": vertical, "processing": list(processing)}
    named = [os.fspath(path) for path in paths]
    indices = [path for path in named if os.path.isfile(os.path.join(path, INDEX_NAME))
               or os.path.basename(path) == INDEX_NAME]  # fmt: skip
    if indices[1:]:
        raise InputError(f"read_motions: {' and '.join(indices)}: at most one index is allowed")
    named = [os.path.join(path, "*") if os.path.isdir(path) else path
             for path in named if path not in indices]  # fmt: skip
    options = {"unit": unit, "columns": columns and str(columns), "accept": list(accept)}
    given["files"] = [{"path": path} | options for path in named]
    if indices:
        given["index"] = indices[0]
    if select is not None:
        given["select"] = list(select)
    with at("read_motions", given):
        asked = Motions.model_validate(given, context={"folder": Path.cwd()})
    motions = list(read_sources(asked, _MEASURE))
    if select is not None:
        motions.sort(key=lambda motion: given["select"].index(motion.id))
    return MotionList(motions, asked)
