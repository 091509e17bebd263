"""Text in cells: one separator a file, equal rows, and numbers that can be read in two ways."""

import numpy as np
import pytest

from archfrag.errors import InputError
from archfrag.motions.formats.columns import parse_columns
from archfrag.motions.index import load_index
from archfrag.motions.read import read_motion
from archfrag.motions.selection import read_target
from archfrag.study.hazard import load_hazard

from .helpers import at2_text, refused, wave

TIMES, NORTH, EAST = np.arange(400) * 0.01, 0.3 * wave(), 0.2 * wave(frequency=2.3)
TIMED = "time=1,acceleration=2"


def rows(form, *columns):
    return "".join(form.format(*row) + "\n" for row in zip(TIMES, *columns))


def swapped(text):
    """Numbers as they are written where the comma is decimal."""
    return text.replace(",", "_").replace(".", ",").replace("_", ".")


def acceleration(form, factor=1900.0, swap=False):
    words = (form.format(value) for value in factor * NORTH / np.abs(NORTH).max())
    return [swapped(word) if swap else word for word in words]


def put(folder, content, name="a.txt"):
    content = content if isinstance(content, bytes) else content.encode()
    (folder / name).write_bytes(content)
    return folder / name


THREE = rows("{:.2f},{:.5f},{:.5f}", NORTH, EAST)
PLAIN = rows("{:.2f} {:.5f}", NORTH)
EMPTY = THREE.replace("\n1.00,", "\n1.00,,").replace(f",,{NORTH[100]:.5f}", ",")


@pytest.mark.parametrize(
    ("text", "columns", "parts"),
    [
        (EMPTY, TIMED, ["line 101", "column 2 is empty"]),
        (EMPTY.replace(",", ";"), TIMED, ["line 101", "column 2 is empty"]),
        (EMPTY.replace(",", "\t"), TIMED, ["line 101", "column 2 is empty"]),
        (THREE.replace("\n1.00,", "\n1.00,7,"), TIMED, ["line 101", "4 cells", "have 3"]),
        (THREE + "4.00,0.1\n", TIMED, ["line 401", "2 of 3 cells"]),
        (PLAIN.replace("\n1.00 ", "\n1.00;"), TIMED, ["line 101", "1 column(s)"]),
        (rows("{:.2f}\t{}", acceleration("{:,.2f}")), TIMED, ["'1,0", "comma within a number"]),
        (rows('{:.2f},"{}"', acceleration("{:,.2f}")), TIMED, ["'1,0", "comma within a number"]),
        (rows("{:.2f},{}", acceleration("{:,.2f}")), TIMED, ["3 cells", "have 2", "within a num"]),
        (rows("{:.2f} {}", acceleration("{:,.2f}")).replace(",", " "), TIMED, ["3 cells"]),
        (rows("{:.2f}\t{}", acceleration("{:,.2f}")).replace(",", "'"), TIMED, ["1'0", "finite"]),
        (rows("{:.2f};{}", acceleration("{:,.0f}", swap=True)), TIMED, ["separate thousands?"]),
        (rows("{:.2f};{}", acceleration("{:.3f}", swap=True)), TIMED, ["'0,000' has a"]),
        (rows("{:.2f},{}", acceleration("{:.3f}", swap=True)), TIMED, ["may be one number"]),
        (rows("{:.2f} {}", acceleration("{:.3f}", swap=True)), TIMED, ["'0.00 0' is not"]),
        (rows("{:.2f} 5 {:.1f}", 500 + 900 * NORTH), TIMED, ["may be one number"]),
        (PLAIN + "end of file\n", TIMED, ["line 401", "'end' is not a finite"]),
        (THREE.replace(f"{NORTH[50]:.5f}", "#N/A", 1), TIMED, ["line 51", "column 2 is empty"]),
        (rows("{1:.5f} {2:.5f}", NORTH, EAST), "dt=0.01", ["2 numbers a row", "side by side"]),
        (rows("{1:.5f},{2:.5f}", NORTH, 1.02 * NORTH), "dt=0.01", ["side by side"]),
        (rows("{1:.5f};{1:.5f};{2:.5f}", NORTH, EAST), "dt=0.01", ["3 numbers a row"]),
        (THREE, "dt=0.01", ["the first column rises evenly"]),
        (PLAIN.replace(" ", "\n").replace("\n0.00", "\n0.1 0.00", 1), "dt=0.01", ["fewer than 2"]),
        (PLAIN.encode("utf-16"), TIMED, ["is text in UTF-16; save it as UTF-8"]),
        (PLAIN.encode("utf-16-be"), TIMED, ["is text in UTF-16; save it as UTF-8"]),
    ],
)  # fmt: skip
def test_columns_of_which_numbers_could_move(tmp_path, text, columns, parts):
    path = put(tmp_path, text)
    given = parse_columns(columns)
    refused(lambda: read_motion(path, "mm/s2", accept=["pga"], columns=given), *parts, start=path)


