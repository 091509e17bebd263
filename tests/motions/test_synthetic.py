"""The stochastic model, the shipped motions made with it, and their index."""

import hashlib
import re

import numpy as np
import pytest

from archfrag.errors import InputError, OutputError, RecordError
from archfrag.motions import synthetic
from archfrag.motions.index import COLUMNS, load_index
from archfrag.motions.measures import pga, significant_duration
from archfrag.motions.process import displacement, velocity
from archfrag.motions.read import load_motion
from archfrag.motions.synthetic import Options, source

from .helpers import SHIPPED


def rupture_distance(magnitude, surface_distance):
    """From the Joyner-Boore distance, as the authors' values are given [km]."""
    top = max(2.673 - 1.136 * max(magnitude - 4.970, 0.0), 0.0) ** 2
    return np.hypot(top, surface_distance)


# Values that P. J. Stafford, first author of the model, released for checking (optimised form;
# distributed with the sources of pyRVT 0.8): amplitude [m/s] at 0.1, 1 and 10 Hz and duration
# [s] at a magnitude and Joyner-Boore distance [km].
AUTHORS = {
    (5.0, 100.0): ((5.951679e-05, 3.627168e-03, 2.333459e-03), 11.04066),
    (6.0, 30.0): ((4.824304e-03, 7.578799e-02, 3.702352e-02), 9.24816),
    (7.0, 10.0): ((1.811731e-01, 5.452651e-01, 2.551431e-01), 12.96604),
}


class TestModel:
    @pytest.mark.parametrize("scenario", AUTHORS)
    def test_spectrum_and_duration_are_the_authors(self, scenario):
        amplitudes, duration = AUTHORS[scenario]
        reach = rupture_distance(*scenario)
        ours = source.fourier_amplitude((0.1, 1.0, 10.0), scenario[0], reach)
        assert ours == pytest.approx(amplitudes, rel=1e-3)
        assert source.ground_motion_duration(scenario[0], reach) == pytest.approx(
            duration, rel=1e-3
        )

    def test_path_duration_beyond_the_table(self):
        far = [source.ground_motion_duration(6.0, r) for r in (280.0, 290.0)]
        assert far[1] - far[0] == pytest.approx(0.156 * 10.0, rel=1e-9)

    def test_window_peaks_and_ends_where_it_should(self):
        time = np.linspace(-1.0, 20.0, 2101)
        shape = source.window(time, 10.0)
        assert shape.max() == pytest.approx(1.0, rel=1e-4)
        assert time[shape.argmax()] == pytest.approx(2.0, abs=0.011)
        assert np.interp(10.0, time, shape) == pytest.approx(0.05, rel=1e-6)
        assert not shape[time <= 0.0].any()

    def test_mean_amplitude_of_many_motions_is_the_target(self):
        # Above the low cut and away from the baseline, the mean square over seeds.
        power = 0.0
        for seed in range(200):
            motion = synthetic.make_motion(6.0, 20.0, seed, Options(vary=False))
            amplitude = np.abs(np.fft.rfft(motion.acceleration, 8192)) * motion.dt
            power = power + amplitude**2
        f = np.fft.rfftfreq(8192, 0.01)
        for low, high in ((0.4, 1.0), (1.0, 4.0), (4.0, 20.0)):
            band = (f > low) & (f < high)
            target = source.fourier_amplitude(f[band], 6.0, 20.0)
            target *= source.median_adjustment(f[band], 6.0, 20.0)
            assert np.mean(power[band] / 200 / target**2) == pytest.approx(1.0, abs=0.08)

    def test_same_seed_same_samples_other_seed_others(self):
        first, again, other = (synthetic.make_motion(6.0, 20.0, seed) for seed in (7, 7, 8))
        assert np.array_equal(first.acceleration, again.acceleration)
        assert not np.array_equal(first.acceleration, other.acceleration)

    @pytest.mark.parametrize(
        ("arguments", "sentence"),
        [
            ((2.0, 20.0, 1), r"magnitude = 2.0 is outside 3 to 8"),
            ((6.0, -1.0, 1), r"distance .km. = -1.0 is outside 0 to 300"),
            ((float("nan"), 20.0, 1), r"magnitude = nan is outside"),
            ((6.0, 20.0, 1, Options(dt=0.0)), r"time step 0.0 s must be above 0"),
            ((6.0, 20.0, 1, Options(vs30=300.0)), r"vs30 .m/s. = 300.0 is outside 450 to 1000"),
            ((6.0, 20.0, -1), r"seed -1 must be from 0 to 2\^63 - 1"),
        ],
    )
    def test_outside_the_model(self, arguments, sentence):
        with pytest.raises(InputError, match=sentence):
            synthetic.make_motion(*arguments)


