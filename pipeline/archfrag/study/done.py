"""Whether all of a study is done, told by one digest, before anything heavy is imported."""

import glob
import os
import platform
from collections.abc import Iterable, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from archfrag.files import WORK
from archfrag.study import provenance
from archfrag.study.yaml_text import absolute, read_keys

if TYPE_CHECKING:
    from archfrag.study.file.schema import StudyKeys


def finished_folder(path: Path, overrides: Sequence[str]) -> Path | None:
    """Return the folder of the results of a study file if nothing has changed since its run; else
    None.

    None says little: the steps tell what is to be made again.
    """
    keys, home = read_keys(path, overrides)
    output = keys.get("output") or os.path.join("results", str(keys.get("id")))
    folder = Path(absolute(str(output), home))
    try:
        known = dict(provenance.read_state(folder / WORK / provenance.STAMPS)["all"])
        current = known["digest"] == _digest(path, keys, known["watched"])
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return folder if current else None


def stamp_of_all(
    study: "StudyKeys",
    path: Path,
    overrides: Sequence[str],
    inputs: Mapping[str, Sequence[Path]],
    made: Iterable[Path],
) -> dict[str, Any]:
    """Return what `finished_folder` compares: files read and made, and folders that may get more.

    Empty if folders of records are found by a pattern: new ones may appear anywhere.
    """
    asked = [entry.path for entry in study.motions.files]
    if any(glob.has_magic(os.path.dirname(each)) for each in asked):
        return {}
    given = [each for entry in study.arches for each in (entry.table, entry.drawing)]
    given += [study.report.logo, study.risk.hazard if study.risk else None]
    folders = (each.parent for each in inputs["record"])
    every = chain(*inputs.values(), folders, asked, given, made)
    watched = sorted({str(each) for each in every if each})
    return {
        "watched": watched,
        "digest": _digest(path, read_keys(path, overrides)[0], watched),
    }


def _digest(path: Path, keys: dict[str, Any], watched: Sequence[str]) -> str:
    """Return the digest of a study file and its keys, of the code, and of what is in files and
    folders.
    """
    found = {
        place: sorted(os.listdir(place))
        if os.path.isdir(place)
        else provenance.sha256_if_there(place)
        for place in watched
    }
    return provenance.digest_of(
        [
            os.path.realpath(path),
            os.path.expanduser("~"),
            keys,
            provenance.digest_of_code("**/*"),
            provenance.versions(),
            platform.machine(),
            found,
        ]
    )
