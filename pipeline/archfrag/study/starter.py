"""A study to start from, and where the Snakefile and the shipped records are."""

import os
import shutil
from pathlib import Path

from archfrag.errors import OutputError
from archfrag.files import cannot_write, make_folder
from archfrag.study.file.schema import study_schema
from archfrag.study.files import PACKAGE

STARTER = ("records", "study.schema.json", "study.yaml")


def shipped_folder() -> Path:
    """Folder with Snakefile, rules and records: the checkout, or one of the installed package."""
    for folder in (PACKAGE.parents[1], PACKAGE / "workflow"):
        if (folder / "Snakefile").is_file() and (folder / "pipeline" / "rules").is_dir():
            return folder
    raise OutputError(f"{PACKAGE}: this installation has no Snakefile; install archfrag again")


def snakefile() -> Path:
    """The Snakefile of the checkout or of the installed package."""
    return shipped_folder() / "Snakefile"


def write_starter(folder: Path) -> Path:
    """Write a commented study file, its schema and the shipped motions; all of it or nothing."""
    records, schema, study = (make_folder(folder) / name for name in STARTER)
    for path in (records, schema, study):
        if os.path.lexists(path):
            raise OutputError(f"{path}: exists already; choose a folder without it")
    try:
        unwanted = shutil.ignore_patterns("*.svg", "*.py")
        shutil.copytree(shipped_folder() / records.name, records, ignore=unwanted)
        schema.write_text(study_schema())
        shutil.copyfile(PACKAGE / "study" / "templates" / study.name, study)
    except OSError as error:
        shutil.rmtree(records, ignore_errors=True)
        for path in (schema, study):
            path.unlink(missing_ok=True)
        raise cannot_write(folder, error) from error
    return study
