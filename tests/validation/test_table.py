"""The table of the site: its rows come from tests that exist, and a wrong value shows."""

import math
import subprocess
import sys
from pathlib import Path

import pytest

from tests.validation.table import COLUMNS, COMMITTED, Validated, read_table

ROOT = Path(__file__).parents[2]
ROWS = list(read_table().values())
SMALL = """
TOPIC = "A topic"

def test_two(validated):
    validated("arch", "onset", 0.38, 0.37, "paper", abs=1e-3, unit="g")
    validated("arch", "peak", 0.371, 0.37, "paper", rel=1e-2, unit="m")
"""


def pytest_run(*arguments):
    return subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-q", *arguments],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )


def fixture(committed=None):
    return Validated("test_x.py::test_x", "A topic", committed, [])


def test_rows_have_a_source_a_reason_where_they_fall_short_and_a_topic_of_the_page():
    page = (COMMITTED.parents[1] / "validation.md").read_text(encoding="utf-8")
    assert len(ROWS) >= 80
    for row in ROWS:
        assert tuple(row) == COLUMNS
        assert all(
            row[name] for name in ("topic", "case", "quantity", "source", "test")
        )
        short = abs(float(row["ours"]) - float(row["reference"])) > 1.01 * float(
            row["tolerance"]
        )
        slack = abs(float(row["reference"])) * 1e-5
        assert short == (row["holds"] == "no") or abs(float(row["tolerance"])) < slack
        assert bool(row["note"]) == (row["holds"] == "no")
        assert f"### {row['topic']}\n" in page


def test_every_row_is_of_a_test_that_is_collected():
    done = pytest_run("-n", "0", "-m", "", "--collect-only", "tests/validation")
    assert done.returncode == 0, done.stdout[-3000:]
    assert {row["test"] for row in ROWS} <= set(done.stdout.splitlines())


def test_a_run_writes_all_rows_of_a_test_that_fails(tmp_path):
    (tmp_path / "test_small.py").write_text(SMALL)
    table = tmp_path / "values.csv"
    done = pytest_run(
        "-p",
        "tests.conftest",
        "-c",
        "/dev/null",
        "--rootdir",
        str(tmp_path),
        "--validation-table",
        str(table),
        str(tmp_path),
    )
    assert done.returncode == 1
    assert (
        "arch, onset: 0.38 g; paper has 0.37; allowed is a difference of 0.001"
        in done.stdout
    )
    rows = read_table(table).values()
    assert [(row["quantity"], row["holds"]) for row in rows] == [
        ("onset", "no"),
        ("peak", "yes"),
    ]


@pytest.mark.parametrize(
    ("ours", "short", "wrong"),
    [
        (0.38, "", 1),
        (math.nan, "", 1),
        (0.37, "", 0),
        (0.38, "coarse steps", 0),
        (0.37, "coarse steps", 1),
    ],
)
def test_a_known_shortfall_has_to_fall_short_and_nothing_else_may(ours, short, wrong):
    found = fixture()
    found("arch", "onset", ours, 0.37, "paper", abs=1e-3, short=short)
    assert len(found.wrong) == wrong


def test_a_value_that_moved_is_new_or_is_beyond_its_tolerance_fails():
    one = fixture()
    one("arch", "onset", 0.3700, 0.37, "paper", abs=1e-3)
    table = {("A topic", "arch", "onset", "paper"): one.record[0][1]}
    fixture(table)("arch", "onset", 0.37001, 0.37, "paper", abs=1e-3)
    for quantity, ours, message in (
        ("onset", 0.3702, "write it anew"),
        ("peak", 0.37, "no row of the table"),
        ("onset", 0.38, r"onset: 0\.38 ; paper has 0\.37; allowed is"),
    ):
        with pytest.raises(AssertionError, match=message):
            fixture(table)("arch", quantity, ours, 0.37, "paper", abs=1e-3)


def test_a_chaotic_value_is_held_to_its_spread_and_a_tolerance_is_not_less():
    one = fixture()
    near = [0.36, 0.37, 0.375]
    one("arch", "peak", near, 0.37, "paper", abs=0.02)
    assert not one.wrong
    assert float(one.record[0][1]["spread"]) == pytest.approx(0.015)
    table = {("A topic", "arch", "peak", "paper"): one.record[0][1]}
    fixture(table)("arch", "peak", 0.38, 0.37, "paper", abs=0.02)
    with pytest.raises(AssertionError, match="write it anew"):
        fixture(table)("arch", "peak", 0.388, 0.37, "paper", abs=0.02)
    one("arch", "other peak", near, 0.37, "paper", abs=0.01)
    assert "runs nearby differ by 0.015" in one.wrong[0]
