"""Which records are of one earthquake, by names, files, origin times and starts."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from archfrag.motions.motion import Motion
from archfrag.motions.partners import seconds
from archfrag.motions.process import REVERSED

APART = 60.0  # [s] between origin times, or starts of records, of one earthquake


def recording_of(motion: Motion) -> dict[str, Any]:
    """Facts by which records of one earthquake are recognised, see `earthquakes`."""
    about = motion.metadata
    start = seconds(about.get("start_time"))
    keys = ("file_sha256", "source_sha256", "pair")
    return {
        "id": motion.id.removesuffix(REVERSED),
        "event": str(about.get("event") or about.get("event_id") or ""),
        "origin": seconds(about.get("origin_time")), "start": start,
        "end": start + motion.duration, "files": [about[key] for key in keys if about.get(key)],
    }  # fmt: skip


def earthquakes(records: Sequence[dict[str, Any]]) -> list[str]:
    """Names of the earthquakes of records; none where a record is known to share none.

    A name in a header or an index counts first. Without one, records share an earthquake if they
    are of one file (``files`` in common), or if their ``origin`` times or starts are less than a
    minute apart, or if they overlap in time (``start`` and ``end`` [s]).
    """
    group = list(range(len(records)))

    def join(members: Sequence[int]) -> None:
        if len(ends := {group[i] for i in members}) > 1:
            group[:] = [min(ends) if own in ends else own for own in group]

    def names(members: Sequence[int]) -> list[str]:
        return list(dict.fromkeys(records[i]["event"] for i in members if records[i]["event"]))

    by_file: dict[str, list[int]] = {}
    for i, record in enumerate(records):
        for file in record["files"]:
            by_file.setdefault(file, []).append(i)
    for members in by_file.values():
        join(members)
    for first, last in (("origin", "origin"), ("start", "end")):
        known = [i for i, record in enumerate(records) if not np.isnan(record[first])]
        end = -np.inf
        clusters = list[list[int]]()
        for i in sorted(known, key=lambda i: records[i][first]):
            if records[i][first] > end:
                clusters.append([])
            clusters[-1].append(i)
            end = max(end, records[i][last], records[i][first] + APART)
        for members in clusters:
            if len(names(members)) < 2:  # else the times are not those of earthquakes
                join(members)
    together: dict[int, list[int]] = {}
    for i, own in enumerate(group):
        together.setdefault(own, []).append(i)
    found = [record["event"] for record in records]
    for members in together.values():
        first = f"earthquake of {records[members[0]]['id']}" if len(members) > 1 else ""
        name = next(iter(names(members)), first)
        for i in members:
            found[i] = found[i] or name
    return found
