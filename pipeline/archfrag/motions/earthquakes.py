"""Which records are of one earthquake, by names, files, origin times and starts."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from archfrag.motions.motion import Motion, seconds
from archfrag.motions.process import REVERSED

APART = 60.0  # [s] between origin times, or starts of records, of one earthquake


def recording_of(motion: Motion) -> dict[str, Any]:
    """Return the facts by which `earthquakes` recognises records of one earthquake."""
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
    """Return the names of the earthquakes of records; empty if none is stated or shared.

    A name in a header or an index counts first. Without one, records share an earthquake if they
    are of one file (``files`` in common), or if their ``origin`` times or starts are less than a
    minute apart, or if they overlap in time (``start`` and ``end`` [s]).
    """
    group = np.arange(len(records))

    def join(members: Sequence[int]) -> None:
        if (ends := np.unique(group[members])).size > 1:
            group[np.isin(group, ends)] = ends[0]

    def names(members: Sequence[int]) -> list[str]:
        return list(dict.fromkeys(records[i]["event"] for i in members if records[i]["event"]))

    by_file: dict[str, list[int]] = {}
    for i, record in enumerate(records):
        for file in record["files"]:
            by_file.setdefault(file, []).append(i)
    for members in by_file.values():
        join(members)
    for first, last in (("origin", "origin"), ("start", "end")):
        start, end = (np.array([record[key] for record in records]) for key in (first, last))
        order = np.argsort(start, kind="stable")[: np.count_nonzero(~np.isnan(start))]  # nan last
        ends = np.maximum.accumulate(np.fmax(end[order], start[order] + APART))
        for near in np.split(order, np.flatnonzero(start[order[1:]] > ends[:-1]) + 1):
            if len(names(near.tolist())) < 2:  # else the times are not those of earthquakes
                join(near.tolist())
    together: dict[int, list[int]] = {}
    for i, number in enumerate(group.tolist()):
        together.setdefault(number, []).append(i)
    events = [record["event"] for record in records]
    for members in together.values():
        first = f"earthquake of {records[members[0]]['id']}" if len(members) > 1 else ""
        name = next(iter(names(members)), first)
        for i in members:
            events[i] = events[i] or name
    return events
