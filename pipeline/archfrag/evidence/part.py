"""What every part of the evidence is given, and what it hands on."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from archfrag.evidence.run import Places
from archfrag.report.canvas import Picture

Frames = Mapping[str, pd.DataFrame]


@dataclass(frozen=True)
class Setup:
    """How a part is to be measured.

    Attributes
    ----------
    quick : bool
        The reduced set: all parts in less than 20 minutes on two cores.
    places : Places
        Where records are.
    workers : int
        Processes for what is not timed.
    peers : tuple of str
        Other people's solvers to run beside ours; those not installed are skipped.
    say : callable
        Takes a line for the user.
    """

    quick: bool
    places: Places
    workers: int = 1
    peers: tuple[str, ...] = ()
    say: Callable[[str], None] = print


class Note(NamedTuple):
    """A table for the page: heads, rows of text, and a sentence above them.

    Cells stand in lines, as figures do, unless they hold `words`, which are wrapped.
    """

    title: str
    text: str
    heads: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()
    words: bool = False


@dataclass(frozen=True)
class Section:
    """What a part shows: all of it made from its tables.

    Attributes
    ----------
    title : str
    lead : sequence of str
        Sentences with the answer, first thing on the page.
    pictures : mapping of str to Picture
        By the name of the SVG file.
    notes : sequence of Note
    """

    title: str
    lead: Sequence[str]
    pictures: Mapping[str, Picture]
    notes: Sequence[Note] = field(default_factory=tuple)


def in_processes(
    function: Callable[..., Any], tasks: Iterable[tuple[Any, ...]], workers: int
) -> list[Any]:
    """Results of ``function(*task)`` in the order of tasks; the order never depends on workers.

    Parameters
    ----------
    function : callable
        At the top level of a module.
    tasks : iterable of tuple
    workers : int
        1: in this process.

    Examples
    --------
    >>> from archfrag.evidence.part import in_processes
    >>> in_processes(pow, [(2, 3), (3, 2)], workers=1)
    [8, 9]
    """
    tasks = list(tasks)
    if workers == 1 or len(tasks) < 2:
        return [function(*task) for task in tasks]
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        return [future.result() for future in [pool.submit(function, *task) for task in tasks]]


def records_folder() -> Path:
    """The shipped records: of the working folder, or else of the checkout this runs from."""
    here = Path("records")
    if here.is_dir():
        return here
    return Path(__file__).parents[3] / "records"
