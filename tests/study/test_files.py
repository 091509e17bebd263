"""Files appear full or not at all."""

import os
import subprocess

import pytest

from archfrag.errors import OutputError
from archfrag.files import WORK, replacing, sweep, temporary_prefix
from tests.study.small import files


def test_a_file_is_replaced_only_at_the_end(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("old")
    with replacing(path) as temporary:
        temporary.write_text("new")
        assert path.read_text() == "old"
        assert temporary.parent == tmp_path
    assert files(tmp_path) == {"a.txt": b"new"}


def test_a_full_disk_leaves_the_old_file_and_nothing_else(tmp_path, full_disk):
    path = tmp_path / "a.txt"
    path.write_text("old")
    message = (
        f"{path}: cannot be written (No space left on device); the output folder must exist or be "
        "creatable, allow writing and have space; what was finished is kept"
    )
    with full_disk(at=1), pytest.raises(OutputError) as caught, replacing(path) as temporary:
        temporary.write_text("half")
    assert str(caught.value) == message
    assert caught.value.exit_code == 4
    assert files(tmp_path) == {"a.txt": b"old"}


def test_sweeping_removes_what_a_killed_process_left_and_nothing_else(tmp_path):
    """A temporary name gives its process; that of this test is alive, that of `true` is not."""
    left = subprocess.Popen(["true"])
    left.wait()
    mine = temporary_prefix()
    gone = mine.replace(f"-{os.getpid()}-", f"-{left.pid}-")
    elsewhere = gone.replace(".archfrag-", ".archfrag-elsewhere_")
    (tmp_path / "parts" / f"{gone}folder_1.tmp").mkdir(parents=True)
    (tmp_path / "parts" / f"{gone}folder_1.tmp" / "half.npz").touch()
    swept = [f"{gone}abcdefg1.tmp", f"parts/{gone}abcdefg2.tmp", f"{elsewhere}abcdefg3.tmp"]
    kept = [
        f"{mine}abcdefg4.tmp", f"{elsewhere}abcdefg5.tmp", f"{gone}notes.tmp", "cube.nc",
        ".study.yaml.swp", ".notes.csv.bak", ".results.json.orig", ".thesis.html.k2_0.tmp",
    ]  # fmt: skip
    for name in swept + kept:
        (tmp_path / name).touch()
    os.utime(tmp_path / swept[2], (1.0e9, 1.0e9))
    os.symlink(tmp_path / "parts", tmp_path / f"{gone}abcdefg6.tmp")
    sweep(tmp_path)
    found = {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_file()}
    assert found == set(kept)
    assert (tmp_path / "parts").is_dir()


def test_a_temporary_file_lives_in_the_hidden_folder_of_the_results(tmp_path):
    for name in ("out", "elsewhere"):
        (tmp_path / name).mkdir()
    (tmp_path / "out" / WORK).mkdir()
    (tmp_path / "elsewhere" / WORK).symlink_to(tmp_path / "out")
    for name, place in (("out", tmp_path / "out" / WORK), ("elsewhere", tmp_path / "elsewhere")):
        with replacing(tmp_path / name / "cube.nc") as temporary:
            assert temporary.parent == place
        assert (tmp_path / name / "cube.nc").is_file()
