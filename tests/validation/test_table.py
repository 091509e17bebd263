"""The table of the site: its rows come from tests that exist, and a wrong value shows."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.validation.table import COLUMNS, COMMITTED, Validated, file_of, read_table

ROOT = Path(__file__).parents[2]
ROWS = list(read_table().values())


def run(*arguments):
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-n", "0", "-q", *arguments],
        cwd=ROOT, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-3000:]
    return done.stdout


def fixture(committed=None):
    return Validated("test_x.py::test_x", "A topic", committed, [])


def test_rows_are_enough_each_with_a_source_and_a_reason_where_it_falls_short():
    assert len(ROWS) >= 80
    for row in ROWS:
        assert tuple(row) == COLUMNS
        assert all(row[name] for name in ("topic", "case", "quantity", "source", "test"))
        short = abs(float(row["ours"]) - float(row["reference"])) > 1.01 * float(row["tolerance"])
        slack = abs(float(row["reference"])) * 1e-5
        assert short == (row["holds"] == "no") or abs(float(row["tolerance"])) < slack
        assert bool(row["note"]) == (row["holds"] == "no")


def test_every_row_is_of_a_test_that_is_collected():
    files = sorted({file_of(row) for row in ROWS})
    found = set(run("--collect-only", *files).splitlines())
    assert {row["test"] for row in ROWS} <= found


def test_what_a_run_writes_is_what_is_committed(tmp_path):
    written = tmp_path / "values.csv"
    name = "tests/validation/test_fragility.py"
    run("--validation-table", str(written), name)
    committed = {key: row for key, row in read_table().items() if file_of(row) == name}
    assert read_table(written) == committed


class TestWrongValues:
    def test_beyond_the_tolerance_is_recorded_and_fails(self):
        found = fixture()
        with pytest.raises(
            AssertionError, match=r"arch, onset: 0\.38 g; paper has 0\.37; allowed"
        ):
            found("arch", "onset", 0.38, 0.37, "paper", abs=1e-3, unit="g")
        assert found.record[0][1]["holds"] == "no"

    def test_what_is_said_to_fall_short_has_to(self):
        fixture()("arch", "onset", 0.38, 0.37, "paper", abs=1e-3, short="coarse steps")
        with pytest.raises(AssertionError):
            fixture()("arch", "onset", 0.37, 0.37, "paper", abs=1e-3, short="coarse steps")

    def test_a_value_that_moved_or_is_new_is_stale(self):
        one = fixture()
        one("arch", "onset", 0.3700, 0.37, "paper", abs=1e-3)
        row = one.record[0][1]
        key = ("A topic", "arch", "onset", "paper")
        fixture({key: row})("arch", "onset", 0.37001, 0.37, "paper", abs=1e-3)
        with pytest.raises(AssertionError, match="write it anew"):
            fixture({key: row})("arch", "onset", 0.3702, 0.37, "paper", abs=1e-3)
        with pytest.raises(AssertionError, match="no row of the table"):
            fixture({key: row})("arch", "peak", 0.37, 0.37, "paper", abs=1e-3)

    def test_not_a_number_is_no_agreement(self):
        with pytest.raises(AssertionError):
            fixture()("arch", "onset", float("nan"), 0.37, "paper", abs=1e-3)


def test_the_page_shows_every_topic():
    page = (COMMITTED.parents[1] / "validation.md").read_text(encoding="utf-8")
    topics = {row["topic"] for row in ROWS}
    assert {line[4:] for line in page.splitlines() if line.startswith("### ")} >= topics
