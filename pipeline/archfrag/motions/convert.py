"""Records from any format that is read to miniSEED or two columns of text, with all digits.

An ``index.csv`` beside the files has their unit, their source with its SHA-256 and the steps.
"""

import re
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from obspy import Stream, Trace

from archfrag.errors import InputError
from archfrag.files import check_targets, make_folder, replacing, sha256_of
from archfrag.motions.calibrate import accept_or_refuse, implausible
from archfrag.motions.channel import instrument, unit_factor
from archfrag.motions.index import INDEX_NAME, index_table, write_index
from archfrag.motions.read import read_channels, record_name

_HEADER = ("date", "magnitude", "epicentral_km", "vs30_mps", "station", "azimuth")


def convert_record(
    path: str | Path, folder: str | Path, form: str, to: str, **options: Any
) -> list[Path]:
    """Write the channels of a record file in another format; return the files written.

    `form` is ``mseed`` (all channels in a file) or ``text`` (a file each: time [s] and
    acceleration), in the unit `to`; `options` are those of `read_motion`. Files of the same name
    are replaced, but not the source.
    """
    file = Path(path)
    factor = unit_factor(to, str(path))
    channels, _ = read_channels(file, **options)
    for channel in channels:
        accept_or_refuse(file, channel.stats.record.accept, implausible(channel))
    place = make_folder(Path(folder))
    digest = sha256_of(file)
    written = list[Path]()
    rows: dict[str, dict[str, Any]] = dict(index_table(place))
    groups = [channels] if form == "mseed" else [[channel] for channel in channels]
    targets = list[Path]()
    end = "mseed" if form == "mseed" else "txt"
    for number, group in enumerate(groups, start=1):
        code = _plain(group[0].stats.record.code) or number
        middle = "" if len(groups) == 1 else f".{code}"
        targets.append(place / f"{record_name(file)}{middle}.{end}")
        of_another = (
            rows.get(targets[-1].stem, {}).get("source", file.name) != file.name
        )
        if of_another or targets[-1] in targets[:-1]:
            what = "would replace another channel or a record of another file"
            raise InputError(f"{targets[-1]}: {what}; name another folder")
    check_targets([*targets, place / INDEX_NAME], [file])
    for target, group in zip(targets, groups):
        with replacing(target) as part:
            if form == "mseed":
                seed = Stream(_for_seed(group, factor))
                seed.write(str(part), format="MSEED", encoding="FLOAT64", byteorder=">")
            else:
                origin = f"archfrag {version('archfrag')} from {file.name}, sha256 {digest[:16]}"
                part.write_text(_text(group[0], factor, to, origin), encoding="ascii")
        written.append(target)
        if all(channel.stats.record.is_vertical for channel in group):
            continue
        first = group[0].stats
        facts = group[0].stats.record.facts
        rows[target.stem] = {
            "id": target.stem,
            "file": target.name,
            "sha256": sha256_of(target),
            "event": first.record.event,
            **{key: facts[key] for key in _HEADER if key in facts},
            "dt_s": float(first.delta),
            "unit": to,
            "columns": "" if form == "mseed" else "time=1 acceleration=2",
            "channels": " ".join(channel.stats.record.code for channel in group),
            "source": file.name,
            "source_sha256": digest,
            "steps": " ".join(first.record.log),
            "accept": " ".join(first.record.accept),
        }
    write_index(place, rows.values())
    return written


def _for_seed(group: Sequence[Trace], factor: float) -> list[Trace]:
    """Return channels with their own codes if SEED can hold them, or else new ones."""
    codes = [
        (
            _plain(channel.stats.network)[:2] or "XX",
            _plain(channel.stats.station)[:5],
            str(channel.stats.location).strip(),
            channel.stats.record.code,
        )
        for channel in group
    ]
    held = all(
        re.fullmatch(r"[A-Z0-9]{0,2}:[A-Z0-9]{1,3}", f"{c[2]}:{c[3]}") for c in codes
    )
    if not held or len(set(codes)) < len(codes):
        horizontals = dict.fromkeys(map(instrument, group), 0)
        for number, (channel, sensor) in enumerate(zip(group, map(instrument, group))):
            vertical = channel.stats.record.is_vertical
            horizontals[sensor] += not vertical
            place = (
                f"{list(horizontals).index(sensor):02d}" if len(horizontals) > 1 else ""
            )
            kind = "HNZ" if vertical else f"HN{horizontals[sensor]}"
            codes[number] = (*codes[number][:2], place, kind)
        if (
            len(set(codes)) < len(codes)
            or max(horizontals.values()) > 9
            or len(horizontals) > 99
        ):
            raise InputError(
                f"miniSEED has no codes for {len(group)} channels; write text"
            )
    keys = ("network", "station", "location", "channel")
    return [
        Trace(
            np.ascontiguousarray(channel.data / factor, dtype=np.float64),
            {
                **dict(zip(keys, names)),
                "delta": channel.stats.delta,
                "starttime": channel.stats.starttime,
            },
        )
        for names, channel in zip(codes, group, strict=True)
    ]


def _text(channel: Trace, factor: float, unit: str, origin: str) -> str:
    """Return columns of time and acceleration below a header, all in ASCII."""
    record = channel.stats.record
    dt = float(channel.stats.delta)
    header = [
        f"two columns: time [s], acceleration [{unit}]",
        origin,
        *(
            f"{name}: {record.facts[name]}"
            for name in ("event", "date", "station")
            if name in record.facts
        ),
        f"component: {record.code}; dt = {dt!r} s; {channel.data.size} samples",
        *(f"step: {step}" for step in record.log),
    ]
    times = (np.arange(channel.data.size) * dt).tolist()
    rows = [f"{t:.10g} {v!r}" for t, v in zip(times, (channel.data / factor).tolist())]
    plain = (" ".join(f"# {line}".split())[:1000] for line in header)
    return "\n".join([*plain, *rows, ""]).encode("ascii", "backslashreplace").decode()


def _plain(code: str) -> str:
    return re.sub(r"[^A-Za-z0-9]", "", str(code)).upper()
