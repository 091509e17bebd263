"""Files that are read within limits, or written completely or not at all; text that is shown."""

import codecs
import contextlib
import hashlib
import multiprocessing
import multiprocessing.connection
import os
import re
import secrets
import shutil
import socket
import stat
import tempfile
import threading
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, TextIO

from archfrag.errors import InputError, OutputError

if TYPE_CHECKING:
    import pandas as pd

WORK = ".archfrag"  # in the folder of a study's results: all that is not for people
_HOST = re.sub(r"\W", "_", socket.gethostname())
# Temporary names give host and process, so that what a killed process left can be recognised.
_TEMPORARY = re.compile(r"\.archfrag-(?P<host>\w+)-(?P<pid>[0-9]{1,9})-[a-z0-9_]{8}\.tmp")
_SURELY_LEFT = 30 * 86400.0  # age at which no process can be at work on a temporary file [s]
# Characters that a terminal obeys, or that change the direction of the text around them.
_OBEYED = re.compile(
    r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]"
)
_FORMULA = re.compile(r"[=+\-@\t\r]")  # first characters of a cell that a spreadsheet computes
_NUMBER = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?")


def counted(number: int, noun: str) -> str:
    """Return a number of things: 1 arch, 2 arches."""
    plural = "" if number == 1 else "es" if noun.endswith("ch") else "s"
    return f"{number} {noun}{plural}"


def cannot_write(path: Path, error: OSError) -> OutputError:
    """Return the error to raise if a file or folder cannot be written."""
    return OutputError(
        f"{path}: cannot be written ({error.strerror or error}); the output folder must exist or "
        "be creatable, allow writing and have space; what was finished is kept"
    )


def printable(text: str) -> str:
    """Return the text from elsewhere as a terminal may show it: what it would obey stands as
    ``\\u001b``.
    """
    return _OBEYED.sub(lambda found: f"\\u{ord(found[0]):04x}", text)


@contextlib.contextmanager
def opened(path: str | Path, largest: float = float("inf")) -> Iterator[BinaryIO]:
    """Open a file to read its bytes; a pipe or device is not waited for.

    `OSError` also for what is no regular file, and for one of more than `largest` bytes.
    """
    with open(os.open(path, os.O_RDONLY | os.O_NONBLOCK), "rb") as file:
        state = os.fstat(file.fileno())
        if not stat.S_ISREG(state.st_mode):
            raise OSError(0, "it is not a regular file")
        if state.st_size > largest:
            raise OSError(0, f"it has {state.st_size} bytes; at most {largest:.0f} are allowed")
        yield file


def read_bytes(path: Path, largest: int, kind: type[InputError], what: str) -> bytes:
    """Return the content of a file of at most `largest` bytes; else an error of a `kind`, naming
    `what`.
    """
    try:
        with opened(path, largest) as file:
            return file.read(largest)
    except OSError as error:
        raise kind(f"{what} {path} cannot be read: {error.strerror}") from error


def read_text(path: Path, largest: int, kind: type[InputError], what: str) -> str:
    """Return the UTF-8 text of a file, see `read_bytes`."""
    content = read_bytes(path, largest, kind, what)
    if wide := wide_encoding(content):
        raise kind(f"{what} {path} is text in {wide}; save it as UTF-8")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise kind(f"{what} {path} is not text in UTF-8; save it as UTF-8") from error


def wide_encoding(content: bytes) -> str:
    """Return UTF-16 or UTF-32 if the content of a text file is in it, else nothing."""
    if content[:4] in (codecs.BOM_UTF32_LE, codecs.BOM_UTF32_BE):
        return "UTF-32"
    head = content[:400]
    fewer, more = sorted((head[::2].count(0), head[1::2].count(0)))
    plain = len(head) > 8 and not fewer and more > 0.45 * len(head)
    return "UTF-16" if plain or head[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE) else ""


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file, 64 hexadecimal digits; a pipe or device is not waited for."""
    with opened(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()  # type: ignore[arg-type]


def end_with_parent() -> None:
    """End this process of `multiprocessing` when the one that started it is gone."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        multiprocessing.connection.wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def make_folder(path: Path) -> Path:
    """Make a folder with its parents and see that it can be written, or raise `OutputError`."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=path).close()
    except OSError as error:
        raise cannot_write(path, error) from error
    return path


def temporary_prefix() -> str:
    """Return the prefix of names that `sweep` recognises; their suffix is .tmp."""
    return f".archfrag-{_HOST}-{os.getpid()}-"


def temporary_folder(place: Path) -> "tempfile.TemporaryDirectory[str]":
    """Make a folder that is removed when its block ends, or by `sweep` after a kill."""
    return tempfile.TemporaryDirectory(".tmp", temporary_prefix(), place, True)


def sweep(folder: Path) -> None:
    """Remove temporary files and folders of killed processes, by their names, below a folder."""
    for entry in list(folder.rglob("*")):
        found = _TEMPORARY.fullmatch(entry.name)
        if found is None or entry.is_symlink():
            continue
        with contextlib.suppress(OSError):
            gone = time.time() - entry.stat().st_mtime > _SURELY_LEFT
            if found["host"] == _HOST:
                try:
                    os.kill(int(found["pid"]), 0)
                except ProcessLookupError:
                    gone = True
            if gone:
                shutil.rmtree(entry) if entry.is_dir() else entry.unlink()


@contextlib.contextmanager
def replacing(path: Path, lasting: bool = True) -> Iterator[Path]:
    """Give a temporary name and, if all goes well, put that file in `path`'s place.

    It is in the hidden folder of a study beside `path`, or else in the same folder. The bytes are
    on the disk before the name is, unless not `lasting`: then a kill, but not a power cut, leaves
    the file complete. `OutputError` for any `OSError` inside; `path` is then as it was.
    """
    hidden = path.parent / WORK
    place = hidden if hidden.is_dir() and not hidden.is_symlink() else path.parent
    temporary = place / f"{temporary_prefix()}{secrets.token_hex(4)}.tmp"
    try:
        # Unlike those of `tempfile`, with the permissions that the user's umask allows.
        temporary.touch(exist_ok=False)
        yield temporary
        if lasting:
            with open(temporary, "rb+") as file:
                os.fsync(file.fileno())
        os.replace(temporary, path)
    except OSError as error:
        raise cannot_write(path, error) from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


def quoted(cell: Any) -> Any:
    """Return a cell of a CSV: text that a spreadsheet would compute gets an apostrophe before
    it.
    """
    if isinstance(cell, str) and _FORMULA.match(cell) and not _NUMBER.fullmatch(cell):
        return f"'{cell}"
    return cell


def unquoted(cell: str) -> str:
    """Return a cell as it was before `quoted`."""
    return cell[1:] if cell[:1] == "'" and _FORMULA.match(cell, 1) else cell


def write_csv(target: Path | TextIO, pieces: "Iterable[pd.DataFrame]", **form: Any) -> None:
    """Write a table in pieces of the same columns as CSV; a file completely or not at all.

    `form` is handed to `pandas.DataFrame.to_csv`.
    """
    if isinstance(target, Path):
        with replacing(target) as part, open(part, "w", encoding="utf-8", newline="") as file:
            return write_csv(file, pieces, **form)
    for number, piece in enumerate(pieces):
        texts = {
            name: column.astype(object).map(quoted)
            for name, column in piece.items()
            if column.dtype.kind not in "biufc"
        }
        table = piece.assign(**texts).rename(columns=quoted)  # type: ignore[arg-type]
        table.to_csv(target, index=False, header=number == 0, lineterminator="\n", **form)
