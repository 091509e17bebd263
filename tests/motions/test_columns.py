"""Plain text in columns, read as keys state."""

import numpy as np
import pytest

import archfrag as af
from archfrag.errors import InputError
from archfrag.motions.formats.columns import Columns, parse_columns
from archfrag.motions.read import read_motion
from archfrag.study.file.schema import load_study
from archfrag.study.file.sources import read_sources
from tests.study.small import TEXT, small_study

from .helpers import pga, put, refused, swapped, wave

G = 9.80665
TIMED = Columns(time=1, acceleration=2)
SAMPLES = np.round(0.3 * wave(), 6)


def rows(samples=SAMPLES, dt=0.01, form="{:.6f}\t{:.6f}", times=None):
    times = np.arange(len(samples)) * dt if times is None else times
    return "".join(form.format(*row) + "\n" for row in zip(times, samples))


def row_by_row(width):
    words = [f"{value: .6E}" for value in SAMPLES]
    return "# head\n" + "\n".join(
        " ".join(words[i : i + width]) for i in range(0, 400, width)
    )


@pytest.mark.parametrize(
    ("text", "columns"),
    [
        *(
            ("# a comment\n\n" + rows(form=form).replace("\n", end), TIMED)
            for form, end in (
                ("{:.6f}\t{:.6f}", "\n"),
                ("  {:.4f}   {:.6E}", "\r\n"),
                ("{:.3f},{:.6f}", "\r"),
                ("{:.3f} ; {:.6f} ; 7 # x", "\n"),
            )
        ),
        *((row_by_row(width), Columns(dt=0.01)) for width in (1, 8, 400)),
        (
            "El Centro 1940\n400 0.01\n" + rows(),
            Columns(time=1, acceleration=2, skip=2),
        ),
        (rows(form="{:.4f} {:.6E}").replace("E", "D"), TIMED),
        (
            "".join(
                f"{-a:.6f} {0.01 * i:.2f} {a:.6f}\n" for i, a in enumerate(SAMPLES)
            ),
            Columns(time=2, acceleration=3, vertical=1),
        ),
    ],
)
def test_layouts(tmp_path, text, columns):
    motion = read_motion(put(tmp_path, text), "g", columns=columns)
    assert (motion.dt, motion.id) == (0.01, "a")
    assert np.allclose(motion.acceleration, SAMPLES * G, rtol=1e-6, atol=1e-9)
    assert f"Columns {columns}." in motion.log
    assert (motion.vertical is None) == (columns.vertical is None)
    assert motion.vertical is None or np.array_equal(
        motion.vertical, -motion.acceleration
    )


def test_rounded_times_and_columns_that_run_together(tmp_path):
    rounded = put(tmp_path, rows(dt=1 / 128, form="{:.3f} {:.6f}"))
    assert read_motion(rounded, "g", columns=TIMED).dt == pytest.approx(
        1 / 128, rel=2e-4
    )
    together = put(tmp_path, "-.1234567E-03-.2345678E-02 .5000000E+00\n")
    motion = read_motion(together, "m/s2", columns=Columns(dt=0.02))
    assert np.allclose(motion.acceleration, [-1.234567e-4, -2.345678e-3, 0.5])


EVEN = np.arange(401) * 0.01
BACK = np.where(np.arange(400) == 200, 1.99, EVEN[:400])


@pytest.mark.parametrize(
    ("text", "columns", "parts"),
    [
        (
            rows(times=np.delete(EVEN, 100)),
            TIMED,
            ["line 101", "column 1", "evenly spaced"],
        ),
        (
            "# head\n" + rows(times=BACK),
            TIMED,
            ["line 202", "column 1", "after 1.99 s"],
        ),
        (rows(), Columns(dt=0.02), ["rises evenly"]),
        ("El Centro 1940\n" + rows(), TIMED, ["line 1", "'El' is not a finite number"]),
        (rows().replace("0.050000\t", "0.050000 \n"), TIMED, ["line 6", "1 column(s)"]),
        (
            rows().replace("0.000000\n", "nan\n", 1),
            TIMED,
            ["line 1", "'nan'", "finite"],
        ),
        (
            rows(form="{:.2f};{:.6f}").replace(".", ","),
            TIMED,
            ["line 1", "decimal point"],
        ),
        ("0.0 1.0\n", TIMED, ["1 sample(s)"]),
    ],
)
def test_bad_text_is_refused_in_one_line(tmp_path, text, columns, parts):
    path = put(tmp_path, text)
    refused(lambda: read_motion(path, "g", columns=columns), *parts, start=path)


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ({}, "must have either time or dt"),
        ({"time": 1}, "must have acceleration where another column is named"),
        (
            {"time": 2, "acceleration": 2},
            "must have a different number for each column",
        ),
        ({"time": 0, "acceleration": 2}, "must have numbers from 1 to 1000, not 0"),
        ({"dt": 0.01, "skip": -1}, "must have skip of at least 0, not -1"),
    ],
)
def test_columns_that_contradict_each_other(given, reason):
    with pytest.raises(InputError, match=f"^columns '.*' {reason}$"):
        af.Columns(**given)


def test_keys_of_a_file_in_a_study(tmp_path):
    files = '{path: "records/*.txt", unit: g, columns: "time=1,acceleration=2"}'
    path = small_study(tmp_path, TEXT.replace('"records/*.AT2"', files))
    put(path.parent / "records", rows())
    study = load_study(path)
    (motion,) = read_sources(study.motions, study.intensity.measure)
    assert pga(motion) == pytest.approx(np.abs(SAMPLES).max() * G)


