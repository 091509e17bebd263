"""Motions for Python, read from patterns of files as a study reads them."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, SupportsIndex, overload

import pandas as pd

from archfrag.errors import InputError
from archfrag.files import Named
from archfrag.motions.channel import STANDARD_GRAVITY
from archfrag.motions.formats.columns import Columns
from archfrag.motions.index import INDEX_NAME
from archfrag.motions.motion import Motion
from archfrag.study.file.motions import Motions
from archfrag.study.file.sources import read_sources
from archfrag.study.keys import at

_MOST_ROWS = 20
_MEASURE = "PGA"  # any measure that needs no second component


class MotionList(list[Motion]):
    """A list of motions that prints as a table.

    Attributes
    ----------
    asked : Motions or None
        The block ``motions`` of a study file that reads them. None if the list was made from
        motions, or has been changed.
    """

    def __init__(
        self, motions: Iterable[Motion] = (), asked: Motions | None = None
    ) -> None:
        super().__init__(motions)
        self._read = asked, tuple(self)

    @overload
    def __getitem__(self, place: SupportsIndex | str) -> Motion: ...
    @overload
    def __getitem__(self, place: slice) -> MotionList: ...
    def __getitem__(self, place: SupportsIndex | slice | str) -> Motion | MotionList:
        """Return the motion at an index or with an id, or the motions of a slice.

        KeyError if no motion has the id.
        """
        if isinstance(place, str):
            return {motion.id: motion for motion in self}[place]
        motions = super().__getitem__(place)
        return MotionList(motions) if isinstance(motions, list) else motions

    @property
    def asked(self) -> Motions | None:
        asked, motions = self._read
        return asked if list(map(id, self)) == list(map(id, motions)) else None

    @property
    def table(self) -> pd.DataFrame:
        """Table with a row for each motion: id, PGA [g], duration and time step [s], and facts.

        A column that is empty for all motions is left out.
        """
        rows = [
            {
                "id": motion.id,
                "PGA [g]": round(motion.pga / STANDARD_GRAVITY, 4),
                "duration [s]": round(motion.duration, 4),
                "dt [s]": motion.dt,
                "vertical": "yes" if motion.vertical is not None else "",
                "event": motion.facts.event,
                "M": motion.facts.magnitude or "",
                "distance [km]": motion.facts.distance_km or "",
                "station": motion.facts.station,
            }
            for motion in self
        ]
        table = pd.DataFrame(rows)
        return table[[name for name in table if table[name].astype(str).ne("").any()]]

    def __repr__(self) -> str:
        return self.table.to_string(max_rows=_MOST_ROWS) if self else "no motions"

    def _repr_html_(self) -> str:
        return self.table.to_html(max_rows=_MOST_ROWS) if self else "no motions"


def read_motions(
    *paths: str | Path,
    vertical: bool = False,
    unit: str | None = None,
    select: Sequence[str] | None = None,
    processing: Sequence[Any] = (),
    columns: Columns | str | None = None,
    accept: Sequence[str] = (),
) -> MotionList:
    """Read every horizontal component of record files, as a study does.

    Parameters
    ----------
    *paths : str or Path
        Files, folders, or patterns with * and ?, in any format of `read_motion`. At most one may
        be an `index.csv` of records, or a folder that has one.
    vertical : bool
        Whether each motion gets its vertical component, from the same file or from one whose name
        differs in the direction only. If false, vertical components are left out.
    unit, columns, accept
        Arguments of `read_motion`, for all files.
    select : sequence of str, optional
        Ids of the motions to keep, in this order.
    processing : sequence
        Steps as in a study file: names, or mappings such as {"bandpass": {"lowest": 0.1}}.

    Raises
    ------
    RecordError
        If a record cannot be used, such as one without its vertical; the message names the file.
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
    options = {
        "unit": unit,
        "columns": columns and str(columns),
        "accept": list(accept),
    }
    keys: Named = {
        "vertical": vertical,
        "processing": list(processing),
        "files": [],
    }
    for path in [os.fspath(each) for each in paths]:
        own = os.path.join(path, INDEX_NAME)
        if os.path.basename(path) == INDEX_NAME or os.path.isfile(own):
            if "index" in keys:
                both = f"{keys['index']} and {path}"
                raise InputError(f"read_motions: {both}: at most one index is allowed")
            keys["index"] = path
        else:
            pattern = os.path.join(path, "*") if os.path.isdir(path) else path
            keys["files"].append({"path": pattern, **options})
    if select is not None:
        keys["select"] = list(select)
    with at("read_motions", keys):
        asked = Motions.model_validate(keys, context={"folder": Path.cwd()})
    motions = list(read_sources(asked, _MEASURE))
    if select:
        motions.sort(key=lambda motion: list(select).index(motion.id))
    return MotionList(motions, asked)