@pytest.mark.parametrize(
    ("text", "columns"),
    [
        (EMPTY.replace("\n1.00,,", f"\n1.00,{NORTH[100]:.5f},"), TIMED),
        (rows('"{:.2f}","{:.5f}"', NORTH), TIMED),
        ("\ufeff" + rows("{:.2f},{:.5f},", NORTH), TIMED),
        (PLAIN.replace("\n1.00 ", "\n1.00\t"), TIMED),
        (rows("{:.2f};{:.5f};{:.5f}", EAST, NORTH), "time=1,acceleration=3"),
    ],
)
def test_columns_that_are_clear(tmp_path, text, columns):
    motion = read_motion(put(tmp_path, text), "m/s2", columns=parse_columns(columns))
    assert np.allclose(motion.acceleration, NORTH, atol=6e-6)


YEARS = "PGA [g];return period [years]\n"


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        (YEARS + "0,08;1.000\n0,15;2.475\n", ["'0,08' in line 2", "'1.000' in line 2 a point"]),
        (YEARS + "0.08;1,000\n0.15;2,475\n", ["'1,000' in line 2", "one of the two"]),
        (YEARS + "0.08;1.000\n0.15;2.475\n", ["1.000, 2.475: years, or thousands of years?"]),
        (YEARS + "0,08;1,000\n0,15;2,475\n", ["years, or thousands of years?"]),
        (YEARS + "0.08;1.0\n0.15;2.475\n0.2;5.0\n", ["Write 2475 or 2.4750 for 2.475"]),
        (YEARS + "0.08;475\n0.15;975\n0.2;2.475\n", ["2.475 beside 475", "thousands?"]),
        (YEARS.replace("g]", "mm/s2]") + "980;475\n1.193;2475\n", ["1.193 beside 980"]),
        ('PGA [g],return period\n0.08,"1,000"\n', ["line 2: '1,000' has a comma within"]),
        ("PGA [g],rate\n0.08,1e-2\n0.15,\n", ["line 3 has an empty cell"]),
        ("PGA [g],rate\n0.08,1e-2\n0.15\n", ["line 3 has 1 of 2 cells"]),
        ("PGA [g],rate\n0,08,1e-2\n0,15,1e-3\n", ["line 2 has 3 cells"]),
        ("PGA [g],rate,rate\n0.08,1,1\n", ["column 'rate' is there twice"]),
        ("PGA [g],rate\n0.08,1\n".encode("utf-16"), ["is text in UTF-16; save it as UTF-8"]),
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
        ("id;file;unit;Mw\na;f;g;6,5\n", "line 2: '6,5' has a comma within a number; write"),
        (HEAD + "a,f,g,6,5\n", "line 2 has 5 cells, the other rows have 4"),
        (HEAD + "a,f,g,6\nb,f,g\n", "line 3 has 3 of 4 cells"),
        ("id,file,unit,unit\na,f,g,gal\n", "line 1: column 'unit' is there twice"),
        (HEAD.encode("utf-16"), "is text in UTF-16; save it as UTF-8"),
    ],
)
def test_an_index_with_one_clear_sentence(tmp_path, text, part):
    path = put(tmp_path, text, "index.csv")
    with pytest.raises(InputError, match=r"^[^\n]*$") as caught:
        load_index(path)
    assert part in str(caught.value)


def test_a_broken_index_beside_a_record_is_not_passed_over(tmp_path):
    put(tmp_path, HEAD + "a,a.AT2,g,6,5\n", "index.csv")
    path = put(tmp_path, at2_text(NORTH), "a.AT2")
    refused(lambda: read_motion(path), "index.csv: line 2 has 5 cells")
    put(tmp_path, "id;file;unit;Mw;event\r\nb;a.AT2;g;6.5;Norcia, 2016\r\n", "index.csv")
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
    target = read_target(put(tmp_path, text))
    np.testing.assert_allclose(np.exp(target.ln_mean), [0.5, 0.3])
    path = put(tmp_path, swapped(text))
    refused(lambda: read_target(path), "'0,1' has a comma within a number")
