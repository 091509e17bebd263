"""Files and folders of results."""

import contextlib
import re
from pathlib import Path

from archfrag.files import cannot_write as cannot_write
from archfrag.files import make_folder as make_folder
from archfrag.files import replacing as replacing

# Temporary names: a dot, the name that the file was to have, and random characters.
_LEFT_OVER = re.compile(
    r"\..+\.(npz|npy|json|csv|nc|html|svg|yaml|xml|parquet)\.[A-Za-z0-9_]+(\.tmp)?"
)


def sweep(folder: Path) -> None:
    """Remove temporary files that a killed run left; nothing else may be at work there."""
    for path in folder.rglob(".*"):
        if _LEFT_OVER.fullmatch(path.name) and path.is_file():
            path.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write a text file whole or not at all, and leave one that holds the text already alone.

    Raises
    ------
    OutputError
    """
    with contextlib.suppress(OSError, UnicodeDecodeError):
        if path.read_text(encoding="utf-8") == text:
            return
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
