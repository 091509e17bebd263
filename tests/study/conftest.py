"""One small batch for all tests of parts, cube and fits: starting workers takes seconds."""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass

import pytest

from archfrag.study.file.records import prepare_motions
from archfrag.study.file.schema import Study, load_study
from archfrag.study.runs.execute import BatchLog
from archfrag.study.runs.store import Plan, make_plan
from tests.study.small import make_runs, small_study


@dataclass(frozen=True)
class Done:
    """A study whose parts are all there."""

    study: Study
    plan: Plan
    log: BatchLog


@pytest.fixture(scope="session")
def done(tmp_path_factory) -> Done:
    """Treat as read-only; `copied` gives a copy to spoil."""
    study = load_study(small_study(tmp_path_factory.mktemp("done")))
    prepare_motions(study)
    log = make_runs(study)
    return Done(study, make_plan(study), log)


@pytest.fixture
def copied(done, tmp_path) -> Done:
    """The same study with the same records and parts in a folder of its own."""
    import shutil

    unwanted = shutil.ignore_patterns("cube.nc", "fits.json")
    shutil.copytree(done.study.folder.parent, tmp_path / "copy", ignore=unwanted)
    study = load_study(tmp_path / "copy" / "small.yaml")
    return Done(study, make_plan(study), done.log)


@pytest.fixture
def full_disk(monkeypatch):
    """A disk that fills up at the n-th file made lasting."""

    @contextlib.contextmanager
    def fill(at: int) -> Iterator[None]:
        import errno
        import os

        made = 0

        def fsync(handle: int) -> None:
            nonlocal made
            made += 1
            if made >= at:
                raise OSError(errno.ENOSPC, "No space left on device")

        with monkeypatch.context() as patch:
            patch.setattr(os, "fsync", fsync)
            yield

    return fill
