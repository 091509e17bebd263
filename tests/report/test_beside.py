"""A part of a page made in a second process: the same answer, and an answer whatever happens."""

import os
import sys

import pytest

from archfrag.report import beside
from archfrag.report.beside import Beside


@pytest.fixture(params=[True, False], ids=["two cores", "one core"])
def cores(request, monkeypatch):
    if request.param and sys.platform != "linux":
        pytest.skip("a second process is for Linux only")
    monkeypatch.setattr(beside, "_has_second_core", lambda: request.param)
    return 2 if request.param else 1


def test_the_answer_comes_back_from_a_process_of_its_own(cores):
    answer, process = Beside(lambda a, b: (a + b, os.getpid()), 2, 3).result()
    assert answer == 5
    assert (process == os.getpid()) == (cores == 1)


def test_an_error_is_raised_as_it_would_be_here(cores):
    with pytest.raises(KeyError, match="odd"):
        Beside({}.__getitem__, "odd").result()


def test_a_process_that_ends_or_does_not_answer_costs_nothing_but_time(cores, monkeypatch):
    here = os.getpid()
    monkeypatch.setattr(beside, "PATIENCE", 0.2)

    def end():
        if os.getpid() != here:
            os._exit(9)
        return "made here"

    def wait():
        import time

        if os.getpid() != here:
            time.sleep(60.0)
        return "made here"

    assert Beside(end).result() == "made here"
    assert Beside(wait).result() == "made here"
