"""Files appear full or not at all."""

import errno
import os
import subprocess

import numpy as np
import pandas as pd
import pytest

from archfrag.errors import OutputError
from archfrag.files import replacing, sweep, temporary_prefix, write_csv
from archfrag.motions.index import load_index, write_index
from archfrag.physics.kernels.cache import digest_of_syntax
from archfrag.study import provenance
from archfrag.study.provenance import write_text
from tests.study.small import command, files_below, write_at2


def test_a_file_is_replaced_at_the_end_and_a_full_disk_leaves_the_old_one(
    tmp_path, monkeypatch
):
    def full(handle):
        raise OSError(errno.ENOSPC, "No space left on device")

    path = tmp_path / "a.txt"
    path.write_text("older")
    with replacing(path) as temporary:
        temporary.write_text("old")
        assert path.read_text() == "older"
        assert temporary.parent == tmp_path
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OutputError) as caught, replacing(path) as temporary:
        temporary.write_text("half")
    assert str(caught.value) == (
        f"{path}: cannot be written (No space left on device); the output folder must exist or be "
        "creatable, allow writing and have space; what was finished is kept"
    )
    assert caught.value.exit_code == 4
    assert files_below(tmp_path) == {path: b"old"}


def test_sweeping_removes_what_a_killed_process_left_and_nothing_else(tmp_path):
    """A temporary name gives its process; that of this test is alive, that of `true` is not."""
    left = subprocess.Popen(["true"])
    left.wait()
    mine = temporary_prefix()
    gone = mine.replace(f"-{os.getpid()}-", f"-{left.pid}-")
    elsewhere = gone.replace(".archfrag-", ".archfrag-elsewhere_")
    (tmp_path / "parts" / f"{gone}folder_1.tmp").mkdir(parents=True)
    (tmp_path / "parts" / f"{gone}folder_1.tmp" / "half.npz").touch()
    swept = [
        f"{gone}abcdefg1.tmp",
        f"parts/{gone}abcdefg2.tmp",
        f"{elsewhere}abcdefg3.tmp",
    ]
    kept = [
        f"{mine}abcdefg4.tmp",
        f"{elsewhere}abcdefg5.tmp",
        f"{gone}notes.tmp",
        "cube.nc",
        ".study.yaml.swp",
        ".notes.csv.bak",
        ".results.json.orig",
        ".thesis.html.k2_0.tmp",
    ]
    for name in swept + kept:
        (tmp_path / name).touch()
    os.utime(tmp_path / swept[2], (1.0e9, 1.0e9))
    os.symlink(tmp_path / "parts", tmp_path / f"{gone}abcdefg6.tmp")
    sweep(tmp_path)
    found = {
        str(path.relative_to(tmp_path))
        for path in tmp_path.rglob("*")
        if path.is_file()
    }
    assert found == set(kept)
    assert (tmp_path / "parts").is_dir()


def test_files_follow_the_umask(tmp_path):
    before = os.umask(0o077)
    try:
        write_text(tmp_path / "a.txt", "text")
        write_csv(tmp_path / "a.csv", [pd.DataFrame({"a": [1]})])
    finally:
        os.umask(before)
    assert {path.stat().st_mode & 0o777 for path in tmp_path.iterdir()} == {0o600}


def test_cells_that_a_spreadsheet_would_compute_are_quoted_in_every_csv(tmp_path):
    cells = ["=cmd|'calc'!A1", "@SUM(1)", "+1+1", "-x", "-0.5", "plain"]
    row = {"id": "a", "file": "-a.AT2", "unit": "g", "event": cells[0], "dt_s": 0.01}
    row["=head"] = "-1"
    text = write_index(tmp_path, [row]).read_text()
    assert "'-a.AT2" in text
    assert f"'{cells[0]}" in text
    (entry,) = load_index(tmp_path)
    assert entry.path == tmp_path / "-a.AT2"
    assert [entry.metadata[key] for key in ("event", "dt_s")] == [cells[0], 0.01]
    write_csv(tmp_path / "a.csv", [pd.DataFrame({"=a": cells, "b": -1.0})])
    stored = pd.read_csv(tmp_path / "a.csv")
    assert list(stored) == ["'=a", "b"]
    assert stored["'=a"].tolist() == [*(f"'{cell}" for cell in cells[:4]), *cells[4:]]


def test_what_a_terminal_would_obey_is_shown(tmp_path):
    name = "\x1b]0;owned\x07\u202egpj\x9b2J.AT2"
    write_at2(tmp_path / name, np.sin(np.arange(100.0)), 0.01)
    for more in (["inspect"], ["measure", "--out", tmp_path / "no" / "f.csv"]):
        shown = command("records", *more, tmp_path / name).output
        assert not set("\x1b\x07\u202e\x9b") & set(shown)
    assert "\\u001b]0;owned" in command("records", "inspect", tmp_path / name).output


def test_the_digest_of_syntax_is_kept_for_the_next_process(monkeypatch):
    own = tuple(provenance.files_of_code("study/file/*.py"))
    known = digest_of_syntax(own)
    digest_of_syntax.cache_clear()
    monkeypatch.setattr("ast.parse", None)
    assert digest_of_syntax(own) == known
    digest_of_syntax.cache_clear()
    monkeypatch.setattr("archfrag.physics.kernels.cache.use_kernel_cache", lambda: None)
    with pytest.raises(TypeError):
        digest_of_syntax(own)
