"""What differs by operating system: limited processes, locks, and files that are in use."""

import os
import subprocess
import sys

import pytest

from archfrag import system


def test_a_file_that_another_program_has_open_is_replaced_once_it_is_closed(
    tmp_path, monkeypatch
):
    """As on Windows, where a file that is open cannot be replaced."""
    calls = []
    rename = os.replace

    def busy(source, target):
        calls.append(target)
        if len(calls) < 3:
            raise PermissionError(13, "in use")
        rename(source, target)

    monkeypatch.setattr(os, "replace", busy)
    for name in ("old", "new"):
        (tmp_path / name).write_text(name, encoding="utf-8")
    system.replace(tmp_path / "new", tmp_path / "old")
    assert (tmp_path / "old").read_text(encoding="utf-8") == "new"
    assert len(calls) == 3


def test_a_file_that_stays_open_is_not_replaced(tmp_path, monkeypatch):
    def busy(*_):
        raise PermissionError(13, "in use")

    monkeypatch.setattr(os, "replace", busy)
    monkeypatch.setattr(system, "WAITED", 0.2)
    (tmp_path / "old").touch()
    with pytest.raises(PermissionError):
        system.replace(tmp_path / "new", tmp_path / "old")


def test_one_process_holds_a_lock_until_it_ends_however_it_ends(tmp_path):
    place = tmp_path / "lock"
    code = (
        "import sys, time; from pathlib import Path; from archfrag.system import locked\n"
        "with locked(Path(sys.argv[1])) as ours:\n"
        "    print(ours, flush=True); time.sleep(60)"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code, place], stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout.readline().strip() == "True"
        with system.locked(place) as ours:
            assert not ours
        other.kill()
    with system.locked(place) as ours:
        assert ours


def test_a_process_is_alive_until_it_ends_and_asking_does_no_harm():
    with subprocess.Popen(
        [sys.executable, "-c", "input()"], stdin=subprocess.PIPE
    ) as one:
        assert system.is_alive(one.pid)
        assert one.poll() is None
        one.communicate(b"\n")
    assert not system.is_alive(one.pid)


def test_a_file_is_opened_without_its_line_ends_being_changed(tmp_path):
    path = tmp_path / "x"
    with system.open_to_append(path) as file:
        file.write(b"a\r\n\x1ab")
    with system.open_to_read(path) as file:
        assert file.read() == b"a\r\n\x1ab"


def test_threads_that_use_a_deferred_module_first_at_once_all_get_it():
    """The loader of importlib (LazyLoader) gives some of them a module without its names."""
    code = (
        "import sys, threading; sys.setswitchinterval(1e-5); from archfrag import system\n"
        "start = threading.Barrier(8); used = []\n"
        "def use():\n"
        "    start.wait(); system.filelock.FileLock; system.psutil.Process; used.append(1)\n"
        "threads = [threading.Thread(target=use) for _ in range(8)]\n"
        "[t.start() for t in threads]; [t.join() for t in threads]\n"
        "print(len(used))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout == "8\n", done.stderr
