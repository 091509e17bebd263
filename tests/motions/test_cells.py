"""Hazards, indices and targets: one separator a file, equal rows, and numbers that are clear."""

import numpy as np
import pytest

from archfrag.motions.index import load_index
from archfrag.motions.read import read_motion
from archfrag.motions.selection import read_targets
from archfrag.study.hazard import load_hazard

from .helpers import at2_text, put, refused, wave

NORTH = 0.3 * wave()
YEARS = "PGA [g];return period [years]\n"


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        (
            YEARS + "0,08;1.000\n0,15;2.475\n",
            ["'0,08' in line 2", "'1.000' in line 2 a point"],
        ),
        (YEARS + "0.08;1,000\n0.15;2,475\n", ["'1,000' in line 2", "one of the two"]),
        (
            YEARS + "0.08;1.000\n0.15;2.475\n",
            ["1.000, 2.475: years, or thousands of years?"],
        ),
        (YEARS + "0,08;1,000\n0,15;2,475\n", ["years, or thousands of years?"]),
        (YEARS + "0.08;1.0\n0.15;2.475\n0.2;5.0\n", ["Write 2475 or 2.4750 for 2.475"]),
        (YEARS + "0.08;475\n0.15;975\n0.2;2.475\n", ["2.475 beside 475", "thousands?"]),
        (YEARS.replace("g]", "mm/s2]") + "980;475\n1.193;2475\n", ["1.193 beside 980"]),
        (
            'PGA [g],return period\n0.08,"1,000"\n',
            ["line 2: '1,000' has a comma within"],
        ),
        ("PGA [g],rate\n0.08,1e-2\n0.15,\n", ["line 3 has an empty cell"]),
        ("PGA [g],rate\n0.08,1e-2\n0.15\n", ["line 3 has 1 of 2 cells"]),
        ("PGA [g],rate\n0,08,1e-2\n0,15,1e-3\n", ["line 2 has 3 cells"]),
        ("PGA [g],rate,rate\n0.08,1,1\n", ["column 'rate' is there twice"]),
        (
            "PGA [g],rate\n0.08,1\n".encode("utf-16"),
            ["is text in UTF-16; save it as UTF-8"],
        ),
    ],
)
def test_hazards_that_could_be_read_in_two_ways(tmp_path, text, parts):
    path = put(tmp_path, text, "hazard.csv")
    refused(lambda: load_hazard([path], "PGA"), "hazard.csv", *parts)


@pytest.mark.parametrize(
    ("text", "rate"),
    [
        (YEARS + "0,08;30\n0,15;2475\n", [1 / 30, 1 / 2475]),
        (YEARS + "0.08;30.0\n0.15;475.0\n0.3;2475.0\n", [1 / 30, 1 / 475, 1 / 2475]),
        (YEARS + "0.08;30.123\n0.15;475.54\n", [1 / 30.123, 1 / 475.54]),
        ("PGA [g],rate,\n0.08,1e-2,\n0.15,1e-3,\n,,\n", [1e-2, 1e-3]),
    ],
)
def test_hazards_that_are_clear(tmp_path, text, rate):
    found = load_hazard([put(tmp_path, text)], "PGA").main.rate
    np.testing.assert_allclose(found, rate)


HEAD = "id,file,unit,Mw\n"


@pytest.mark.parametrize(
    ("text", "part"),
    [
        (
            HEAD + 'a,f,g,"6,5"\n',
            "line 2: '6,5' has a comma within a number; write",
        ),
        (
            "id;file;unit;Mw;distance_km\na;f;g;6,5;1.5\n",
            "'6,5' in line 2 has a comma, '1.5' in line 2 a point",
        ),
        (HEAD + "a,f,g,6,5\n", "line 2 has 5 cells, the other rows have 4"),
        (HEAD + "a,f,g,6\nb,f,g\n", "line 3 has 3 of 4 cells"),
        ("id,file,unit,unit\na,f,g,gal\n", "line 1: column 'unit' is there twice"),
        (HEAD.encode("utf-16"), "is text in UTF-16; save it as UTF-8"),
        ("id,file,unit_of\na,f,g\n", "column 'unit' is missing from the index"),
        (f"{HEAD},f,g,6\n", "line 2: id is empty"),
        (f"{HEAD}a,f,ft,6\n", "line 2: unknown unit 'ft' of acceleration"),
        (f"{HEAD}a,f,g,big\n", "line 2: Mw = 'big' is not a number"),
        (f"{HEAD}a,f,g,nan\n", "line 2: Mw = 'nan' is not a number"),
        (f"{HEAD}a,f,g,6\na,h,g,6\n", "line 3: id 'a' occurs twice"),
    ],
)
def test_an_index_with_one_clear_sentence(tmp_path, text, part):
    path = put(tmp_path, text, "index.csv")
    refused(lambda: load_index(path), "index.csv", part)


def test_a_broken_index_beside_a_record_is_not_passed_over(tmp_path):
    put(tmp_path, HEAD + "a,a.AT2,g,6,5\n", "index.csv")
    path = put(tmp_path, at2_text(NORTH), "a.AT2")
    refused(lambda: read_motion(path), "index.csv: line 2 has 5 cells")
    put(
        tmp_path, "id;file;unit;Mw;event\r\nb;a.AT2;g;6.5;Norcia, 2016\r\n", "index.csv"
    )
    motion = read_motion(path)
    assert (motion.id, motion.metadata["event"]) == ("b", "Norcia, 2016")


def test_marks_of_encodings_in_formats_with_headers(tmp_path):
    text = at2_text(NORTH)
    plain = read_motion(put(tmp_path, text, "plain.AT2")).acceleration
    marked = read_motion(put(tmp_path, "\ufeff" + text, "marked.txt")).acceleration
    assert np.array_equal(plain, marked)
    for name in ("wide.AT2", "wide.txt"):
        path = put(tmp_path, text.encode("utf-16"), name)
        refused(lambda path=path: read_motion(path), "is text in UTF-16", start=path)


def test_a_target_with_any_separator(tmp_path):
    text = "period_s;Sa_g\n0.1;0.5\n0.5;0.3\n"
    target = read_targets(put(tmp_path, text))[None]
    np.testing.assert_allclose(np.exp(target.ln_mean), [0.5, 0.3])
    path = put(tmp_path, "period_s;Sa_g\n0,1;0.5\n0,5;0.3\n")
    refused(lambda: read_targets(path)[None], "'0,1' in line 2 has a comma, '0.5'")
