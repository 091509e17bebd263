"""Content of files and values as SHA-256; quick to import: only the standard library."""

import hashlib
import json
from pathlib import Path
from typing import Any

import archfrag

PACKAGE = Path(archfrag.__file__).resolve().parent


def canonical_json(value: Any) -> str:
    """One text for one value: sorted keys, no spaces, floats to their last bit."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=False)


def digest_of(value: Any) -> str:
    """SHA-256 of a value that JSON knows, 64 hexadecimal digits."""
    return hashlib.sha256(canonical_json(value).encode("utf-8", "surrogateescape")).hexdigest()


def sha256_of(path: Path) -> str:
    """SHA-256 of a file, 64 hexadecimal digits."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def sha256_if_there(path: Path | str) -> str | None:
    """SHA-256 of a file; None if there is none that can be read."""
    try:
        return sha256_of(Path(path))
    except (OSError, ValueError):
        return None


def source_hash(*names: str) -> str:
    """Hash of some of the package's files and folders: an edit makes results out of date."""
    digest = hashlib.sha256()
    for name in names:
        place = PACKAGE / name
        for path in sorted(place.rglob("*")) if place.is_dir() else [place]:
            if path.is_file() and path.suffix != ".pyc":
                digest.update(str(path.relative_to(PACKAGE)).encode())
                digest.update(path.read_bytes())
    return digest.hexdigest()[:16]
