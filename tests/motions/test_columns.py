"""Plain text in columns, read as keys state."""

import numpy as np
import pytest

import archfrag as af
from archfrag.errors import InputError
from archfrag.motions.formats.columns import Columns
from archfrag.motions.read import read_motion
from archfrag.study.file.schema import load_study
from archfrag.study.file.sources import read_sources
from tests.study.small import TEXT, small_study

from .helpers import pga, refused, wave

G = 9.80665
TIMED = Columns(time=1, acceleration=2)
SAMPLES = np.round(0.3 * wave(), 6)


def rows(samples=SAMPLES, dt=0.01, form="{:.6f}\t{:.6f}", times=None):
    times = np.arange(len(samples)) * dt if times is None else times
    return "".join(form.format(*row) + "\n" for row in zip(times, samples))


def write(folder, text):
    (folder / "a.txt").write_text(text, encoding="latin-1", newline="")
    return folder / "a.txt"


def row_by_row(width):
    words = [f"{value: .6E}" for value in SAMPLES]
    return "# head\n" + "\n".join(" ".join(words[i : i + width]) for i in range(0, 400, width))


@pytest.mark.parametrize(
    ("text", "columns"),
    [
        *(("# a comment\n\n" + rows(form=form).replace("\n", end), TIMED)
          for form, end in (("{:.6f}\t{:.6f}", "\n"), ("  {:.4f}   {:.6E}", "\r\n"),
                            ("{:.3f},{:.6f}", "\r"), ("{:.3f} ; {:.6f} ; 7 # x", "\n"))),
        *((row_by_row(width), Columns(dt=0.01)) for width in (1, 8, 400)),
        ("El Centro 1940\n400 0.01\n" + rows(), Columns(time=1, acceleration=2, skip=2)),
        (rows(form="{:.4f} {:.6E}").replace("E", "D"), TIMED),
        ("".join(f"{-a:.6f} {0.01 * i:.2f} {a:.6f}\n" for i, a in enumerate(SAMPLES)),
         Columns(time=2, acceleration=3, vertical=1)),
    ],
)  # fmt: skip
def test_layouts(tmp_path, text, columns):
    motion = read_motion(write(tmp_path, text), "g", columns=columns)
    assert (motion.dt, motion.id) == (0.01, "a")
    assert np.allclose(motion.acceleration, SAMPLES * G, rtol=1e-6, atol=1e-9)
    assert f"Columns {columns}." in motion.log
    assert (motion.vertical is None) == (columns.vertical is None)
    assert motion.vertical is None or np.array_equal(motion.vertical, -motion.acceleration)


def test_rounded_times_and_columns_that_run_together(tmp_path):
    rounded = write(tmp_path, rows(dt=1 / 128, form="{:.3f} {:.6f}"))
    assert read_motion(rounded, "g", columns=TIMED).dt == pytest.approx(1 / 128, rel=2e-4)
    together = write(tmp_path, "-.1234567E-03-.2345678E-02 .5000000E+00\n")
    motion = read_motion(together, "m/s2", columns=Columns(dt=0.02))
    assert np.allclose(motion.acceleration, [-1.234567e-4, -2.345678e-3, 0.5])


EVEN = np.arange(401) * 0.01
BACK = np.where(np.arange(400) == 200, 1.99, EVEN[:400])


@pytest.mark.parametrize(
    ("text", "columns", "parts"),
    [
        (rows(times=np.delete(EVEN, 100)), TIMED, ["line 101", "column 1", "evenly spaced"]),
        ("# head\n" + rows(times=BACK), TIMED, ["line 202", "column 1", "after 1.99 s"]),
        (rows(), Columns(dt=0.02), ["rises evenly"]),
        ("El Centro 1940\n" + rows(), TIMED, ["line 1", "'El' is not a finite number"]),
        (rows().replace("0.050000\t", "0.050000 \n"), TIMED, ["line 6", "1 column(s)"]),
        (rows().replace("0.000000\n", "nan\n", 1), TIMED, ["line 1", "'nan'", "finite"]),
        (rows(form="{:.2f};{:.6f}").replace(".", ","), TIMED, ["line 1", "decimal point"]),
        ("0.0 1.0\n", TIMED, ["1 sample(s)"]),
    ],
)
def test_bad_text_is_refused_in_one_line(tmp_path, text, columns, parts):
    path = write(tmp_path, text)
    refused(lambda: read_motion(path, "g", columns=columns), *parts, start=path)


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ({}, "must have either time or dt"),
        ({"time": 1}, "must have acceleration where another column is named"),
        ({"time": 2, "acceleration": 2}, "must have a different number for each column"),
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
    write(path.parent / "records", rows())
    study = load_study(path)
    (motion,) = read_sources(study.motions, study.intensity.measure)
    assert pga(motion) == pytest.approx(np.abs(SAMPLES).max() * G)
