"""Records of real earthquakes in the repository: all are read, whole, and say whose they are."""

import csv
import re
from pathlib import Path

import pytest

import archfrag as af
from archfrag.files import sha256_of

REAL = Path(__file__).parents[2] / "records" / "real"
G = 9.80665


def test_each_is_as_its_index_and_the_table_say():
    with (REAL / "index.csv").open(newline="") as file:
        rows = {row["id"]: row for row in csv.DictReader(file)}
    motions = af.read_motions(REAL / "index.csv")
    text = (REAL / "README.md").read_text("utf-8")
    assert [each.id for each in motions] == list(rows)
    assert text.startswith(
        "# Records of real earthquakes\n\n24 horizontal components of 10 "
    )
    assert len({each.metadata["event"] for each in motions}) == 10
    for motion, row in zip(motions, rows.values(), strict=True):
        assert row["sha256"] == sha256_of(REAL / row["file"])
        assert "cite" in row["terms"] or "public domain" in row["terms"]
        assert row["source"].partition("@")[2]
        (line,) = re.findall(rf"^\| `{re.escape(row['file'])}` .*$", text, re.M)
        assert f"{row['event']}, M {float(row['Mw']):g}" in line
        (peak,) = re.findall(rf" {row['component']} ([0-9.]+) g", line)
        assert motion.pga == pytest.approx(float(peak) * G, abs=0.0006 * G)


def test_every_file_is_listed():
    listed = (REAL / "index.csv").read_text("utf-8") + (REAL / "README.md").read_text(
        "utf-8"
    )
    for path in REAL.iterdir():
        others = ("index.csv", "README.md", ".gitattributes")
        assert path.name in listed or path.name in others
