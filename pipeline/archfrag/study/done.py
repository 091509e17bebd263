"""Whether all of a study is done, told by one digest, before anything heavy is imported."""

import os
import platform
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from archfrag.files import WORK
from archfrag.study import files
from archfrag.study.text import absolute, read_keys


def digest_of_study(path: Path, keys: dict[str, Any], watched: Sequence[str]) -> str:
    """Digest of a study file and its keys, of the code, and of what is in files and folders."""
    found = {
        place: sorted(os.listdir(place)) if os.path.isdir(place) else files.sha256_if_there(place)
        for place in watched
    }
    return files.digest_of([
        os.path.realpath(path), os.path.expanduser("~"), keys, files.digest_of_code("**/*"),
        files.versions(), platform.machine(), found,
    ])  # fmt: skip


def finished_folder(path: Path, overrides: Sequence[str]) -> Path | None:
    """Folder of the results of a study file if nothing has changed since its run; else None.

    None says little: the steps tell what is to be made again.
    """
    keys, home = read_keys(path, overrides)
    output = keys.get("output") or os.path.join("results", str(keys.get("id")))
    folder = Path(absolute(str(output), home))
    try:
        known = dict(files.read_stamps(folder / WORK)["all"])
        current = known["digest"] == digest_of_study(path, keys, known["watched"])
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return folder if current else None


def write_digest(work: Path, digest: str, watched: Sequence[str]) -> None:
    """Note in the stamp of a study that all of it is done."""
    stamps = files.read_stamps(work) | {"all": {"digest": digest, "watched": list(watched)}}
    files.write_text(work / files.STAMPS, files.canonical_json(stamps) + "\n")
