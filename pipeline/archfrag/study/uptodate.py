"""Whether there is nothing to do, found without loading what runs would need.

A run that leaves all up to date notes every file that this was found from, with its SHA-256. If
all are as they were, so is the finding. In any doubt the steps themselves are asked.
"""

import contextlib
import glob
import json
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import archfrag
from archfrag.kernel_cache import kernel_hash
from archfrag.study import WORK
from archfrag.study.digests import canonical_json, sha256_if_there, source_hash

if TYPE_CHECKING:
    from archfrag.study.config import Study

NOTE = "done.json"


def request_of(study_file: Path, overrides: Sequence[str]) -> dict[str, Any]:
    """All that says what is asked for: the study's text, what its paths follow from, the code."""
    return {
        "file": str(study_file.resolve()),
        "sha256": sha256_if_there(study_file),
        "overrides": list(overrides),
        "folder": os.getcwd(),
        "home": os.path.expanduser("~"),
        "archfrag": archfrag.__version__,
        "source": source_hash(""),
        "kernels": kernel_hash(),
    }


def finished_report(study_file: Path, request: dict[str, Any]) -> Path | None:
    """The report of a study if all is as the last run left it, else None.

    Parameters
    ----------
    study_file : Path
    request : dict
        Of `request_of`.
    """
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError, AttributeError):
        work = _work_folder(study_file, request["overrides"])
        note = json.loads((work / NOTE).read_text(encoding="utf-8"))
        if (
            note["request"] == request
            and (work / "lock").stat().st_size == 0
            and all(_matches(pattern) == found for pattern, found in note["patterns"].items())
            and all(sha256_if_there(path) == digest for path, digest in note["files"].items())
        ):
            return Path(note["report"])
    return None


def note_finished(study: "Study", request: dict[str, Any]) -> None:
    """Note what all results of a study were found to be up to date from.

    Raises
    ------
    OutputError
        If it cannot be written.
    """
    from archfrag.study.arches import file_of
    from archfrag.study.files import write_text
    from archfrag.study.records import MANIFEST, read_manifest
    from archfrag.study.steps import products, stamp_file, step_names

    manifest = read_manifest(study)
    files = {path: digest for kind in manifest["inputs"].values() for path, digest in kind.items()}
    files |= {str(study.work / r["file"]): r["prepared"] for r in manifest["records"] if r["file"]}
    files |= {str(path): sha256_if_there(path) for path in map(file_of, study.arches) if path}
    made = [study.work / MANIFEST]
    for step in step_names(study):
        made += [stamp_file(study, step), *products(study, step)]
    if study.risk is not None:
        made.append(Path(study.risk.hazard))
    files |= {str(path): sha256_if_there(path) for path in made}
    patterns = [entry.path for entry in study.motions.files]
    for folder in {Path(path).parent for path in manifest["inputs"]["record"]}:
        names = (folder / "*.xml", folder / "index.csv", folder.parent / "index.csv")
        patterns += [str(Path(glob.escape(str(p.parent))) / p.name) for p in names]
    note = {
        "request": request,
        "report": str(study.folder / "report.html"),
        "patterns": {pattern: _matches(pattern) for pattern in patterns},
        "files": files,
    }
    write_text(study.work / NOTE, canonical_json(note) + "\n")


def _work_folder(study_file: Path, overrides: Sequence[str]) -> Path:
    """Where the state of a study is, by a look at its file that need not be right."""
    import yaml

    folder = study_file.resolve().parent
    try:
        given = yaml.safe_load(study_file.read_text(encoding="utf-8"))
        output = folder / os.path.expanduser(given.get("output") or f"results/{given['id']}")
        for text in overrides:
            key, _, value = text.partition("=")
            if key.strip() == "output":
                output = Path.cwd() / os.path.expanduser(yaml.safe_load(value))
    except (yaml.YAMLError, RecursionError) as error:
        raise ValueError(str(error)) from error
    return output / WORK


def _matches(pattern: str) -> list[str]:
    """Files that a pattern may mean, and some more: without regard to case, ? for brackets."""
    either = "".join(
        f"[{c.lower()}{c.upper()}]" if c.isalpha() and len(c.lower() + c.upper()) == 2 else c
        for c in re.sub(r"\[!?\]?[^]]*\]", "?", pattern)
    )
    return sorted(glob.glob(either, recursive=True, include_hidden=True))
