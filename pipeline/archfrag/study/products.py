"""The steps of a study, the files that each makes, and that these replace nothing of others."""

from collections import Counter
from collections.abc import Iterable
from pathlib import Path

from archfrag.files import check_targets
from archfrag.study.file.members import SHOWN
from archfrag.study.file.prepared import MANIFEST
from archfrag.study.file.schema import StudyKeys
from archfrag.study.provenance import CUBE, refuse_foreign_cube

README = "README.txt"
REPORT_FILES = ("report.html", "summary.json", "capacities.csv", "runs.csv", README)
ALL_CURVES = "curves.svg"  # of many arches, in the place of a figure of each


def batch_step(batch: int, batches: int) -> str:
    """Name of the step that makes the runs of one of several batches."""
    return f"batch-{batch}of{batches}"


def step_names(study: StudyKeys) -> list[str]:
    """Return all steps of a study in their order."""
    count = study.execution.batches
    return [
        "motions",
        *(batch_step(i, count) for i in range(count)),
        "cube",
        "fit",
        "report",
    ]


def products(study: StudyKeys, step: str) -> list[Path]:
    """Return the files that a step makes; parts of runs have checks of their own."""
    if step.startswith("batch"):  # a table of its runs, with how long each took
        return [study.work / "runs" / f"{step}.csv"]
    if step == "motions":
        return [study.work / MANIFEST]
    names = {
        "cube": [CUBE],
        "fit": ["fits.json", "curve.csv"],
        "report": [*REPORT_FILES],
    }
    if step == "report":
        ids = [member.id for member in study.members]
        sizes = Counter(member.arch_class for member in study.members)
        drawn = [name for name, size in sizes.items() if size > 1]
        names[step] += [ALL_CURVES] * (len(ids) > SHOWN)
        names[step] += [
            f"curve-{each}.svg" for each in drawn + ids * (len(ids) <= SHOWN)
        ]
    return [study.folder / name for name in names[step]]


def check_outputs(study: StudyKeys, steps: Iterable[str]) -> None:
    """See that the files of steps replace none of the study's inputs, and no file of others.

    A README of somebody else stays as it is, and a cube of this study may be damaged.
    """
    refuse_foreign_cube(study)
    given = [each for entry in study.arches for each in (entry.table, entry.drawing)]
    given += [
        study.motions.index,
        study.report.logo,
        study.risk.hazard if study.risk else None,
    ]
    made = (path for step in steps for path in products(study, step))
    targets = [path for path in made if path.name not in (README, CUBE)]
    check_targets(targets, given, of_study=True)
