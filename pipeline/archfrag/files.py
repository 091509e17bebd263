"""Files of all kinds: read, written at once or not at all, and tables of CSV text in them."""

import codecs
import contextlib
import csv
import hashlib
import io
import multiprocessing
import os
import re
import secrets
import shutil
import socket
import stat
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from archfrag.errors import InputError, OutputError

if TYPE_CHECKING:
    import pandas as pd

Named = dict[str, Any]  # values by their names
WORK = ".archfrag"  # in the folder of a study's results: all that is not for people
STAMPS = "stamp.json"  # SHA-256 of a study's files; of all that archfrag wrote
MADE = "made.txt"
_HOST = re.sub(r"\W", "_", socket.gethostname())
# Temporary names give host and process, so that what a killed process left can be recognised.
_TEMPORARY = r"\.archfrag-(?P<host>\w+)-(?P<pid>[0-9]{1,9})-[a-z0-9_]{8}\.tmp"
_SURELY_LEFT = (
    30 * 86400.0
)  # age at which no process can be at work on a temporary file [s]
# Characters that a terminal obeys, or that change the direction of the text around them.
_OBEYED = r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]"
_FORMULA = re.compile(
    r"[=+\-@\t\r]"
)  # first characters of a cell that a spreadsheet computes
WHOLE = r"[-+]?(0|[1-9][0-9]*)"  # of YAML 1.2, but for 010, which YAML 1.1 takes for 8
REAL = rf"({WHOLE}(\.[0-9]*)?|[-+]?\.[0-9]+)([eE][-+]?[0-9]+)?"
NUMBERS = "write digits with a decimal point, such as 10, 0.5 or 2e-3"
_NUMBER = re.compile(REAL)


def counted(number: int, noun: str) -> str:
    """Return a number of things: 1 arch, 2 arches."""
    plural = "es" if noun.endswith("ch") else "s"
    return f"{number} {noun}{plural * (number != 1)}"


def number(text: str) -> float:
    """Return the number that a text of a table, option or key is; ValueError if it is none.

    Python would also take 1_0 for 10 and nan, YAML 1.1 1:30 for 90 and 010 for 8. inf is one.
    """
    plain = text.strip()
    if _NUMBER.fullmatch(plain) or plain.lstrip("+-") == "inf":
        return float(plain)
    raise ValueError(f"could not convert string to a number: {plain[:60]!r}; {NUMBERS}")


def stated_unit(head: str) -> tuple[str, str | None]:
    """Split the name of a column, `name [unit]` or `name (unit)`; None if it states no unit."""
    found = re.fullmatch(r"(.+?)\s*[\[(]\s*([^\[\]()]*?)\s*[\])]", head.strip())
    return (found[1], found[2]) if found else (head, None)


