"""What can be known to be wrong with a study before anything is computed."""

from dataclasses import dataclass

from archfrag.errors import OutputError, StabilityError, StudyError
from archfrag.study.config import Study, load_study
from archfrag.study.cube import refuse_foreign_cube
from archfrag.study.files import make_folder
from archfrag.study.records import read_sources, scale_factors

STUDY_FILE = "study.yaml"


def check_arches(study: Study) -> None:
    """See that all arches of a study stand under their own weight.

    Raises
    ------
    StabilityError
        Naming the first that does not.
    """
    from archfrag.simulate import onset

    for i, entry in enumerate(study.arches):
        if not onset(entry.build()).stands:
            raise StabilityError(
                f"arches[{i}] ({entry.id}): does not stand under its own weight; make it thicker "
                "or raise the friction"
            )


def check_output(study: Study) -> None:
    """See that the output folder can be written and is no other study's.

    Raises
    ------
    OutputError
        Naming the folder, and the other study.
    """
    refuse_foreign_cube(study)
    make_folder(study.folder)
    resolved = study.folder / STUDY_FILE
    if not resolved.exists():
        return
    try:
        owner = load_study(resolved).id
    except StudyError:
        return
    if owner != study.id:
        raise OutputError(
            f"{study.folder}: holds results of study {owner!r}, in the way of study {study.id!r}; "
            "give the studies different output folders"
        )


@dataclass(frozen=True)
class Summary:
    """What a study amounts to."""

    study: str
    arches: int
    records: int
    levels: int
    runs: int


def check_study(study: Study) -> Summary:
    """Check all of a study without running it: arches stand, records are read and scaled.

    Raises
    ------
    StudyError, RecordError, StabilityError, OutputError
        With the first thing that is wrong.
    """
    check_arches(study)
    records = 0
    for motion in read_sources(study):
        scale_factors(motion, study)
        records += 1
    if not records:
        raise StudyError("motions: the study has no record")
    check_output(study)
    arches, levels = len(study.arches), len(study.intensity.si)
    return Summary(study.id, arches, records, levels, arches * records * levels)