TIMES = np.arange(400) * 0.01
NORTH = 0.3 * wave()
EAST = 0.2 * wave(frequency=2.3)
WORDS = "time=1,acceleration=2"


def table(form, *columns):
    return "".join(form.format(*row) + "\n" for row in zip(TIMES, *columns))


def acceleration(form, factor=1900.0, swap=False):
    words = (form.format(value) for value in factor * NORTH / np.abs(NORTH).max())
    return [swapped(word) if swap else word for word in words]


THREE = table("{:.2f},{:.5f},{:.5f}", NORTH, EAST)
PLAIN = table("{:.2f} {:.5f}", NORTH)
EMPTY = THREE.replace("\n1.00,", "\n1.00,,").replace(f",,{NORTH[100]:.5f}", ",")


@pytest.mark.parametrize(
    ("text", "columns", "parts"),
    [
        (EMPTY, WORDS, ["line 101", "column 2 is empty"]),
        (EMPTY.replace(",", ";"), WORDS, ["line 101", "column 2 is empty"]),
        (EMPTY.replace(",", "\t"), WORDS, ["line 101", "column 2 is empty"]),
        (
            THREE.replace("\n1.00,", "\n1.00,7,"),
            WORDS,
            ["line 101", "4 cells", "have 3"],
        ),
        (THREE + "4.00,0.1\n", WORDS, ["line 401", "2 of 3 cells"]),
        (PLAIN.replace("\n1.00 ", "\n1.00;"), WORDS, ["line 101", "1 column(s)"]),
        (
            table("{:.2f}\t{}", acceleration("{:,.2f}")),
            WORDS,
            ["'1,0", "comma within a number"],
        ),
        (
            table('{:.2f},"{}"', acceleration("{:,.2f}")),
            WORDS,
            ["'1,0", "comma within a number"],
        ),
        (
            table("{:.2f},{}", acceleration("{:,.2f}")),
            WORDS,
            ["3 cells", "have 2", "within"],
        ),
        (
            table("{:.2f} {}", acceleration("{:,.2f}")).replace(",", " "),
            WORDS,
            ["3 cells"],
        ),
        (
            table("{:.2f}\t{}", acceleration("{:,.2f}")).replace(",", "'"),
            WORDS,
            ["1'0", "finite"],
        ),
        (
            table("{:.2f};{}", acceleration("{:,.0f}", swap=True)),
            WORDS,
            ["separate thousands?"],
        ),
        (
            table("{:.2f};{}", acceleration("{:.3f}", swap=True)),
            WORDS,
            ["'0,000' has a"],
        ),
        (
            table("{:.2f},{}", acceleration("{:.3f}", swap=True)),
            WORDS,
            ["may be one number"],
        ),
        (
            table("{:.2f} {}", acceleration("{:.3f}", swap=True)),
            WORDS,
            ["'0.00 0' is not"],
        ),
        (table("{:.2f} 5 {:.1f}", 500 + 900 * NORTH), WORDS, ["may be one number"]),
        (PLAIN + "end of file\n", WORDS, ["line 401", "'end' is not a finite"]),
        (
            THREE.replace(f"{NORTH[50]:.5f}", "#N/A", 1),
            WORDS,
            ["line 51", "column 2 is empty"],
        ),
        (
            table("{1:.5f} {2:.5f}", NORTH, EAST),
            "dt=0.01",
            ["2 numbers a row", "side by side"],
        ),
        (table("{1:.5f},{2:.5f}", NORTH, 1.02 * NORTH), "dt=0.01", ["side by side"]),
        (table("{1:.5f};{1:.5f};{2:.5f}", NORTH, EAST), "dt=0.01", ["3 numbers a row"]),
        (THREE, "dt=0.01", ["the first column rises evenly"]),
        (
            PLAIN.replace(" ", "\n").replace("\n0.00", "\n0.1 0.00", 1),
            "dt=0.01",
            ["fewer than 2"],
        ),
        (PLAIN.encode("utf-16"), WORDS, ["is text in UTF-16; save it as UTF-8"]),
        (PLAIN.encode("utf-16-be"), WORDS, ["is text in UTF-16; save it as UTF-8"]),
    ],
)
def test_columns_of_which_numbers_could_move(tmp_path, text, columns, parts):
    path = put(tmp_path, text)
    given = parse_columns(columns)
    refused(
        lambda: read_motion(path, "mm/s2", accept=["pga"], columns=given),
        *parts,
        start=path,
    )


@pytest.mark.parametrize(
    ("text", "columns"),
    [
        (EMPTY.replace("\n1.00,,", f"\n1.00,{NORTH[100]:.5f},"), WORDS),
        (table('"{:.2f}","{:.5f}"', NORTH), WORDS),
        ("\ufeff" + table("{:.2f},{:.5f},", NORTH), WORDS),
        (PLAIN.replace("\n1.00 ", "\n1.00\t"), WORDS),
        (table("{:.2f};{:.5f};{:.5f}", EAST, NORTH), "time=1,acceleration=3"),
    ],
)
def test_columns_that_are_clear(tmp_path, text, columns):
    motion = read_motion(put(tmp_path, text), "m/s2", columns=parse_columns(columns))
    assert np.allclose(motion.acceleration, NORTH, atol=6e-6)
