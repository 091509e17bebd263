"""Reading and writing of files, and parsing of CSV tables.

A file is written completely or not at all.
"""

import codecs
import contextlib
import csv
import hashlib
import io
import os
import re
import secrets
import shutil
import socket
import stat
import tempfile
import time
import unicodedata
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from archfrag.errors import InputError, OutputError
from archfrag.system import is_alive, open_to_append, open_to_read, replace

if TYPE_CHECKING:
    import pandas as pd

Named = dict[str, Any]  # values by their names
WORK = (
    ".archfrag"  # hidden folder in that of a study's results, with archfrag's own files
)
STAMPS = "stamp.json"  # SHA-256 of the files of one study
MADE = "made.txt"  # SHA-256 of all files that archfrag wrote
_HOST = re.sub(r"\W", "_", socket.gethostname())
# Temporary names give host and process, so that what a killed process left can be recognised.
_TEMPORARY = r"\.archfrag-(?P<host>\w+)-(?P<pid>[0-9]{1,9})-[a-z0-9_]{8}\.tmp"
# age at which no process can be at work on a temporary file [s]
_SURELY_LEFT = 30 * 86400.0
# Characters that a terminal obeys, or that change the direction of the text around them.
_OBEYED = r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]"
_FORMULA = re.compile(
    r"[=+\-@\t\r]"
)  # first characters of a cell that a spreadsheet computes
WHOLE = r"[-+]?(0|[1-9][0-9]*)"  # as in YAML 1.2, without 010, which is 8 in YAML 1.1
REAL = rf"({WHOLE}(\.[0-9]*)?|[-+]?\.[0-9]+)([eE][-+]?[0-9]+)?"
NUMBERS = "write digits with a decimal point, such as 10, 0.5 or 2e-3"
_NUMBER = re.compile(REAL)


def counted(number: int, noun: str) -> str:
    """Return a number with its noun, such as 1 arch or 2 arches."""
    plural = "es" if noun.endswith("ch") else "s"
    return f"{number} {noun}{plural * (number != 1)}"


def number(text: str) -> float:
    """Return the number in a text of a table, an option or a key.

    inf is a number. ValueError for other texts, even if they are numbers elsewhere: nan, 1_0 (10
    in Python), 1:30 and 010 (90 and 8 in YAML 1.1).
    """
    plain = text.strip()
    if _NUMBER.fullmatch(plain) or plain.lstrip("+-") == "inf":
        return float(plain)
    raise ValueError(f"could not convert string to a number: {plain[:60]!r}; {NUMBERS}")


def stated_unit(head: str) -> tuple[str, str | None]:
    """Split the name of a column, `name [unit]` or `name (unit)`, into name and unit.

    The unit is None if none is stated.
    """
    found = re.fullmatch(r"(.+?)\s*[\[(]\s*([^\[\]()]*?)\s*[\])]", head.strip())
    return (found[1], found[2]) if found else (head, None)


def absolute(path: str, folder: Path) -> str:
    """Return a path of a study file as an absolute one.

    A relative path is below `folder`; ~ is the home folder.
    """
    return portable(os.path.abspath(os.path.join(folder, os.path.expanduser(path))))


def portable(path: str) -> str:
    """Return a path as this system has it.

    It may be written with backslashes, and its accents as one sign or as two.
    """
    slashes = path.replace("\\", "/")
    composed = (unicodedata.normalize(form, slashes) for form in ("NFC", "NFD"))
    return next(filter(os.path.exists, (path, slashes, *composed)), slashes)


def relative_path(path: str | Path, folder: str | Path) -> str:
    """Return a path as one from `folder`, with slashes on every system.

    It is absolute if no path leads from one to the other, as between drives of Windows.
    """
    try:
        found = os.path.relpath(path, folder)
    except ValueError:
        found = os.path.abspath(path)
    return found.replace(os.sep, "/")


def cannot_write(path: Path, error: OSError) -> OutputError:
    """Return the error to raise if a file or folder cannot be written."""
    return OutputError(
        f"{path}: cannot be written ({error.strerror or error}); the output folder must exist or "
        "be creatable, allow writing and have space; what was finished is kept"
    )