class TestSuite:
    def test_every_shipped_file_is_listed_and_whole(self):
        entries = load_index(SHIPPED)
        assert len(entries) >= 24
        files = {path.resolve() for path in (SHIPPED / "synthetic").iterdir()}
        assert {entry.path.resolve() for entry in entries} == files
        assert sum(path.stat().st_size for path in files) < 2_000_000
        magnitudes = {entry.metadata["Mw"] for entry in entries}
        distances = {entry.metadata["distance_km"] for entry in entries}
        assert (min(magnitudes), max(magnitudes)) == (5.5, 7.5)
        assert (min(distances), max(distances)) == (5.0, 100.0)
        assert [entry.metadata["seed"] for entry in entries] == list(range(20250101, 20250131))
        events = [entry.metadata["event_seed"] for entry in entries]
        assert sorted(set(events)) == list(range(20250101, 20250116))
        assert {events.count(event) for event in events} == {2}

    def test_columns(self):
        header = (SHIPPED / "index.csv").read_text().splitlines()[0]
        assert header == ",".join(COLUMNS)

    def test_samples_are_those_that_the_seeds_make(self):
        def digest(motion):
            return hashlib.sha256(motion.acceleration.tobytes()).hexdigest()

        made = {
            motion.metadata["seed"]: digest(motion)
            for motion in (r.make() for r in synthetic.shipped_recipes())
        }
        shipped = [load_motion(entry) for entry in load_index(SHIPPED)]
        assert {m.metadata["seed"]: digest(m) for m in shipped} == made

    def test_making_again_gives_the_same_samples_and_index(self, tmp_path):
        paths = synthetic.make_suite(tmp_path)
        assert sorted(p.name for p in tmp_path.rglob("*") if p.is_file()) == sorted(
            [path.name for path in paths] + ["index.csv"]
        )
        again, shipped = load_index(tmp_path), load_index(SHIPPED)
        for ours, theirs in zip(again, shipped, strict=True):
            assert (ours.id, ours.metadata) == (theirs.id, theirs.metadata)
            assert np.array_equal(load_motion(ours).acceleration, load_motion(theirs).acceleration)

    def test_motions_start_and_end_at_rest(self):
        for entry in load_index(SHIPPED):
            motion = load_motion(entry)
            assert not motion.acceleration[:100].any()
            assert not motion.acceleration[-100:].any()
            speed, place = velocity(motion), displacement(motion)
            assert abs(speed[-1]) < 1e-4 * np.abs(speed).max()
            assert abs(place[-1]) < 5e-3 * np.abs(place).max()
            assert 20.0 < motion.duration < 80.0
            assert 1.0 < significant_duration(motion) < 40.0
            assert 0.05 < pga(motion) < 10.0

    def test_folder_that_cannot_be_made(self, tmp_path):
        (tmp_path / "file").touch()
        with pytest.raises(OutputError, match=r"cannot be written"):
            synthetic.make_suite(tmp_path / "file")


class TestIndex:
    HEADER = "id,file,sha256,Mw,dt_s,unit\n"

    def write(self, folder, *rows, header=HEADER):
        (folder / "index.csv").write_text(header + "".join(f"{row}\n" for row in rows))
        return folder / "index.csv"

    @pytest.mark.parametrize(
        ("rows", "header", "sentence"),
        [
            (["a,f,,6,0.01,g"], "id,file,unit_of\n", r"column 'unit' is missing from the index$"),
            ([",f,,6,0.01,g"], HEADER, r"line 2: id is empty$"),
            (["a,f,,6,0.01,ft"], HEADER, r"line 2: unknown unit 'ft' of acceleration"),
            (["a,f,,big,0.01,g"], HEADER, r"line 2: Mw = 'big' is not a number$"),
            (["a,f,,nan,0.01,g"], HEADER, r"line 2: Mw = 'nan' is not a finite number$"),
            (["a,f,,6,,g", "a,h,,6,,g"], HEADER, r"line 3: id 'a' occurs twice$"),
        ],
    )
    def test_bad_row(self, tmp_path, rows, header, sentence):
        path = self.write(tmp_path, *rows, header=header)
        with pytest.raises(RecordError, match=sentence) as caught:
            load_index(path)
        assert str(path) in str(caught.value)

    def test_missing_index(self, tmp_path):
        with pytest.raises(RecordError, match=r"index\.csv: the index cannot be read"):
            load_index(tmp_path)

    @pytest.mark.parametrize(
        ("change", "sentence"),
        [
            ("content", r"sha256 is .*; the file has changed since it was listed$"),
            ("gone", r"listed in the index but cannot be read \(No such file"),
            ("step", r"the index lists dt_s = 0.02 s, the file has 0.01 s$"),
        ],
    )
    def test_file_that_is_not_as_listed(self, tmp_path, change, sentence):
        source = load_index(SHIPPED)[0]
        copy = tmp_path / "a.mseed"
        copy.write_bytes(source.path.read_bytes())
        step = "0.02" if change == "step" else "0.01"
        self.write(tmp_path, f"a,a.mseed,{source.sha256},5.5,{step},m/s2")
        if change == "content":
            copy.write_bytes(copy.read_bytes()[::-1])
        elif change == "gone":
            copy.unlink()
        with pytest.raises(RecordError, match=sentence):
            load_motion(load_index(tmp_path)[0])


class TestSpectra:
    """The tables of records/README.md, against pygmm's ground-motion models."""

    def test_ratios_in_the_readme_agree_with_the_table_of_motions(self):
        rows = [line.split(",") for line in (SHIPPED / "spectra.csv").read_text().splitlines()[1:]]
        readme = (SHIPPED / "README.md").read_text(encoding="utf-8")
        found = re.search(r"^\| all \| 30 \|(.*)\|$", readme, re.MULTILINE)
        expected = [float(cell) for cell in found.group(1).split("|")]
        computed = []
        for model in ("CY14", "ASK14", "BSSA14"):
            table = np.array([[float(x) for x in row[2:]] for row in rows if row[1] == model])
            assert len(table) == 30
            computed.extend(np.exp(np.log(table).mean(axis=0)))
        assert expected == pytest.approx(computed, abs=0.006)
