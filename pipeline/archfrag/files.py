"""Files that are read as text, or written completely or not at all."""

import contextlib
import os
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path

from archfrag.errors import InputError, OutputError


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


def _not_waiting(name: str, flags: int) -> int:
    return os.open(name, flags | os.O_NONBLOCK)


def read_text(path: Path, largest: int, kind: type[InputError], what: str) -> str:
    """UTF-8 text of a file of at most `largest` bytes; a pipe or device is not waited for.

    Raises
    ------
    kind
        Naming `what` it was to be, and the file.
    """
    try:
        with open(path, "rb", opener=_not_waiting) as file:
            if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                raise OSError(0, "no regular file")
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


@contextlib.contextmanager
def replacing(path: Path, lasting: bool = True) -> Iterator[Path]:
    """Give a temporary name in the same folder and, if all goes well, put it in `path`'s place.

    The bytes are on the disk before the name is, unless not `lasting`: then a kill, but not a
    power cut, leaves the file complete.

    Raises
    ------
    OutputError
        For any `OSError` inside; the temporary file is gone then, `path` as it was.
    """
    temporary = None
    try:
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".tmp")
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
