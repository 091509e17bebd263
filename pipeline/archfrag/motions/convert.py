"""Records from any format that is read to miniSEED, AT2 or two columns of text.

Text holds all digits of the samples, miniSEED 64-bit numbers and AT2 eight digits. An
``index.csv`` beside the files has their unit, their source with its SHA-256 and the steps.
"""

import os
import re
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from obspy import Stream, Trace

from archfrag.errors import InputError
from archfrag.files import make_folder, replacing, sha256_of
from archfrag.motions.calibrate import Reading, accept_or_refuse, implausible
from archfrag.motions.channels import read_channels
from archfrag.motions.index import index_table, write_index
from archfrag.motions.motion import unit_factor
from archfrag.motions.partners import channel_code, instrument, is_vertical
from archfrag.motions.read import record_name

SUFFIXES = {"mseed": ".mseed", "at2": ".AT2", "text": ".txt"}
UNITS = ("m/s2", "g")
_HEADER = ("date", "magnitude", "epicentral_km", "vs30_mps", "station", "azimuth")


def convert_record(
    path: str | Path, folder: str | Path, form: str = "mseed", unit: str = "m/s2",
    options: Reading | None = None,
) -> list[Path]:  # fmt: skip
    """Write the channels of a record file in another format, and return the files written.

    `form` is ``mseed`` (all channels in a file), ``at2`` or ``text`` (a file each: time [s] and
    acceleration), `unit` ``m/s2`` or ``g``. The source is never replaced, other files of the same
    name are. InputError for another form or unit or if the source would be replaced, RecordError
    if the record cannot be used, OutputError if a file cannot be written.
    """
    for word, value, allowed in (("format", form, SUFFIXES), ("unit", unit, UNITS)):
        if value not in allowed:
            raise InputError(f"{word} {value!r} cannot be written; use {' or '.join(allowed)}")
    file = Path(path)
    channels, _ = read_channels(file, options or Reading())
    for channel in channels:
        accept_or_refuse(file, channel.stats.record.accept, implausible(channel))
    place, digest = make_folder(Path(folder)), sha256_of(file)
    made = f"archfrag {version('archfrag')} from {file.name}, sha256 {digest[:16]}"
    rows: dict[str, dict[str, Any]] = dict(index_table(place))
    written: list[Path] = []
    groups = [channels] if form == "mseed" else [[channel] for channel in channels]
    for group in groups:
        code = _plain(channel_code(group[0])) or len(written) + 1
        middle = "" if len(groups) == 1 else f".{code}"
        target = place / f"{record_name(file)}{middle}{SUFFIXES[form]}"
        if os.path.realpath(target) == os.path.realpath(file) or target in written:
            raise InputError(f"{target}: is the source or written twice; name another folder")
        if rows.get(target.stem, {}).get("source", file.name) != file.name:
            raise InputError(f"{target}: the index has it from elsewhere; name another folder")
        with replacing(target) as part:
            if form == "mseed":
                _write_miniseed(part, group, unit)
            else:
                part.write_text(_text(group[0], form, unit, made), encoding="ascii")
        written.append(target)
        if all(map(is_vertical, group)):
            continue
        first = group[0].stats
        rows[target.stem] = {
            "id": target.stem, "file": target.name, "sha256": sha256_of(target),
            "event": str(first.record.get("event", "")),
            **{key: first.record[key] for key in _HEADER if key in first.record},
            "dt_s": float(first.delta), "unit": unit,
            "channels": " ".join(map(channel_code, group)),
            "source": file.name, "source_sha256": digest,
            "steps": " ".join(first.record.log), "accept": " ".join(first.record.accept),
        }  # fmt: skip
    write_index(place, rows.values())
    return written


def _write_miniseed(part: Path, group: Sequence[Trace], unit: str) -> None:
    factor, stream = unit_factor(unit, str(part)), Stream()
    names = ("network", "station", "location", "channel")
    for codes, channel in zip(_seed_codes(group), group, strict=True):
        data = np.ascontiguousarray(channel.data / factor, dtype=np.float64)
        timing = {key: channel.stats[key] for key in ("delta", "starttime")}
        stream.append(Trace(data, {**dict(zip(names, codes)), **timing}))
    stream.write(str(part), format="MSEED", encoding="FLOAT64", byteorder=">")


def _seed_codes(group: Sequence[Trace]) -> list[tuple[str, str, str, str]]:
    """Network, station, location and channel of each: its own if SEED can hold them, or new."""
    own = []
    for channel in group:
        stats = channel.stats
        names = (_plain(stats.network)[:2] or "XX", _plain(stats.station)[:5])
        own.append((*names, str(stats.location).strip(), channel_code(channel)))
    held = all(re.fullmatch(r"[A-Z0-9]{0,2}:[A-Z0-9]{1,3}", f"{o[2]}:{o[3]}") for o in own)
    if held and len(set(own)) == len(own):
        return own
    horizontals = {instrument(channel): 0 for channel in group}
    instruments, codes = list(horizontals), []
    for (network, station, _, _), channel in zip(own, group, strict=True):
        its, vertical = instrument(channel), is_vertical(channel)
        place = f"{instruments.index(its):02d}" if len(instruments) > 1 else ""
        horizontals[its] += not vertical
        codes.append((network, station, place, "HNZ" if vertical else f"HN{horizontals[its]}"))
    if len(set(codes)) < len(codes) or max(horizontals.values()) > 9 or len(instruments) > 99:
        raise InputError(f"miniSEED has no codes for {len(group)} channels; write at2 or text")
    return codes


def _text(channel: Trace, form: str, unit: str, made: str) -> str:
    """A channel as AT2 or as columns of time and acceleration."""
    stats, record, code = channel.stats, channel.stats.record, channel_code(channel)
    values, dt = channel.data / unit_factor(unit, ""), float(stats.delta)
    event, station = str(record.get("event", "")), str(record.get("station") or stats.station)
    date = record.get("date") or (str(stats.starttime.date) if stats.starttime.timestamp else "")
    if form == "at2":
        date = re.sub(r"(\d{4})-(\d{1,2})-(\d{1,2})", r"\2/\3/\1", str(date), count=1)
        words = [event or "unknown event", date, station or "unknown station", code]
        names = [word.replace(",", " ") for word in words if word]
        header = [
            f"{made}; {' '.join(record.log)}",
            ", ".join(names),
            f"ACCELERATION TIME SERIES IN UNITS OF {unit.upper()}",
            f"NPTS= {values.size:6d}, DT= {dt!r} SEC",
        ]
        starts = range(0, values.size, 5)
        rows = ["".join(f"{v:15.7E}" for v in values[i : i + 5]) for i in starts]
        return "\n".join([*map(_line, header), *rows, ""])
    header = [
        f"two columns: time [s], acceleration [{unit}]",
        made,
        *(f"{name}: {fact}" for name, fact in (("event", event), ("date", date),
                                               ("station", station)) if fact),
        f"component: {code}; dt = {dt!r} s; {values.size} samples",
        *(f"step: {step}" for step in record.log),
    ]  # fmt: skip
    times = (np.arange(values.size) * dt).tolist()
    rows = [f"{t:.10g} {v!r}" for t, v in zip(times, values.tolist(), strict=True)]
    return "\n".join([*(f"# {_line(text)}" for text in header), *rows, ""])


def _line(text: str) -> str:
    """One line of ASCII."""
    plain = " ".join(text.split()).encode("ascii", "backslashreplace").decode()
    return plain if len(plain) <= 1000 else plain[:997] + "..."


def _plain(code: str) -> str:
    return re.sub(r"[^A-Za-z0-9]", "", str(code)).upper()