def printable(text: str) -> str:
    """Return a text in a form that is safe to show on a terminal.

    Control characters, and those that change the direction of text, become codes such as
    ``\\u001b``.
    """
    return re.sub(_OBEYED, lambda found: f"\\u{ord(found[0]):04x}", text)


@contextlib.contextmanager
def opened(path: str | Path, largest: float = float("inf")) -> Iterator[BinaryIO]:
    """Open a regular file to read its bytes.

    OSError if it cannot be opened, is a folder, pipe or device, or has more than `largest` bytes.
    A pipe or device is not waited for.
    """
    with open_to_read(path) as file:
        state = os.fstat(file.fileno())
        if not stat.S_ISREG(state.st_mode):
            raise OSError(0, "it is not a regular file")
        if state.st_size > largest:
            raise OSError(
                0, f"it has {state.st_size} bytes; at most {largest:.0f} are allowed"
            )
        yield file


def read_bytes(path: Path, largest: int, kind: type[InputError], what: str) -> bytes:
    """Return the content of a file of at most `largest` bytes.

    If it cannot be read, an error of class `kind` is raised. Its message begins with `what`, such
    as "the table", and the path.
    """
    try:
        with opened(path, largest) as file:
            return file.read(largest)
    except OSError as error:
        raise kind(f"{what} {path} cannot be read: {error.strerror}") from error


def read_text(path: Path, largest: int, kind: type[InputError], what: str) -> str:
    """Return the text of a file in UTF-8.

    Arguments are those of `read_bytes`. The error is raised also if the file is not in UTF-8.
    """
    content = read_bytes(path, largest, kind, what)
    wide = wide_encoding(content)
    if wide:
        raise kind(f"{what} {path} is text in {wide}; save it as UTF-8")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise kind(f"{what} {path} is not text in UTF-8; save it as UTF-8") from error


