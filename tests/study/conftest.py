"""One small batch for all tests of parts, cube and fits: starting workers takes seconds."""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass

import pytest

from archfrag.study.batch import BatchLog, run_batch
from archfrag.study.config import Study, load_study
from archfrag.study.plan import Plan, make_plan
from archfrag.study.records import prepare_motions
from tests.study.small import in_process, small_study


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
    log = run_batch(study, workers=2, quiet=True)
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


@pytest.fixture
def here():
    """Batches run in this process: no workers are started, all else is as it is."""
    with in_process():
        yield
