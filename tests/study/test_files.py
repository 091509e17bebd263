"""Files appear full or not at all."""

import pytest

from archfrag.errors import OutputError
from archfrag.study.files import replacing, source_hash, sweep
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


def test_sweeping_removes_what_a_killed_run_left_and_nothing_else(tmp_path):
    (tmp_path / "parts").mkdir()
    left = [".cube.nc.ab_1.tmp", "parts/.000001-ab.npz.x9z.tmp", ".report.html.k2_"]
    kept = [".archfrag.lock", "cube.nc", "parts/000001-ab.npz", ".hidden"]
    for name in left + kept:
        (tmp_path / name).write_text("")
    sweep(tmp_path)
    found = {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_file()}
    assert found == set(kept)


def test_source_hash_states_edits_in_any_file_of_a_folder(tmp_path, monkeypatch):
    monkeypatch.setattr("archfrag.study.files.PACKAGE", tmp_path)
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "a.py").write_text("a = 1\n")
    (tmp_path / "b.py").write_text("b = 1\n")
    before = source_hash("folder", "b.py")
    assert source_hash("folder", "b.py") == before
    (tmp_path / "folder" / "a.py").write_text("a = 2\n")
    after = source_hash("folder", "b.py")
    assert after != before
    (tmp_path / "b.py").write_text("b = 2\n")
    assert source_hash("folder", "b.py") != after
