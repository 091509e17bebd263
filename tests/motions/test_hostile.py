"""Files that attack, and spoiled ones: none runs anything, ends the command or keeps it."""

import bz2
import collections
import functools
import gzip
import io
import os
import pickle
import re
import tarfile
import tempfile
import time

import numpy as np
import pytest
from click.testing import CliRunner
from obspy import Stream, Trace

from archfrag.cli import main
from archfrag.errors import RecordError
from archfrag.motions import formats
from archfrag.motions.formats import read_apart
from archfrag.motions.read import read_horizontals, read_motion

from .helpers import Payload, wave
from .samples import MADE_UP


@functools.cache
def record(form):
    """Bytes of a small record."""
    header = {"network": "XX", "station": "AB", "channel": "HNE", "delta": 0.01}
    stream = Stream([Trace(np.round(4000.0 * wave()).astype(np.int32), header=header)])
    with tempfile.NamedTemporaryFile() as file:
        stream.write(file.name, format=form)
        return file.read()


def payload(marker):
    """What obspy takes for one of its pickles, by its first hundred bytes."""
    return pickle.dumps(("obspy.core.stream", Payload(marker)))


def tarred(content):
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w") as archive:
        entry = tarfile.TarInfo("inside")
        entry.size = len(content)
        archive.addfile(entry, io.BytesIO(content))
    return buffer.getvalue()


def crash():
    """GSE2 with lines of more than 82 characters: obspy copies them into a buffer of that size."""
    head, body = record("GSE2").split(b"DAT2\n")
    return head + b"DAT2\n" + body.replace(b"\n", b"") * 400


ATTACKS = {
    "quake.mseed": payload,
    "quake.AT2": payload,
    "payload.gz": lambda marker: gzip.compress(payload(marker)),
    "payload.tar": lambda marker: tarred(payload(marker)),
    "record.bz2": lambda _: bz2.compress(record("SLIST")),
    "cut.gse2": lambda _: record("GSE2")[:300],
    "crash.gse2": lambda _: crash(),
    "cut.mseed": lambda _: record("MSEED")[:-100],
    # The header announces another number of samples (word 79).
    "long.sac": lambda _: (
        record("SAC")[:316] + b"\xff\xff\xff\x7f" + record("SAC")[320:]
    ),
    "no_numbers.slist": lambda _: record("SLIST").replace(b"1", b"x"),
    "noise.dat": lambda _: np.random.default_rng(1).bytes(5000),
}


@pytest.mark.parametrize("name", ATTACKS)
def test_nothing_runs_and_one_line_names_the_file(tmp_path, name):
    marker = tmp_path / "ran"
    path = tmp_path / name
    pickle.loads(payload(marker))
    marker.rmdir()  # the payload is one
    path.write_bytes(ATTACKS[name](marker))
    before = set(tmp_path.iterdir())
    result = CliRunner().invoke(
        main, ["records", "inspect", str(path), "--unit", "cm/s2"]
    )
    assert set(tmp_path.iterdir()) == before
    assert (result.exit_code, result.stdout, result.output.count("\n")) == (2, "", 1)
    assert result.output.startswith(f"archfrag: error: {path}")
    assert not name.endswith(("gz", "tar", "bz2")) or "never unpacked" in result.output


@pytest.mark.posix
def test_a_device_or_a_pipe_is_no_record(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", "/dev/zero"):
        with pytest.raises(
            RecordError, match="cannot be read: it is not a regular file"
        ):
            read_motion(path)


@pytest.mark.parametrize(
    ("seconds", "content", "reason"),
    [
        (0.05, lambda: record("MSEED") * 20_000, "it took more than 0.05 s of"),
        (60.0, crash, "it ended in a crash"),
    ],
)
def test_a_crash_and_computing_time_end_it(
    tmp_path, monkeypatch, seconds, content, reason
):
    monkeypatch.setattr(formats.READER, "seconds", seconds)
    (tmp_path / "x").write_bytes(content())
    with pytest.raises(RecordError, match=rf"x: reading it failed \({reason}"):
        read_apart(str(tmp_path / "x"))


def test_a_relative_path_starts_from_the_folder_of_the_moment(tmp_path, monkeypatch):
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        (tmp_path / name / f"{name}.mseed").write_bytes(record("MSEED"))
        monkeypatch.chdir(tmp_path / name)
        assert len(read_apart(f"{name}.mseed")) == 1


GOOD = [make().encode("latin-1") for makers in MADE_UP.values() for make in makers]
NUMBER = re.compile(rb"[-+]?\d*\.?\d+(?:[ED][-+]?\d+)?")
WORDS = (
    b"NaN",
    b"-Infinity",
    b"1e999",
    b"1D+03",
    b"*" * 9,
    b"1_0",
    b"--1",
    b"9" * 40,
    b"",
    b"\t",
    b"\xbd",
    b"1,5",
    b"-",
    b"0",
    b"-5",
    b"401",
    b"99999999",
    b"4.5",
)
ENDS = (b"\r\n", b"\r", b"\n\n", b"\x0c", b"\0", b"\x1a", b" \n")


def any_of(things, random):
    return things[random.integers(len(things))]


def spoiled(content, random):
    """A file cut off, with bytes put in, numbers replaced, other line ends or lines of another."""
    place = random.integers(len(content) + 1)
    kind = random.integers(6)
    if kind == 0:
        return content[:place]
    if kind == 1:
        noise = random.bytes(random.integers(1, 300))
        more = any_of((noise, b" " * 50_000, b"9" * 50_000), random)
        return content[:place] + more + content[place:]
    if kind == 2:  # most of them of the header
        share = 5.0 / (1 + len(NUMBER.findall(content[:4000])))
        return NUMBER.sub(
            lambda found: (
                any_of(WORDS, random) if random.random() < share else found[0]
            ),
            content,
        )
    if kind == 3:
        return content.replace(b"\n", any_of(ENDS, random))
    if kind == 4:
        lines = content.split(b"\n")
        others = any_of(GOOD, random).split(b"\n")
        place = random.integers(len(lines))
        count = any_of((1, 20), random)
        lines[place : place + count] = [any_of((b"", any_of(others, random)), random)]
        return b"\n".join(lines)
    return content + any_of(GOOD, random)


def test_each_spoiled_file_is_read_or_refused_in_one_line_in_time(tmp_path):
    found = collections.Counter()
    path = tmp_path / "record.txt"
    for seed in range(20260000, 20260250):
        random = np.random.default_rng(seed)
        content = any_of(GOOD, random)
        for _ in range(random.integers(1, 4)):
            content = spoiled(content, random) or b"\n"
        path.write_bytes(content)
        begun = time.process_time()
        message = f"{path}"
        try:
            read_horizontals(path, accept="samples,pga,time_step,header")
            found["motion"] += 1
        except RecordError as error:
            found["refusal"] += 1
            message = str(error)
        assert message.startswith(str(path)), seed
        assert "\n" not in message, seed
        assert time.process_time() - begun < 10.0, seed
    # Some of the files can still be read, most cannot.
    assert min(found["motion"], found["refusal"]) > 250 / 20
