"""Plain text in columns, read as keys state."""

import numpy as np
import pytest

import archfrag as af
from archfrag.errors import InputError, RecordError, StudyError
from archfrag.motions.formats.columns import Columns, read_columns
from archfrag.motions.measures import pga
from archfrag.motions.read import read_motion, read_motions
from archfrag.study.config import load_study
from archfrag.study.records import find_sources, read_sources

from .helpers import wave

G = 9.80665
TIMED = Columns(time=1, acceleration=2)
SAMPLES = np.round(0.3 * wave(), 6)


def rows(samples=SAMPLES, dt=0.01, form="{:.6f}\t{:.6f}", times=None):
    times = np.arange(len(samples)) * dt if times is None else times
    return "".join(form.format(*row) + "\n" for row in zip(times, samples))


def write(folder, text, name="a.txt"):
    (folder / name).write_bytes(text.encode("latin-1"))
    return folder / name


class TestLayouts:
    @pytest.mark.parametrize(
        "form", ["{:.6f}\t{:.6f}", "  {:.4f}   {:.6E}", "{:.3f},{:.6f}", "{:.3f} ; {:.6f} ; 7 # x"]
    )
    @pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
    def test_time_and_acceleration(self, tmp_path, form, end):
        text = "# a comment\n\n" + rows(form=form).replace("\n", end)
        motion = read_motion(write(tmp_path, text), "g", columns=TIMED)
        assert motion.dt == 0.01
        assert np.allclose(motion.acceleration, SAMPLES * G, rtol=1e-6, atol=1e-9)
        rounded = write(tmp_path, rows(dt=1 / 128, form="{:.3f} {:.6f}"))
        assert read_motion(rounded, "g", columns=TIMED).dt == pytest.approx(1 / 128, rel=2e-4)
        assert "Columns acceleration=2 time=1." in motion.log

    @pytest.mark.parametrize("width", [1, 5, 8, 400])
    def test_row_after_row_with_a_time_step(self, tmp_path, width):
        words = [f"{value: .6E}" for value in SAMPLES]
        text = "\n".join(" ".join(words[i : i + width]) for i in range(0, 400, width))
        motion = read_motion(write(tmp_path, text), "m/s2", columns=Columns(dt=0.02))
        assert motion.dt == 0.02
        assert np.allclose(motion.acceleration, SAMPLES, rtol=1e-6, atol=1e-9)

    def test_lines_before_the_first_row(self, tmp_path):
        text = "El Centro 1940\n400 0.01\n" + rows()
        with pytest.raises(RecordError, match=r"line 1: 'El' is not a number$"):
            read_motion(write(tmp_path, text), "g", columns=TIMED)
        columns = Columns(time=1, acceleration=2, skip=2)
        assert read_motion(write(tmp_path, text), "g", columns=columns).acceleration.size == 400

    def test_fortrans_exponents_and_columns_that_run_together(self, tmp_path):
        text = rows(form="{:.4f} {:.6E}").replace("E", "D")
        motion = read_motion(write(tmp_path, text), "m/s2", columns=TIMED)
        assert np.allclose(motion.acceleration, SAMPLES, rtol=1e-6, atol=1e-9)
        text = "-.1234567E-03-.2345678E-02 .5000000E+00\n"
        motion = read_motion(write(tmp_path, text), "g", columns=Columns(dt=0.01))
        assert np.allclose(motion.acceleration / G, [-1.234567e-4, -2.345678e-3, 0.5])

    def test_a_vertical_in_a_column_of_its_own(self, tmp_path):
        text = "".join(f"{0.01 * i:.2f} {a:.6f} {-a:.6f}\n" for i, a in enumerate(SAMPLES))
        columns = Columns(time=1, acceleration=2, vertical=3)
        (motion,) = read_motions(write(tmp_path, text), "m/s2", columns=columns)
        assert motion.id == "a"
        assert np.array_equal(motion.vertical, -motion.acceleration)


