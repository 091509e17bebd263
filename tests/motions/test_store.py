"""Motions as one file for the workers, and measures of many as a flatfile."""

import numpy as np
import pytest

from archfrag.errors import InputError
from archfrag.files import write_csv
from archfrag.motions.flatfile import measure_records, read_flatfile
from archfrag.motions.measures import measure
from archfrag.motions.motion import Motion, load_motions, save_motions

from .helpers import wave

MOTIONS = [
    Motion(wave() * np.pi, 0.01, id="one", metadata={"Mw": 6.5, "event": "é"}, log=("Made.",)),
    Motion(wave(50), 1.0 / 3.0, vertical=wave(50), id="two"),
]


def test_round_trip_is_exact(tmp_path):
    save_motions(tmp_path / "motions.npz", MOTIONS)
    save_motions(tmp_path / "again.npz", MOTIONS)
    assert (tmp_path / "motions.npz").read_bytes() == (tmp_path / "again.npz").read_bytes()
    for before, after in zip(MOTIONS, load_motions(tmp_path / "motions.npz"), strict=True):
        assert np.array_equal(before.acceleration, after.acceleration)
        assert (after.vertical is None) == (before.vertical is None)
        assert before.vertical is None or np.array_equal(before.vertical, after.vertical)
        for name in ("dt", "id", "log", "metadata"):
            assert getattr(after, name) == getattr(before, name)


def test_metadata_that_are_not_json(tmp_path):
    odd = Motion(wave(), 0.01, id="odd", metadata={"path": tmp_path})
    with pytest.raises(InputError, match=r"odd: metadata cannot be stored as JSON"):
        save_motions(tmp_path / "motions.npz", [odd])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("damage", ["missing", "cut", "other", "archive"])
def test_damaged_file(tmp_path, damage):
    path = tmp_path / "motions.npz"
    if damage == "cut":
        save_motions(path, MOTIONS)
        path.write_bytes(path.read_bytes()[:500])
    elif damage == "other":
        path.write_text("something else")
    elif damage == "archive":
        np.savez(path, x=np.zeros(3))
    reason = "no such file" if damage == "missing" else "not a file of motions"
    with pytest.raises(InputError, match=reason):
        load_motions(path)


def noise(count=2000, seed=1):
    return np.random.default_rng(seed).standard_normal(count) * np.hanning(count)


class TestFlatfile:
    def test_columns_and_values(self, tmp_path):
        facts = {"file": "a.AT2", "event": "Quake, 1999", "Mw": 6.5, "component": "090"}
        known = Motion(noise(), 0.01, id="known", metadata=facts)
        table = measure_records([known], periods=[0.1, 1.0])
        assert list(table.columns[:14]) == [
            "record", "file", "event", "station", "magnitude", "distance_km", "vs30_mps",
            "component", "scale", "dt_s", "PGA_g", "PGV_cms", "PGD_cm", "T0.100S",
        ]  # fmt: skip
        assert table["T1.000S"][0] == pytest.approx(measure(known, "Sa(1.0)") / 9.80665, rel=1e-12)
        write_csv(tmp_path / "flat.csv", [table], float_format="%.6g")
        again = read_flatfile(tmp_path / "flat.csv")
        assert list(again.columns) == list(table.columns)
        assert (again["event"][0], again["component"][0]) == ("Quake, 1999", "090")
        assert again["PGV_cms"].tolist() == pytest.approx(table["PGV_cms"].tolist(), rel=1e-5)

    @pytest.mark.parametrize(
        ("text", "reason"),
        [("a,b\n1,2\n", "has no column 'record'"), ("", "the flatfile cannot be read as CSV"),
         ("record,magnitude\nx,big\n", "could not convert string")],
    )  # fmt: skip
    def test_no_flatfile(self, tmp_path, text, reason):
        (tmp_path / "flat.csv").write_text(text)
        with pytest.raises(InputError, match=reason):
            read_flatfile(tmp_path / "flat.csv")
