"""A study to start from, with the motions that archfrag ships."""

import os
import shutil
import tempfile
from pathlib import Path

from archfrag.errors import OutputError
from archfrag.files import cannot_write, make_folder
from archfrag.study.config import study_schema
from archfrag.study.files import PACKAGE
from archfrag.study.workflow import shipped_folder

STUDY = "study.yaml"
SCHEMA = "study.schema.json"
RECORDS = "records"


def write_starter(folder: Path) -> Path:
    """Write a commented study file, its schema and the shipped motions.

    Parameters
    ----------
    folder : Path
        Made if it is missing.

    Returns
    -------
    Path
        The study file, `folder/study.yaml`.

    Raises
    ------
    OutputError
        If one of the three is there already, or cannot be written; nothing is left behind.

    Examples
    --------
    >>> import tempfile
    >>> write_starter(Path(tempfile.mkdtemp())).name
    'study.yaml'
    """
    folder = make_folder(folder)
    for name in (RECORDS, SCHEMA, STUDY):
        if os.path.lexists(folder / name):
            raise OutputError(f"{folder / name}: is there already; allowed is a folder without it")
    placed = []
    try:
        with tempfile.TemporaryDirectory(dir=folder, prefix=".init") as temporary:
            made = Path(temporary)
            shutil.copytree(
                shipped_folder() / RECORDS,
                made / RECORDS,
                ignore=lambda _, names: [n for n in names if n.endswith((".svg", ".py"))],
            )
            (made / SCHEMA).write_text(study_schema())
            shutil.copyfile(PACKAGE / "study" / "templates" / STUDY, made / STUDY)
            for name in (RECORDS, SCHEMA, STUDY):
                os.rename(made / name, folder / name)
                placed.append(folder / name)
    except OSError as error:
        for path in placed:
            shutil.rmtree(path, ignore_errors=True)
            path.unlink(missing_ok=True)
        raise cannot_write(folder, error) from error
    return folder / STUDY
