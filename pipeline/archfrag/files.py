"""Files that are read as text, or written completely or not at all."""

import contextlib
import os
import re
import shutil
import socket
import stat
import tempfile
import time
from collections.abc import Iterator
from io import BufferedReader
from pathlib import Path

from archfrag.errors import InputError, OutputError

WORK = ".archfrag"  # in the folder of a study's results: all that is not for people
_HOST = re.sub(r"\W", "_", socket.gethostname())
# Temporary names give host and process, so that what a killed process left can be recognised.
_TEMPORARY = re.compile(r"\.archfrag-(?P<host>\w+)-(?P<pid>[0-9]{1,9})-[a-z0-9_]{8}\.tmp")
_SURELY_LEFT = 30 * 86400.0  # age at which no process can be at work on a temporary file [s]


def counted(number: int, noun: str) -> str:
    """A number of things: 1 arch, 2 arches."""
    if number == 1:
        return f"1 {noun}"
    return f"{number} {noun}{'es' if noun.endswith('ch') else 's'}"


def cannot_write(path: Path, error: OSError) -> OutputError:
    """The message for a file or folder that cannot be written."""
    return OutputError(
        f"{path}: cannot be written ({error.strerror or error}); the output folder must exist or "
        "be creatable, allow writing and have space; what was finished is kept"
    )


def opened(path: Path) -> BufferedReader:
    """A regular file, to be read; a pipe or device is not waited for but an `OSError`."""
    number = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    if stat.S_ISREG(os.fstat(number).st_mode):
        return os.fdopen(number, "rb")
    os.close(number)
    raise OSError(0, "no regular file")


def read_text(path: Path, largest: int, kind: type[InputError], what: str) -> str:
    """UTF-8 text of a file of at most `largest` bytes; a pipe or device is not waited for.

    Raises
    ------
    kind
        Naming `what` it was to be, and the file.
    """
    try:
        with opened(path) as file:
            content = file.read(largest + 1)
        if len(content) > largest:
            raise kind(f"{what} {path} is too large; it must have at most {largest} bytes")
        return content.decode("utf-8-sig")
    except OSError as error:
        raise kind(f"{what} {path} cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise kind(f"{what} {path} is no text in UTF-8") from error


def make_folder(path: Path) -> Path:
    """Make a folder with its parents and see that it can be written.

    Raises
    ------
    OutputError
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            pass
    except OSError as error:
        raise cannot_write(path, error) from error
    return path


def temporary_prefix() -> str:
    """What a name that `sweep` recognises begins with; its suffix is .tmp."""
    return f".archfrag-{_HOST}-{os.getpid()}-"


def temporary_folder(place: Path) -> "tempfile.TemporaryDirectory[str]":
    """A folder that is removed when its block ends, or by `sweep` after a kill."""
    prefix = temporary_prefix()
    return tempfile.TemporaryDirectory(".tmp", prefix, place, ignore_cleanup_errors=True)


def sweep(folder: Path) -> None:
    """Remove temporary files and folders of killed processes, by their names, below a folder."""
    import psutil

    for entry in entries(folder):
        found = _TEMPORARY.fullmatch(entry.name)
        if found is None or entry.is_symlink():
            continue
        with contextlib.suppress(OSError):
            gone = found["host"] == _HOST and not psutil.pid_exists(int(found["pid"]))
            if gone or time.time() - entry.stat().st_mtime > _SURELY_LEFT:
                path = Path(entry.path)
                shutil.rmtree(path) if entry.is_dir() else path.unlink()


def entries(folder: Path | str) -> Iterator["os.DirEntry[str]"]:
    """All that is below a folder, links not followed."""
    with contextlib.suppress(FileNotFoundError, NotADirectoryError), os.scandir(folder) as found:
        for entry in found:
            yield entry
            if entry.is_dir(follow_symlinks=False):
                yield from entries(entry.path)


@contextlib.contextmanager
def replacing(path: Path, lasting: bool = True) -> Iterator[Path]:
    """Give a temporary name and, if all goes well, put that file in `path`'s place.

    It is in the hidden folder of a study beside `path`, or else in the same folder.

    The bytes are on the disk before the name is, unless not `lasting`: then a kill, but not a
    power cut, leaves the file complete.

    Raises
    ------
    OutputError
        For any `OSError` inside; the temporary file is gone then, `path` as it was.
    """
    temporary, hidden = None, path.parent / WORK
    try:
        place = hidden if hidden.is_dir() and not hidden.is_symlink() else path.parent
        handle, name = tempfile.mkstemp(".tmp", temporary_prefix(), place)
        os.close(handle)
        temporary = Path(name)
        yield temporary
        if lasting:
            with open(temporary, "rb+") as file:
                os.fsync(file.fileno())
        temporary.chmod(0o644)
        os.replace(temporary, path)
        temporary = None
    except OSError as error:
        raise cannot_write(path, error) from error
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)
