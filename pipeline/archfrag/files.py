"""Files that are written completely or not at all."""

import contextlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

from archfrag.errors import OutputError


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
