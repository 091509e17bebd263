"""What `pytest --as-elsewhere` takes away is missing to archfrag, and to nobody else."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = str(Path(__file__).parent)
USES = {  # what works on POSIX, and how it fails elsewhere
    "import fcntl": "ModuleNotFoundError",
    "import resource": "ModuleNotFoundError",
    "os.fork() or os._exit(0)": "AttributeError",
    "os.getuid()": "AttributeError",
    "os.register_at_fork(before=print)": "AttributeError",
    "os.open('x', os.O_NONBLOCK | os.O_CREAT)": "AttributeError",
    "os.kill(os.getpid(), 0)": "AssertionError",
    "multiprocessing.get_context('fork')": "ValueError",
    "signal.signal(signal.SIGHUP, print)": "AttributeError",
    "signal.setitimer(signal.ITIMER_PROF, 1.0)": "AttributeError",
    "X.touch(mode=0o600); assert not os.stat('x').st_mode & 0o077": "AssertionError",
    "file = open('x', 'w'); Y.touch(); os.replace('y', 'x')": "PermissionError",
    "file = open('x', 'w'); X.unlink()": "PermissionError",
    "X.touch(); Y.touch(); os.rename('x', 'y')": "FileExistsError",
    "X.touch(); Path('X').touch()": "OSError",
    "open('CON.txt', 'w')": "OSError",
    "Path('aux').mkdir()": "OSError",
    "open('12:30.csv', 'w')": "OSError",
    "open('x', 'w').write('\u03b8')": "UnicodeEncodeError",
    "X.write_text('\u03b8')": "UnicodeEncodeError",
    "X.write_text('a\\n'); assert X.read_bytes() == b'a\\n'": "AssertionError",
    "X.write_bytes(b'\\xc3\\xa9'); assert X.read_text() == '\u00e9'": "AssertionError",
    "assert os.path.relpath('a/b', '.') == 'a/b'": "AssertionError",
    "assert str(Path('a/b/c').relative_to('a')) == 'b/c'": "AssertionError",
}
PROGRAM = """import sys
head = "import multiprocessing, os, signal; from pathlib import Path\\n"
exec(head + "X, Y = Path('x'), Path('y')\\n" + sys.argv[2], {"__name__": sys.argv[1]})"""


@pytest.mark.posix
@pytest.mark.parametrize("use", USES)
def test_what_is_taken_away(use, tmp_path):
    for places, module, error in (
        ([FOLDER], "archfrag_of_test", USES[use]),
        ([FOLDER], "others", ""),
        ([], "archfrag_of_test", ""),
    ):
        folder = tmp_path / f"{module}{len(places)}"
        folder.mkdir()
        done = subprocess.run(
            [sys.executable, "-X", "utf8", "-c", PROGRAM, module, use],
            env=os.environ | {"PYTHONPATH": os.pathsep.join(places)},
            cwd=folder,
            capture_output=True,
            text=True,
        )
        last = done.stderr.strip().rpartition("\n")[2]
        assert last.partition(":")[0] == error, (module, places, done.stderr)
