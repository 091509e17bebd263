"""Motions as one file for the workers."""

import subprocess
import sys

import numpy as np
import pytest

from archfrag.errors import InputError, OutputError
from archfrag.motions import store
from archfrag.motions.motion import Motion
from archfrag.motions.store import load_motions, save_motions

from .helpers import wave

MOTIONS = [
    Motion(wave() * np.pi, 0.01, id="one", metadata={"Mw": 6.5, "event": "é"}, log=("Made.",)),
    Motion(wave(50), 1.0 / 3.0, vertical=wave(50), id="two"),
]


def test_round_trip_is_exact(tmp_path):
    save_motions(tmp_path / "motions.npz", MOTIONS)
    for before, after in zip(MOTIONS, load_motions(tmp_path / "motions.npz"), strict=True):
        assert np.array_equal(before.acceleration, after.acceleration)
        assert after.acceleration.dtype == np.float64
        assert (after.vertical is None) == (before.vertical is None)
        assert before.vertical is None or np.array_equal(before.vertical, after.vertical)
        assert (after.dt, after.id, after.log) == (before.dt, before.id, before.log)
        assert after.metadata == before.metadata


def test_same_motions_same_bytes(tmp_path):
    for name in ("a", "b"):
        save_motions(tmp_path / name, MOTIONS)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_failed_write_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch):
    target = tmp_path / "motions.npz"
    save_motions(target, MOTIONS[:1])
    before = target.read_bytes()

    def full(file, **arrays):
        file.write(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(store.np, "savez", full)
    with pytest.raises(OutputError, match=r"cannot be written \(No space left on device\)"):
        save_motions(target, MOTIONS)
    assert target.read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["motions.npz"]


def test_folder_that_is_not_there(tmp_path):
    with pytest.raises(OutputError, match=r"motions\.npz: cannot be written"):
        save_motions(tmp_path / "none" / "motions.npz", MOTIONS)


def test_metadata_must_be_json(tmp_path):
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
        with open(path, "wb") as file:
            np.savez(file, x=np.zeros(3))
    sentence = (
        "no such file" if damage == "missing" else "not a file of motions written by archfrag"
    )
    with pytest.raises(InputError, match=sentence):
        load_motions(path)


@pytest.mark.parametrize(
    "module", ["archfrag.motions", "archfrag.motions.store", "archfrag.motions.scale"]
)
def test_worker_modules_do_not_import_obspy_or_matplotlib(module):
    code = (
        f"import sys, {module}; "
        "print([m for m in ('obspy', 'matplotlib', 'pandas') if m in sys.modules])"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"
