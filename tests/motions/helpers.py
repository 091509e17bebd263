"""Small files that the tests write themselves, and the real ones that may lie beside the repo."""

import csv
import os
from pathlib import Path

import numpy as np
import pytest

from archfrag.errors import InputError

REAL_RECORDS = Path(__file__).resolve().parents[3] / "shared" / "records"
SHIPPED = Path(__file__).resolve().parents[2] / "records"

needs_real_records = pytest.mark.skipif(
    not (REAL_RECORDS / "manifest.csv").is_file(),
    reason="the real records of ../shared/records are not beside this repository",
)

FOURTH_LINES = (
    "NPTS= {count:6d}, DT=   {dt:.4f} SEC,",
    "NPTS=  {count}, DT= {dt:.5f} SEC",
    "{count}    {dt:.4f}    NPTS, DT",
    "NPTS=   {count}, DT=   {dt:.4f} SEC,   0 POLE @    13.90000 HZ,  -5 POLE @      .10000",
)


def at2_text(
    samples,
    dt=0.01,
    *,
    count=None,
    unit="G",
    fourth=FOURTH_LINES[0],
    component="180",
    end="\n",
):
    """AT2 file with five samples a row, as PEER writes them."""
    cells = [f"{value:15.7E}" for value in samples]
    header = [
        "PEER NGA STRONG MOTION DATABASE RECORD",
        f"Imperial Valley-02, 5/19/1940, El Centro Array #9, {component}",
        f"ACCELERATION TIME SERIES IN UNITS OF {unit}",
        fourth.format(count=len(samples) if count is None else count, dt=dt),
    ]
    rows = ["".join(cells[first : first + 5]) for first in range(0, len(cells), 5)]
    return end.join([*header, *rows]) + end


def put(folder, content, name="a.txt"):
    """Write text or bytes into a file, and return its path."""
    (folder / name).write_bytes(
        content if isinstance(content, bytes) else content.encode()
    )
    return folder / name


def swapped(text):
    """Numbers as they are written where the comma is decimal."""
    return text.replace(",", "_").replace(".", ",").replace("_", ".")


def refused(call, *parts, start=""):
    """A call is refused in one line that begins so and holds these parts."""
    with pytest.raises(InputError) as caught:
        call()
    message = str(caught.value)
    assert message.startswith(str(start))
    assert "\n" not in message
    assert len(message) < 1000
    assert all(part in message for part in parts), message


def wave(count=400, dt=0.01, frequency=1.5):
    """A sine that grows and dies away, and starts and ends at zero."""
    time = np.arange(count) * dt
    return np.sin(2.0 * np.pi * frequency * time) * np.sin(
        np.pi * np.arange(count) / (count - 1)
    )


def pga(motion):
    """Largest horizontal acceleration [m/s2]."""
    return np.abs(motion.acceleration).max()


def manifest():
    """Rows of the manifests of the real records; none where these are not there."""
    files = (REAL_RECORDS / name for name in ("manifest.csv", "manifest_p695.csv"))
    return [
        row for file in files if file.is_file() for row in csv.DictReader(file.open())
    ]


class Payload:
    """Makes a folder where it is unpickled."""

    def __init__(self, marker):
        self.marker = marker

    def __reduce__(self):
        return os.mkdir, (str(self.marker),)
