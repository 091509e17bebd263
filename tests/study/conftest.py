"""One small batch for all tests of parts, cube and fits: starting workers takes seconds."""

import shutil
from typing import NamedTuple

import pytest

from archfrag.study.file.prepared import prepare_motions
from archfrag.study.file.schema import StudyKeys, load_study
from archfrag.study.runs.store import Plan, make_plan
from tests.study.small import make_runs, small_study


class Done(NamedTuple):
    study: StudyKeys
    plan: Plan


@pytest.fixture(scope="session")
def done(tmp_path_factory) -> Done:
    """Treat as read-only; `copied` gives a copy to spoil."""
    study = load_study(small_study(tmp_path_factory.mktemp("done")))
    prepare_motions(study)
    make_runs(study)
    return Done(study, make_plan(study))


@pytest.fixture
def copied(done, tmp_path) -> Done:
    """The same study with the same records and parts in a folder of its own."""
    answers = shutil.ignore_patterns("cube.nc", "fits.json")
    shutil.copytree(done.study.folder.parent, tmp_path / "copy", ignore=answers)
    study = load_study(tmp_path / "copy" / "small.yaml")
    return Done(study, make_plan(study))
