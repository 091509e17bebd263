"""A study to start from, and where the Snakefile and the shipped records are."""

import os
import shutil
import tempfile
from pathlib import Path

from archfrag.errors import OutputError
from archfrag.files import cannot_write, make_folder
from archfrag.study.file.schema import study_schema
from archfrag.study.files import PACKAGE

SCHEMA = "study.schema.json"
RECORDS = "records"
STUDY_FILE = "study.yaml"


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
    folder = make_folder(folder)
    for name in (RECORDS, SCHEMA, STUDY_FILE):
        if os.path.lexists(folder / name):
            raise OutputError(f"{folder / name}: is there already; allowed is a folder without it")
    placed = []
    try:
        with tempfile.TemporaryDirectory(dir=folder, prefix=".init") as temporary:
            made = Path(temporary)
            unwanted = shutil.ignore_patterns("*.svg", "*.py")
            shutil.copytree(shipped_folder() / RECORDS, made / RECORDS, ignore=unwanted)
            (made / SCHEMA).write_text(study_schema())
            shutil.copyfile(PACKAGE / "study" / "templates" / STUDY_FILE, made / STUDY_FILE)
            for name in (RECORDS, SCHEMA, STUDY_FILE):
                os.rename(made / name, folder / name)
                placed.append(folder / name)
    except OSError as error:
        for path in placed:
            shutil.rmtree(path, ignore_errors=True)
            path.unlink(missing_ok=True)
        raise cannot_write(folder, error) from error
    return folder / STUDY_FILE
