"""Plain text in columns, read as keys state."""

import re

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
        assert motion.metadata["format"] == "COLUMNS"
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


class TestTimes:
    def test_that_are_rounded(self, tmp_path):
        text = rows(dt=1 / 128, form="{:.3f} {:.6f}")
        motion = read_motion(write(tmp_path, text), "g", columns=TIMED)
        assert motion.dt == pytest.approx(1 / 128, rel=2e-4)

    @pytest.mark.parametrize(
        ("times", "line"),
        [
            (np.delete(np.arange(401) * 0.01, 100), 101),
            (np.delete(np.arange(401) * 0.01, 1), 2),
            (np.arange(400) * 0.01 + 0.01 * (np.arange(400) > 398), 400),
            (np.arange(400) * 0.01 * (1.0 + 1e-3 * np.arange(400)), None),
        ],
        ids=["a hole", "at the beginning", "at the end", "growing steps"],
    )
    def test_that_are_uneven(self, tmp_path, times, line):
        path = write(tmp_path, rows(times=times))
        with pytest.raises(RecordError, match="times in column 1 are not evenly spaced;") as found:
            read_motion(path, "g", columns=TIMED)
        named = re.match(re.escape(str(path)) + r", line (\d+): ", str(found.value))
        assert named
        assert line in (None, int(named.group(1)))

    @pytest.mark.parametrize("step", [0.0, -0.01])
    def test_that_do_not_rise(self, tmp_path, step):
        times = np.arange(400) * 0.01
        times[200] = times[199] + step
        path = write(tmp_path, "# head\n" + rows(times=times))
        reason = r"line 202: time [\d.]+ s in column 1 does not come after 1\.99 s$"
        with pytest.raises(RecordError, match=reason):
            read_motion(path, "g", columns=TIMED)

    @pytest.mark.parametrize("columns", [Columns(dt=0.01), Columns(acceleration=1, dt=0.01)])
    def test_that_would_be_taken_for_accelerations(self, tmp_path, columns):
        with pytest.raises(RecordError, match="what would be accelerations rises evenly, as tim"):
            read_motion(write(tmp_path, rows()), "cm/s2", columns=columns)


BAD = {
    "short row": (rows().replace("0.050000\t", "0.050000 \n"), r"line 6: has 1 column\(s\), colu"),
    "nan": (rows().replace("0.000000\n", "nan\n", 1), r"line 1: 'nan' is not a finite number$"),
    "infinite": (rows() + "4.00 1e999\n", r"line 401: '1e999' is not a finite number$"),
    "underscore": (rows() + "4.00 1_0\n", r"line 401: '1_0' is not a number$"),
    "stars": (rows() + "4.00 ******\n", r"line 401: '\*{6}' is not a number$"),
    "cut": (rows() + "4.0", r"line 401: has 1 column\(s\), column 2 is asked for; lines of text"),
    "commas": (
        rows(form="{:.2f};{:.6f}").replace(".", ","),
        r"line 1: numbers with commas and no",
    ),
    "one row": ("0.0 1.0\n", r"holds 1 sample\(s\); 2 or more are needed$"),
    "nothing": ("# only a comment\n", r"holds 0 sample\(s\); 2 or more are needed$"),
    "binary": ("\x00\x01\x02\n" * 9, r"line 1: has 1 column\(s\)"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_text_is_refused_in_one_line(tmp_path, case):
    text, reason = BAD[case]
    path = write(tmp_path, text)
    with pytest.raises(RecordError, match=reason) as caught:
        read_motion(path, "g", columns=TIMED)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


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