EVEN = np.arange(401) * 0.01
BACK = np.where(np.arange(400) == 200, 1.99, EVEN[:400])
BAD = [
    (rows(times=np.delete(EVEN, 100)), TIMED, ["line 101", "column 1", "not evenly spaced"]),
    (rows(times=np.delete(EVEN, 1)), TIMED, ["line 2", "not evenly spaced"]),
    (rows(times=EVEN[:400] * (1.0 + EVEN[:400])), TIMED, ["not evenly spaced"]),
    ("# head\n" + rows(times=BACK), TIMED, ["line 202", "column 1", "after 1.99 s"]),
    (rows(), Columns(dt=0.01), ["rises evenly"]),
    (rows(), Columns(acceleration=1, dt=0.01), ["rises evenly"]),
    (rows().replace("0.050000\t", "0.050000 \n"), TIMED, ["line 6", "1 column(s)", "column 2"]),
    (rows().replace("0.000000\n", "nan\n", 1), TIMED, ["line 1", "'nan'", "finite"]),
    (rows() + "4.00 1e999\n", TIMED, ["line 401", "'1e999'", "finite"]),
    (rows() + "4.00 1_0\n", TIMED, ["line 401", "'1_0'"]),
    (rows() + "4.0", TIMED, ["line 401", "1 column(s)"]),
    (rows(form="{:.2f};{:.6f}").replace(".", ","), TIMED, ["line 1", "decimal point"]),
    ("0.0 1.0\n", TIMED, ["1 sample(s)"]),
    ("# only a comment\n", TIMED, ["0 sample(s)"]),
    ("\x00\x01\x02\n" * 9, TIMED, ["line 1", "1 column(s)"]),
]


@pytest.mark.parametrize(("text", "columns", "parts"), BAD)
def test_bad_text_is_refused_in_one_line(tmp_path, text, columns, parts):
    path = write(tmp_path, text)
    with pytest.raises(RecordError) as caught:
        read_motion(path, "g", columns=columns)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert "\n" not in message
    for part in parts:
        assert part in message


def test_limits_of_size(tmp_path, monkeypatch):
    path = write(tmp_path, rows())
    monkeypatch.setattr("archfrag.motions.formats.columns.LONGEST_LINE", 10)
    with pytest.raises(RecordError, match="line 1: has more than 10 characters"):
        read_columns(path, TIMED)
    monkeypatch.setattr("archfrag.motions.formats.columns.LARGEST_FILE", 100)
    with pytest.raises(RecordError, match="a text of numbers may have at most"):
        read_columns(path, TIMED)


REFUSED = [
    ({}, "must have either time or dt"),
    ({"time": 1, "acceleration": 2, "dt": 0.01}, "must have either time or dt"),
    ({"time": 1}, "must have acceleration where another column is named"),
    ({"dt": 0.01, "vertical": 2}, "must have acceleration where another column is named"),
    ({"time": 2, "acceleration": 2}, "must have a different number for each column"),
    ({"time": 0, "acceleration": 2}, "must have numbers from 1 to 1000, not 0"),
    ({"dt": 0.0}, "must have a positive dt, not 0"),
    ({"dt": 0.01, "skip": -1}, "must have skip of at least 0, not -1"),
]


@pytest.mark.parametrize(("given", "reason"), REFUSED)
def test_columns_that_contradict_each_other(given, reason):
    with pytest.raises(InputError, match=f"^columns {reason}$"):
        af.Columns(**given)


STUDY = """
id: text
title: Plain text
arches: [{id: a, profile: circular, radius: 10.0, thickness: 1.5, embrace: 157.5, voussoirs: 7,
          friction: 0.7}]
motions:
  files:
    - {path: "*.txt", unit: g, columns: COLUMNS}
intensity: {measure: PGA, unit: g, levels: [0.5]}
"""


class TestStudy:
    def study(self, folder, columns):
        (folder / "study.yaml").write_text(STUDY.replace("COLUMNS", columns))
        return load_study(folder / "study.yaml")

    def test_keys_of_a_file(self, tmp_path):
        for name in ("one.txt", "two.txt"):
            write(tmp_path, rows(), name)
        study = self.study(tmp_path, "{time: 1, acceleration: 2}")
        assert {source.columns for source in find_sources(study)} == {TIMED}
        motions = list(read_sources(study))
        assert [motion.id for motion in motions] == ["one", "two"]
        assert pga(motions[0]) == pytest.approx(np.abs(SAMPLES).max() * G)

    @pytest.mark.parametrize(("given", "reason"), REFUSED[1:])
    def test_keys_that_contradict_each_other(self, tmp_path, given, reason):
        text = ", ".join(f"{key}: {value}" for key, value in given.items())
        with pytest.raises(StudyError, match=rf"motions\.files\[0\]\.columns.* {reason}$"):
            self.study(tmp_path, f"{{{text}}}")