def absolute(path: str, folder: Path) -> str:
    """Make a path of a study file absolute, whose folder is given."""
    return os.path.abspath(os.path.join(folder, os.path.expanduser(path)))


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
    return re.sub(_OBEYED, lambda found: f"\\u{ord(found[0]):04x}", text)


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
            raise OSError(
                0, f"it has {state.st_size} bytes; at most {largest:.0f} are allowed"
            )
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
    wide = wide_encoding(content)
    if wide:
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
    return (
        "UTF-16"
        if plain or (head[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
        else ""
    )


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file, 64 hexadecimal digits; a pipe or device is not waited for."""
    with opened(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()  # type: ignore[arg-type]


def end_with_parent() -> None:
    """End this process of `multiprocessing` when the one that started it is gone."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
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
        found = re.fullmatch(_TEMPORARY, entry.name)
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


def _registers(path: Path) -> list[Path]:
    """Return where the SHA-256 of what archfrag made stands: beside a study, and of the user."""
    from platformdirs import user_state_path  # start-up

    user = user_state_path("archfrag") / MADE
    return [path.parent / WORK / MADE, *([user] if user.is_absolute() else [])]


def register(path: Path, content: Path) -> None:
    """Note that archfrag makes the file `path` of this `content`, so that it may replace it."""
    if WORK in path.parts:  # where nothing is of anybody else
        return
    flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK
    for place in _registers(path):
        with contextlib.suppress(OSError):
            if place.parent.name != WORK:
                place.parent.mkdir(parents=True, exist_ok=True)
            with open(os.open(place, flags, 0o666), "ab") as file:
                # Else it has another name as well.
                if os.fstat(file.fileno()).st_nlink == 1:
                    file.write(f"{sha256_of(content)}\n".encode())


def _is_listed(path: Path, *places: Path) -> bool:
    """Tell whether some lists of SHA-256 have that of a file."""
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
    """See that files to be written replace no input and nothing that archfrag did not make.

    Nor what a study made, unless they are `of_study`. OutputError names the first that does.
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
        register(path, temporary)
        os.replace(temporary, path)
    except OSError as error:
        raise cannot_write(path, error) from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


def quoted(cell):
    """Return a cell of a CSV: text that a spreadsheet would compute gets an apostrophe before
    it.
    """
    if isinstance(cell, str) and _FORMULA.match(cell) and not _NUMBER.fullmatch(cell):
        return f"'{cell}"
    return cell


def unquoted(cell: str) -> str:
    """Return a cell as it was before `quoted`."""
    return cell[1:] if cell[:1] == "'" and _FORMULA.match(cell, 1) else cell


def write_csv(target: Path, pieces: "Iterable[pd.DataFrame]", **form) -> None:
    """Write a table in pieces of the same columns as CSV, completely or not at all.

    `form` is handed to `pandas.DataFrame.to_csv`.
    """
    form |= {"index": False, "lineterminator": "\n"}
    with (
        replacing(target) as part,
        part.open("w", encoding="utf-8", newline="") as file,
    ):
        for number, piece in enumerate(pieces):
            table = piece.rename(columns=quoted)
            texts = table.select_dtypes(exclude=["number", "bool"])
            table = table.assign(**texts.astype(object).map(quoted))
            table.to_csv(file, header=number == 0, **form)


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
    """Return what separates the cells of some lines: semicolons, tabs, commas, else blanks."""
    rows = [line for line in lines if line.strip()]
    for mark, least in ((";", 0.5), ("\t", 1.0), (",", 0.5)):
        if rows and sum(mark in row for row in rows) >= least * len(rows):
            return mark
    return " "


def cells_of(lines: Iterable[tuple[int, str]], separator: str) -> list[Row]:
    """Split lines, each with its number, at the separator.

    Lines without a character are left out, as are columns at the right end that are empty.
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
    """Raise InputError for the first row that has other than `count` cells, or than most have."""
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
    """Raise InputError for a comma within a number: it is a decimal or separates thousands."""
    for number, cell in cells:
        if _COMMA.fullmatch(cell):
            raise InputError(
                f"line {number}: {cell!r} has a comma within a number; write decimal points, "
                "and no separators of thousands"
            )


def check_thousands(cells: Sequence[str], name: str) -> None:
    """Raise InputError for a column whose points may separate thousands: 1.193 beside 980."""
    dotted = [cell for cell in cells if "." in cell]
    whole = next((cell for cell in cells if "." not in cell), None)
    if dotted and whole and all(map(_SHORT.fullmatch, cells)):
        both = f"{dotted[0]} beside {whole}: do its points separate thousands?"
        raise _ambiguous(name, both, dotted[0])


def check_one_number(rows: Sequence[Row], column: int, separator: str) -> None:
    """Raise InputError if a separator stands within each number: 1,193.5 or 1 193.5 or 0,123."""
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
    """Refuse separators of thousands in return periods, such as 1.000, 2.475 and 5.000."""
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
    """Replace decimal commas by points; InputError if a file has both, or commas between cells."""
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


def parse_table(text: str, comments: bool = True) -> tuple[str, list[str], list[Row]]:
    """Split a table: the separator of its first line, the names in it, and its rows.

    Lines that begin with # are left out if they are `comments`, and so are rows without a cell.
    InputError for a row with more or fewer cells than the first line, and a name that is missing
    or there twice.
    """
    if comments:
        text = re.sub(r"^#.*$", "", text, flags=re.MULTILINE)
    text = re.sub(r"(?i)\A\s*sep=.(?=\r?\n)", "", text)  # of Excel
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
    return separator, names, rows


def table_of(text: str, commas: bool = True) -> "pd.DataFrame":
    """Return the cells of a table (`parse_table`) as text, by the numbers of their lines.

    Decimal commas become points, or are refused if `commas` are not allowed.
    """
    import pandas as pd  # takes a third of a second

    separator, names, rows = parse_table(text)
    if commas:
        rows = with_points(rows, separator)
    else:
        check_decimals((line, cell) for line, cells in rows for cell in cells)
    lines, cells = zip(*rows) if rows else ((), None)
    return pd.DataFrame(cells, lines, names, dtype=str)
