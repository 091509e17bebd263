"""Published and independently computed values beside ours: asserted by tests, kept in a table.

A test calls the fixture `validated`; ``pytest --validation-table docs/validation/values.csv``
writes what the tests that ran have found, and without it each test sees that its rows of the
committed table are what it finds.

A run with impacts is chaotic: last bits of its ground motion, which differ between processors,
change its value. Such a value is the median of the runs of `nearby`; its row states their spread
and is held to no less.
"""

import csv
import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

COMMITTED = Path(__file__).parents[2] / "docs" / "validation" / "values.csv"
COLUMNS = (
    "topic",
    "case",
    "quantity",
    "unit",
    "source",
    "reference",
    "ours",
    "spread",
    "difference",
    "tolerance",
    "holds",
    "note",
    "test",
)
KEY = ("topic", "case", "quantity", "source")
NAME = "validated"


def read_table(path: Path = COMMITTED) -> dict[tuple[str, ...], dict[str, str]]:
    """Rows by their key; none if there is no file."""
    if not path.is_file():
        return {}
    with path.open(newline="", encoding="utf-8") as file:
        return {tuple(row[name] for name in KEY): row for row in csv.DictReader(file)}


def write_table(path: Path, found: list[dict[str, str]]) -> None:
    """Rows of the files whose tests ran, and of the others what was there before."""
    ran = {row["test"].partition("::")[0] for row in found}
    kept = [
        row
        for row in read_table(path).values()
        if row["test"].partition("::")[0] not in ran
    ]
    rows = sorted(kept + found, key=lambda row: row["test"])
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


@dataclass
class Validated:
    """The fixture: one call for each value; `topic` holds for the calls of a test."""

    test: str
    topic: str
    committed: dict[tuple[str, ...], dict[str, str]] | None
    record: list[tuple[str, object]]
    seen: set[tuple[str, ...]] = field(default_factory=set)
    wrong: list[str] = field(default_factory=list)

    def __call__(
        self,
        case,
        quantity,
        ours,
        reference,
        source,
        *,
        rel=0.0,
        abs=0.0,
        unit="",
        short="",
        topic="",
    ):
        """Assert that `ours` is `reference` to a relative or absolute tolerance, and keep it.

        Of several values in `ours`, as of the runs of `nearby`, the median counts; the tolerance
        that it holds must not be less than their spread.

        A value that is known to fall short gives the reason in `short`, and has to. While a table
        is written, failures wait for the end of the test, so that all its rows are there.
        """
        values = np.array(ours, float)
        reference = float(reference)
        spread = float(np.ptp(values))
        ours = float(np.median(values))
        allowed = max(abs, rel * math.fabs(reference))
        difference = ours - reference
        holds = math.fabs(difference) <= allowed
        if math.fabs(difference) < 1e-8 * math.fabs(reference):
            difference = 0.0  # rounding, which is another one on another machine
        cells = (
            topic or self.topic,
            case,
            quantity,
            unit,
            source,
            f"{reference:.6g}",
            f"{ours:.6g}",
            f"{spread:.2g}",
            f"{difference:.3g}",
            f"{allowed:.3g}",
            "yes" if holds else "no",
            short,
            self.test,
        )
        row = dict(zip(COLUMNS, cells, strict=True))
        key = tuple(row[name] for name in KEY)
        assert key not in self.seen, f"validated twice: {key}"
        self.seen.add(key)
        self.record.append((NAME, row))
        found = f"{case}, {quantity}: {ours:.6g} {unit}; {source} has {reference:.6g}"
        if holds == bool(short):
            self.wrong.append(f"{found}; allowed is a difference of {allowed:.3g}")
        if spread > allowed and not short:
            self.wrong.append(
                f"{found}; runs nearby differ by {spread:.2g}, more than is allowed"
            )
        if self.committed is None:
            return
        assert not self.wrong, self.wrong[0]
        assert key in self.committed, f"{found}: no row of the table; write it anew"
        before = self.committed[key]
        slack = max(
            1e-4 * math.fabs(ours), 1e-3 * allowed, spread, float(before["spread"])
        )
        changed = math.fabs(ours - float(before["ours"])) > slack
        assert not changed, f"{found}: {before['ours']} in the table; write it anew"
        same = ("reference", "tolerance", "unit", "holds", "note", "test")
        assert [before[name] for name in same] == [row[name] for name in same]


@pytest.fixture
def validated(request):
    """See `Validated`; the topic is the module's TOPIC or the class's."""
    topic = getattr(
        request.cls or request.module, "TOPIC", getattr(request.module, "TOPIC", "")
    )
    committed = None if request.config.getoption("--validation-table") else read_table()
    found = Validated(
        request.node.nodeid, topic, committed, request.node.user_properties
    )
    yield found
    assert not found.wrong, "\n".join(found.wrong)
    if committed is not None:
        gone = {
            key for key, row in committed.items() if row["test"] == found.test
        } - found.seen
        assert not gone, (
            f"the table has rows of this test that it no longer finds: {gone}"
        )


class Writer:
    """Gathers the rows of all workers and writes them at the end."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.rows: list[dict[str, str]] = []

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.when == "call":
            self.rows += [row for name, row in report.user_properties if name == NAME]

    def pytest_sessionfinish(self) -> None:
        write_table(self.path, self.rows)