def wide_encoding(content: bytes) -> str:
    """Return UTF-16 or UTF-32 if a text file has that encoding, else an empty text.

    `content` is the whole file, or its beginning.
    """
    if content[:4] in (codecs.BOM_UTF32_LE, codecs.BOM_UTF32_BE):
        return "UTF-32"
    head = content[:400]
    fewer, more = sorted((head[::2].count(0), head[1::2].count(0)))
    plain = len(head) > 8 and not fewer and more > 0.45 * len(head)
    return (
        "UTF-16"
        if plain or (head[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
        else ""
    )


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file as 64 hexadecimal digits; OSError as of `opened`."""
    with opened(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()  # type: ignore[arg-type]


def make_folder(path: Path) -> Path:
    """Make a folder with its parents and return it.

    OutputError if the folder cannot be made, or if no file can be written in it.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=path).close()
    except OSError as error:
        raise cannot_write(path, error) from error
    return path


def temporary_prefix() -> str:
    """Return how the names of this process's temporary files begin.

    They end with .tmp. `sweep` recognises such names.
    """
    return f".archfrag-{_HOST}-{os.getpid()}-"


def temporary_folder(place: Path) -> "tempfile.TemporaryDirectory[str]":
    """Make a temporary folder in `place` that is removed when its ``with`` block ends.

    If the process is killed, `sweep` removes it.
    """
    return tempfile.TemporaryDirectory(".tmp", temporary_prefix(), place, True)


def sweep(folder: Path) -> None:
    """Remove the temporary files and folders of killed processes anywhere below a folder.

    Their names state host and process. They are removed if the process is gone from this host, or
    if they are older than 30 days.
    """
    for entry in list(folder.rglob("*")):
        found = re.fullmatch(_TEMPORARY, entry.name)
        if found is None or entry.is_symlink():
            continue
        with contextlib.suppress(OSError):
            gone = time.time() - entry.stat().st_mtime > _SURELY_LEFT
            if found["host"] == _HOST:
                gone = gone or not is_alive(int(found["pid"]))
            if gone:
                shutil.rmtree(entry) if entry.is_dir() else entry.unlink()


def _registers(path: Path) -> list[Path]:
    """Return the paths of the lists that hold the SHA-256 of files made by archfrag.

    One list is in the hidden folder beside `path`, the other in the user's folder for states of
    programs.
    """
    from platformdirs import user_state_path  # start-up

    user = user_state_path("archfrag") / MADE
    return [path.parent / WORK / MADE, *([user] if user.is_absolute() else [])]


def register(path: Path, content: Path) -> None:
    """Add the SHA-256 of a new file to the lists of what archfrag made.

    So the file may be replaced later. It will stand at `path`; `content` is a file with its bytes.
    A file in a hidden folder is not listed.
    """
    if WORK in path.parts:  # where nothing is of anybody else
        return
    for place in _registers(path):
        with contextlib.suppress(OSError):
            if place.parent.name != WORK:
                place.parent.mkdir(parents=True, exist_ok=True)
            with open_to_append(place) as file:
                # Else it has another name as well.
                if os.fstat(file.fileno()).st_nlink == 1:
                    file.write(f"{sha256_of(content)}\n".encode())


def _is_listed(path: Path, *places: Path) -> bool:
    """Return whether the SHA-256 of a file is in one of the lists at `places`."""
    lists = b""
    for place in places:
        with contextlib.suppress(OSError), opened(place) as file:
            lists += file.read()
    with contextlib.suppress(OSError):
        return sha256_of(path).encode() in lists
    return False


def check_targets(
    targets: Iterable[str | Path | None],
    inputs: Iterable[str | Path | None] = (),
    of_study: bool = False,
) -> None:
    """Check that writing `targets` replaces no input and no file that archfrag did not make.

    Results of a study may be replaced only if `of_study` is true. Each target must be another
    place; None stands for no target. OutputError names the first target that is refused.
    """
    given = [each for each in inputs if each and os.path.exists(each)]
    seen = set[str]()
    for path in (Path(target) for target in targets if target is not None):
        real = os.path.realpath(path)
        why = ""
        stamps = path.parent / WORK / STAMPS
        if real in seen:
            why = "the place of another output too"
        elif any(path.exists() and path.samefile(each) for each in given):
            why = "an input of this command"
        elif path.is_symlink() or (path.exists() and not path.is_file()):
            why = "a link, a folder or a device"
        elif path.exists() and WORK not in path.parts:  # where all is archfrag's
            if _is_listed(path, stamps):
                why = "" if of_study else "a result of the study in this folder"
            elif not _is_listed(path, *_registers(path)):
                why = "not a file that archfrag wrote, or has changed since"
        if why:
            raise OutputError(
                f"{path}: is {why}, so archfrag does not replace it; name another place, or move "
                "it away"
            )
        seen.add(real)


@contextlib.contextmanager
def replacing(path: Path, lasting: bool = True) -> Iterator[Path]:
    """Give the path of a temporary file that replaces `path` when the block ends without an error.

    The temporary file is in the hidden folder of a study beside `path`, or else in the same
    folder. If `lasting`, its bytes are on the disk before it is renamed. If not, the file is
    complete after a kill, but perhaps not after a power cut. An OSError in the block becomes an
    OutputError; `path` is then as it was.
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
        register(path, temporary)
        replace(temporary, path)
    except OSError as error:
        raise cannot_write(path, error) from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


def quoted(cell):
    """Return a cell of a CSV; put an apostrophe before text that a spreadsheet would compute."""
    if isinstance(cell, str) and _FORMULA.match(cell) and not _NUMBER.fullmatch(cell):
        return f"'{cell}"
    return cell


def unquoted(cell: str) -> str:
    """Return a cell as it was before `quoted`."""
    return cell[1:] if cell[:1] == "'" and _FORMULA.match(cell, 1) else cell


def write_csv(target: Path, pieces: "Iterable[pd.DataFrame]", **form) -> None:
    """Write a table as CSV, completely or not at all.

    The table is given in pieces with the same columns. `form` is handed to
    `pandas.DataFrame.to_csv`.
    """
    form |= {"index": False, "lineterminator": "\n"}
    digits = form.get("float_format")
    with (
        replacing(target) as part,
        part.open("w", encoding="utf-8", newline="") as file,
    ):
        for number, piece in enumerate(pieces):
            table = piece.rename(columns=quoted)
            new = table.select_dtypes(exclude=["number", "bool"]).astype(object)
            for name, column in new.items():
                if any(quoted(each) is not each for each in column.unique()):
                    new[name] = column.map(quoted)
            if digits:  # which pandas takes three times as long for
                for name, column in table.select_dtypes("float").items():
                    cells = column.tolist()
                    new[name] = [digits % x if x == x else "" for x in cells]
            table.assign(**new).to_csv(file, header=number == 0, **form)


Row = tuple[int, list[str]]  # number of the line, cells
NAMES = {",": "commas", ";": "semicolons", "\t": "tabs", " ": "blanks"}
_COMMA = re.compile(r"[-+]?\d+(,\d+)+(\.\d*)?([eE][-+]?\d+)?")
_POINT = re.compile(r"[-+]?\d*\.\d*([eE][-+]?\d+)?")
_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2}\.\d{3}")
_SHORT = re.compile(r"[-+]?([1-9]\d{0,2}\.\d{3}|\d{1,3})")
_INTEGER = re.compile(r"[-+]?\d+")
_THREE = re.compile(r"\d{3}(\.\d*)?")
_ROUNDED = re.compile(
    r"[1-9]\d*(\.\d{1,3})?"
)  # at least 1, with at most three decimals


def separator_of(lines: Iterable[str]) -> str:
    """Return the separator of the cells in some lines: semicolon, tab or comma, else a blank.

    Semicolons or commas must be in at least half of the lines, tabs in all of them.
    """
    rows = [line for line in lines if line.strip()]
    for mark, least in ((";", 0.5), ("\t", 1.0), (",", 0.5)):
        if rows and sum(mark in row for row in rows) >= least * len(rows):
            return mark
    return " "


def cells_of(lines: Iterable[tuple[int, str]], separator: str) -> list[Row]:
    """Split lines at the separator; return the number of each line and its cells.

    Empty lines are left out, and so are empty columns at the right end.
    """
    rows = []
    for number, line in lines:
        if separator == " ":
            cells = re.split(r"[ \t]+", line.strip(" \t\r"))
        elif '"' in line:
            cells = next(
                csv.reader([line], delimiter=separator, skipinitialspace=True), []
            )
        else:
            cells = line.split(separator)
        cells = [cell.strip(" \t\r") for cell in cells]
        if any(cells):
            rows.append((number, cells))
    while rows and all(len(cells) > 1 and not cells[-1] for _, cells in rows):
        rows = [(number, cells[:-1]) for number, cells in rows]
    return rows


def check_counts(rows: Sequence[Row], separator: str, count: int | None = None) -> None:
    """Raise InputError for the first row that does not have `count` cells.

    If `count` is None, it is the number of cells that most rows have.
    """
    if count is None and rows:
        ((count, _),) = Counter(len(cells) for _, cells in rows).most_common(1)
    for number, cells in rows:
        found = len(cells)
        if found != count:
            what = f"{found} of {count} cells, {NAMES[separator]} between"
            if count is not None and found > count:
                what = f"{found} cells, the other rows have {count}"
            raise InputError(
                f"line {number} has {what}: {', '.join(cells)[:60]!r}; a row is cut, or a comma, "
                "blank or other sign stands within a number"
            )


def check_decimals(cells: Iterable[tuple[int, str]]) -> None:
    """Raise InputError for the first cell that has a comma within a number.

    Such a comma is a decimal comma, or separates thousands.
    """
    for number, cell in cells:
        if _COMMA.fullmatch(cell):
            raise InputError(
                f"line {number}: {cell!r} has a comma within a number; write decimal points, "
                "and no separators of thousands"
            )


def check_thousands(cells: Sequence[str], name: str) -> None:
    """Raise InputError if points may separate thousands in a column, as in 1.193 beside 980."""
    dotted = [cell for cell in cells if "." in cell]
    whole = next((cell for cell in cells if "." not in cell), None)
    if dotted and whole and all(map(_SHORT.fullmatch, cells)):
        both = f"{dotted[0]} beside {whole}: do its points separate thousands?"
        raise _ambiguous(name, both, dotted[0])


def check_one_number(rows: Sequence[Row], column: int, separator: str) -> None:
    """Raise InputError if the separator seems to cut each number in two, as it would 1,193.5.

    The two parts would be in `column` and in the next column. A cut 1 193.5 or 0,123 is found as
    well.
    """
    pairs = [cells[column : column + 2] for _, cells in rows]
    if not all(len(pair) == 2 and _INTEGER.fullmatch(pair[0]) for pair in pairs):
        return
    rest = {other for _, other in pairs}
    thousands = separator in ", " and all(map(_THREE.fullmatch, rest))
    decimals = (
        separator == ","
        and all(map(str.isdecimal, rest))
        and len(set(map(len, rest))) == 1
    )
    if len(rest) > 2 and (thousands or decimals):
        raise InputError(
            f"line {rows[0][0]}: {pairs[0][0]!r} and {pairs[0][1]!r} may be one number: "
            f"{NAMES[separator]} are between the cells; put another sign there"
        )


def check_years(cells: Sequence[str], name: str) -> None:
    """Raise InputError if points may separate thousands in return periods, as in 1.000."""
    check_thousands(cells, name)
    dotted = [cell for cell in cells if _THOUSANDS.fullmatch(cell)]
    short = all(map(_ROUNDED.fullmatch, cells)) and max(map(float, cells)) < 100.0
    if dotted and (len(dotted) == len(cells) or short):
        what = f"{', '.join(cells[:3])}: years, or thousands of years?"
        raise _ambiguous(name, what, dotted[0])


def _ambiguous(name: str, found: str, cell: str) -> InputError:
    return InputError(
        f"column {name!r} has {found} Write {cell.replace('.', '')} or {cell}0 for {cell}"
    )


def with_points(rows: Sequence[Row], separator: str) -> list[Row]:
    """Return the rows with decimal commas replaced by points.

    InputError if the file has decimal commas beside points, or if commas also separate cells or
    thousands.
    """
    cells = [(number, cell) for number, row in rows for cell in row]
    commas = [each for each in cells if _COMMA.fullmatch(each[1])]
    point = next((each for each in cells if _POINT.fullmatch(each[1])), None)
    if separator == "," or any(
        cell.count(",") > 1 or "." in cell for _, cell in commas
    ):
        check_decimals(commas)
    if commas and point:
        line, cell = commas[0]
        other, its = point
        raise InputError(
            f"{cell!r} in line {line} has a comma, {its!r} in line {other} a point: one of the "
            "two must be the decimal in the whole file"
        )
    return [
        (
            number,
            [
                cell.replace(",", ".") if _COMMA.fullmatch(cell) else cell
                for cell in row
            ],
        )
        for number, row in rows
    ]


def parse_table(text: str, comments: bool = True) -> tuple[list[str], list[Row]]:
    """Split the text of a table into its column names and its rows, with decimal points.

    The first line gives separator and names. Lines that begin with # are left out if `comments` is
    true; empty rows and Excel's line ``sep=;`` always. InputError if a row has more or fewer cells
    than the first line, if a name is missing or there twice, or for commas as in `with_points`.
    """
    if comments:
        text = re.sub(r"^#.*$", "", text, flags=re.MULTILINE)
    text = re.sub(r'(?i)\A\s*"?sep=."?(?=\r?\n)', "", text)
    separator = separator_of([next(filter(str.strip, text.splitlines()), "")]).replace(
        " ", ","
    )
    rows = list[Row]()
    reader = csv.reader(
        io.StringIO(text, newline=""), delimiter=separator, skipinitialspace=True
    )
    try:
        for row in reader:
            cells = list(map(str.strip, row))
            if any(cells):
                rows.append((reader.line_num, cells))
    except csv.Error as error:
        raise InputError(f"is not a table in CSV ({error})") from None
    if not rows:
        raise InputError("is not a table in CSV (No columns in it)")
    (head, names), *rows = rows
    kept = max((i for i, name in enumerate(names, 1) if name), default=0)
    # Spreadsheets may write empty cells beyond the last column.
    rows = [
        (number, cells if any(cells[kept:]) else cells[:kept]) for number, cells in rows
    ]
    names = names[:kept]
    for name, times in Counter(names).items():
        if times > 1 or not name:
            what = f"column {name!r} is there twice" if name else "a column has no name"
            raise InputError(f"line {head}: {what}; give each column a name of its own")
    check_counts(rows, separator, kept)
    return names, with_points(rows, separator)


def table_of(text: str) -> "pd.DataFrame":
    """Return a table as a DataFrame of text cells, indexed by the numbers of the lines.

    The text is split by `parse_table`.
    """
    import pandas as pd  # takes a third of a second

    names, rows = parse_table(text)
    lines, cells = zip(*rows) if rows else ((), None)
    return pd.DataFrame(cells, lines, names, dtype=str)
