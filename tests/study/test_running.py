"""A run of a study: one at a time in a folder, stopped by signals."""

import os
import signal
import subprocess
import sys
import time

import pytest

from archfrag.errors import OutputError
from archfrag.study.file.schema import load_study
from archfrag.study.running import only_run, stoppable
from tests.study.small import small_study


@pytest.fixture
def study(tmp_path):
    study = load_study(small_study(tmp_path))
    study.work.mkdir(parents=True)
    return study


class TestStop:
    def test_the_first_signal_raises_and_the_others_are_ignored(self):
        before = signal.getsignal(signal.SIGTERM)

        def be_stopped_thrice():
            try:
                os.kill(os.getpid(), signal.SIGTERM)
                time.sleep(5.0)
            finally:
                os.kill(os.getpid(), signal.SIGINT)
                os.kill(os.getpid(), signal.SIGTERM)

        with pytest.raises(SystemExit) as stopped, stoppable():
            be_stopped_thrice()
        assert stopped.value.code == 128 + signal.SIGTERM
        assert signal.getsignal(signal.SIGTERM) == before

    def test_code_that_does_not_return_is_ended(self):
        """A hash of many rounds stands for a compiler."""
        code = (
            "import hashlib; from archfrag.study import running; running.GRACE = 0.5\n"
            "with running.stoppable():\n"
            "    print('ready', flush=True)\n"
            "    hashlib.pbkdf2_hmac('sha256', b'a', b'b', 2**31 - 1)\n"
        )
        process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
        assert process.stdout.readline() == "ready\n"
        time.sleep(0.5)  # until the hash has begun
        process.send_signal(signal.SIGTERM)
        assert process.wait(5.0) == 128 + signal.SIGTERM
        process.communicate()


class TestLock:
    def test_another_run_is_named_and_whatever_ends_it_frees_the_lock(self, study):
        with only_run(study):
            with pytest.raises(OutputError, match="another run of study 'small'"), only_run(study):
                pass
            with pytest.raises(OutputError), only_run(study):
                pass
        with pytest.raises(KeyboardInterrupt), only_run(study):
            raise KeyboardInterrupt
        with only_run(study):
            pass

    def test_a_file_system_without_locks_does_without(self, study, monkeypatch):
        def none(*_):
            raise OSError(38, "Function not implemented")

        monkeypatch.setattr("fcntl.flock", none)
        with only_run(study), only_run(study):
            pass
