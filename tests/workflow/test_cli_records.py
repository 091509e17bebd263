"""`archfrag records ...`: what each command prints, writes, draws and refuses."""

import importlib.util
import json
import subprocess
import sys
from xml.etree import ElementTree

import numpy as np
import pytest
from click.testing import CliRunner
from obspy import Stream, Trace, UTCDateTime

from archfrag.cli import main
from archfrag.errors import RecordError
from archfrag.motions.index import load_index
from archfrag.motions.read import load_motion, read_motion, read_motions
from tests.motions.fdsn_server import EVENT, data_centre
from tests.motions.helpers import SHIPPED, at2_text, wave
from tests.motions.test_read import knet

G = 9.80665
COMMANDS = ("list", "show", "inspect", "measure", "select", "convert", "fetch", "make")


def needs(module):
    return pytest.mark.skipif(
        importlib.util.find_spec(f"archfrag.motions.{module}") is None,
        reason=f"archfrag.motions.{module} is not there yet",
    )


def call(*arguments):
    return CliRunner().invoke(main, ["records", *map(str, arguments)])


def done(*arguments):
    result = call(*arguments)
    assert result.exit_code == 0, result.stderr
    return result


def facts(*arguments):
    """JSON of a command; nothing else may be on its standard output."""
    return json.loads(done(*arguments, "--json").stdout)


def refused(*arguments):
    result = call(*arguments)
    assert result.stderr.startswith("archfrag: error: ")
    assert result.stderr.count("\n") == 1
    assert result.stdout == ""
    return result.exit_code, result.stderr.removeprefix("archfrag: error: ").rstrip("\n")


def texts(svg):
    """Words of a figure that is whole XML."""
    return " ".join(ElementTree.parse(svg).getroot().itertext())


@pytest.fixture
def at2(tmp_path):
    path = tmp_path / "record.AT2"
    path.write_text(at2_text(0.3 * wave()))
    return path


@pytest.fixture
def three(tmp_path):
    """Two horizontals and a vertical in counts without a unit, of one instrument."""
    path = tmp_path / "three.mseed"
    header = {
        "network": "XX",
        "station": "AB",
        "delta": 0.005,
        "starttime": UTCDateTime(2020, 1, 2),
    }
    shape = np.random.default_rng(1).normal(size=777)
    Stream(
        [Trace(k * shape, {**header, "channel": code})
         for k, code in enumerate(("HNE", "HNN", "HNZ"), start=1)]
    ).write(str(path), format="MSEED")  # fmt: skip
    return path


class TestHelp:
    @pytest.mark.parametrize("command", COMMANDS)
    def test_each_command_explains_itself(self, command):
        text = done(command, "--help").stdout
        assert command in done("--help").stdout
        assert "--json" in text
        assert "..." not in done("--help").stdout.split("Commands:")[1]
        if command != "list":
            assert f"archfrag records {command}" in text.split("Example:")[1]

    def test_help_imports_nothing_heavy(self):
        code = (
            "import sys; from archfrag.cli import main; "
            "main(['records', 'fetch', '--help'], standalone_mode=False); "
            "sys.stderr.write(' '.join(sys.modules))"
        )
        found = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        )
        assert not set(found.stderr.split()) & {"numpy", "obspy", "pandas", "matplotlib"}


class TestInspect:
    def test_channels_in_text_and_json(self, at2, three):
        (found,) = facts("inspect", at2)
        assert (found["format"], found["event"]) == ("AT2", "Imperial Valley-02")
        (channel,) = found["channels"]
        assert (channel["code"], channel["unit"], channel["count"]) == ("180", "g", 400)
        assert channel["PGA"] == pytest.approx(0.3 * np.abs(wave()).max() * G, rel=1e-6)
        assert channel["faults"] == found["faults"] == []
        text = done("inspect", three, "--unit", "m/s2").stdout.splitlines()
        assert text[0] == f"{three}: MSEED, XX.AB"
        assert text[1].startswith("  HNE       777 samples at 0.005 s, 3.88 s, m/s2, PGA 0.")
        assert text[3].endswith("vertical, 2020-01-02T00:00:00.000000Z")

    def test_what_is_wrong_is_said_and_nothing_refused(self, tmp_path, three):
        wrong = tmp_path / "wrong.AT2"
        wrong.write_text(at2_text(300.0 + wave(), count=500))
        found = facts("inspect", wrong, three)
        assert found[0]["channels"][0]["faults"] == [
            "the header announces 500 samples of channel 180, the file holds only 400",
            "the offset of the samples, 300, is larger than their motion about it, 0.9913 "
            "[g in the file]",
            "peak of channel 180 is 301 g by its unit g, outside 1e-05 to 5 g",
        ]
        channel = found[1]["channels"][0]
        assert (channel["unit"], channel["PGA"]) == ("", None)
        assert channel["faults"][0].startswith("the file does not state the unit of its samples")
        assert "    ! the header announces 500" in done("inspect", wrong).stdout

    def test_gaps_and_unequal_channels(self, tmp_path):
        path = tmp_path / "gap.mseed"
        header = {"station": "AB", "delta": 0.01}
        traces = [
            Trace(wave(count), {**header, "channel": code, "starttime": UTCDateTime(start)})
            for code, start, count in (("HNE", 100, 300), ("HNE", 110, 300), ("HNN", 100, 310))
        ]
        Stream(traces).write(str(path), format="MSEED")
        (found,) = facts("inspect", path, "--unit", "m/s2")
        assert [channel["count"] for channel in found["channels"]] == [300, 300, 310]
        counts = "(HNE 300, HNE 300, HNN 310)"
        assert found["faults"][0].endswith(f"unequal numbers of samples {counts}")
        assert found["faults"][1].startswith("channel .AB..HNE has a gap of 7 s")

    def test_an_unreadable_file_among_others(self, at2, tmp_path):
        lost, odd = tmp_path / "lost.AT2", tmp_path / "odd.bin"
        odd.write_bytes(b"\1\2\3")
        result = call("inspect", lost, at2, odd)
        assert result.exit_code == 2
        assert "180       400 samples" in result.stdout
        first, second = result.stderr.splitlines()
        assert first == f"archfrag: error: {lost}: there is no such file"
        assert second.startswith(f"archfrag: error: {odd}: the format is not recognised")
        result = call("inspect", lost, at2, "--json")
        assert [sorted(entry)[0] for entry in json.loads(result.stdout)] == ["error", "channels"]

    def test_figure(self, at2, three, tmp_path):
        figure = tmp_path / "figure.svg"
        done("inspect", at2, "--figure", figure)
        for word in ("record.AT2 180", "acceleration [g]", "velocity [cm/s]", "period [s]"):
            assert word in texts(figure)
        before = figure.read_bytes()
        done("inspect", at2, "--figure", figure)
        assert figure.read_bytes() == before
        code, sentence = refused("inspect", at2, "--figure", tmp_path / "figure.png")
        assert code == 2
        assert sentence.endswith("figures are written as SVG; name a FILE.svg")
        code, sentence = refused("inspect", three, "--figure", figure)
        assert sentence == "a figure shows 1 to 24 channels with a known unit; there are 0"
        assert refused("inspect", at2, "--figure", tmp_path / "no" / "figure.svg")[0] == 4


class TestConvert:
    @pytest.mark.parametrize("unit", ["m/s2", "g"])
    def test_miniseed_holds_every_bit(self, three, tmp_path, unit):
        (entry,) = facts(
            "convert", three, "--unit", "cm/s2", "--in", unit, "--out", tmp_path / "o"
        )
        assert entry == {"file": str(tmp_path / "o" / "three.mseed"), "source": str(three)}
        before = read_motions(three, unit="cm/s2")
        after = read_motions(entry["file"])
        assert [motion.metadata["component"] for motion in after] == ["HNE", "HNN"]
        for old, new in zip(before, after, strict=True):
            assert new.dt == old.dt
            assert np.allclose(new.acceleration, old.acceleration, rtol=3e-16, atol=0.0)
            assert np.allclose(new.vertical, old.vertical, rtol=3e-16, atol=0.0)
            assert new.metadata["start_time"] == old.metadata["start_time"]

    @pytest.mark.parametrize("unit", ["m/s2", "g"])
    def test_at2_holds_the_digits_of_its_columns(self, three, tmp_path, unit):
        out, again = tmp_path / "o", tmp_path / "again"
        done("convert", three, "--unit", "m/s2", "--to", "at2", "--in", unit, "--out", out)
        assert sorted(path.name for path in out.iterdir()) == [
            "index.csv", "three.HNE.AT2", "three.HNN.AT2", "three.HNZ.AT2"
        ]  # fmt: skip
        path = out / "three.HNN.AT2"
        old, new = read_motions(three, unit="m/s2")[1], read_motion(path)
        assert np.allclose(new.acceleration, old.acceleration, rtol=5.1e-8, atol=0.0)
        assert (new.dt, new.metadata["component"]) == (0.005, "HNN")
        done("convert", path, "--to", "at2", "--in", unit, "--out", again)
        samples = [file.read_text().splitlines()[2:] for file in (path, again / "three.HNN.AT2")]
        assert samples[0] == samples[1]

    def test_text_holds_every_digit_and_says_where_it_comes_from(self, at2, tmp_path):
        done("convert", at2, "--to", "text", "--in", "g", "--out", tmp_path)
        text = (tmp_path / "record.txt").read_text()
        time, values = np.loadtxt(tmp_path / "record.txt").T
        assert np.array_equal(values, read_motion(at2).acceleration / G)
        assert np.allclose(time, np.arange(400) * 0.01, rtol=1e-9)
        for words in ("time [s], acceleration [g]", "from record.AT2, sha256 ", "dt = 0.01 s",
                      "event: Imperial Valley-02", "step: Converted to m/s2"):  # fmt: skip
            assert words in text.split("\n0 ")[0]

    def test_the_index_says_where_files_come_from(self, at2, three, tmp_path):
        out = tmp_path / "o"
        done("convert", at2, "--out", out)
        done("convert", three, "--unit", "m/s2", "--to", "at2", "--out", out)
        entries = {entry.id: entry for entry in load_index(out)}
        assert sorted(entries) == ["record", "three.HNE", "three.HNN"]
        assert entries["record"].metadata["source"] == "record.AT2"
        assert "factor 9.80665" in entries["record"].metadata["steps"]
        assert np.array_equal(
            load_motion(entries["record"]).acceleration, read_motion(at2).acceleration
        )
        steps = load_motion(entries["three.HNE"]).log
        assert steps[0] == "Read from three.HNE.AT2 (AT2)."

    def test_files_that_differ_in_their_endings_only(self, tmp_path):
        names = ("ABC0011801241951.EW", "ABC0011801241951.NS")
        paths = [
            knet(tmp_path / name, 1000 * (np.arange(400) % 50), direction)
            for name, direction in zip(names, ("E-W", "N-S"), strict=True)
        ]
        done("convert", *paths, "--to", "at2", "--out", tmp_path / "o")
        entries = load_index(tmp_path / "o")
        assert [entry.id for entry in entries] == list(names)
        assert [load_motion(entry).metadata["component"] for entry in entries] == ["EW", "NS"]

    def test_codes_that_seed_cannot_hold(self, tmp_path):
        path = tmp_path / "wave.sac"
        Trace(wave(), {"channel": "N-S", "station": "long-name", "delta": 0.01}).write(
            str(path), format="SAC"
        )
        done("convert", path, "--unit", "m/s2", "--out", tmp_path / "o")
        (entry,) = load_index(tmp_path / "o")
        assert entry.metadata["channels"] == "N-S"
        assert load_motion(entry).metadata["component"] == "HN1"

    def test_what_is_refused(self, at2, three, tmp_path):
        code, sentence = refused("convert", at2, "--to", "at2", "--out", tmp_path)
        assert (code, sentence.split(": ")[1]) == (
            2, "is the source or written twice; name another folder"
        )  # fmt: skip
        assert refused("convert", three, "--out", tmp_path / "o")[1].startswith(
            f"{three}: the file does not state the unit"
        )
        assert not (tmp_path / "o").exists()
        done("convert", at2, "--out", tmp_path / "o")
        other = tmp_path / "record.dat"
        at2.rename(other)
        assert refused("convert", other, "--out", tmp_path / "o")[1].endswith(
            "the index there has it from elsewhere; name another folder"
        )
        doubtful = tmp_path / "doubtful.AT2"
        doubtful.write_text(at2_text(30.0 * wave()))
        assert "peak of channel 180" in refused("convert", doubtful, "--out", tmp_path / "p")[1]
        done("convert", doubtful, "--accept", "pga", "--out", tmp_path / "p")
        (entry,) = load_index(tmp_path / "p")
        assert load_motion(entry).metadata["accepted"]


class TestFetch:
    @pytest.fixture
    def centre(self, monkeypatch):
        monkeypatch.setenv("no_proxy", "127.0.0.1")
        with data_centre() as found:
            yield found

    def arguments(self, centre, out, *more):
        services = ("--from", centre.address, "--events-from", centre.address)
        return ("fetch", EVENT, *services, "--after", "20", "--out", out, *more)

    def test_records_in_text_and_json(self, centre, tmp_path):
        result = done(*self.arguments(centre, tmp_path, "--channels", "HN?,BN?"))
        assert result.stdout == f"3 records fetched, 0 were there: {tmp_path}\n"
        assert result.stderr.count("\n") == 3
        found = facts(*self.arguments(centre, tmp_path))
        assert (found["new"], len(found["kept"]), found["failures"]) == ([], 3, [])
        assert len(facts("inspect", *tmp_path.glob("*/*.mseed"))) == 3

    def test_a_study_reads_the_folder(self, centre, tmp_path):
        done(*self.arguments(centre, tmp_path))
        rows = facts("list", tmp_path / "index.csv")
        assert [row["event"] for row in rows] == [EVENT] * 3
        (shown, _) = facts("show", tmp_path / EVENT / f"{EVENT}_IV.NEAR..HN.mseed")
        assert shown["vertical"]
        assert shown["PGA"] == pytest.approx(1.0, rel=0.02)

    def test_failures(self, centre, tmp_path):
        centre.faults["dataselect", "BOTH"] = 503
        centre.faults["dataselect", "NEAR"] = 204
        result = call(*self.arguments(centre, tmp_path, "--json"))
        assert result.exit_code == 7
        assert [entry["kind"] for entry in json.loads(result.stdout)["failures"]] == [
            "no data", "service"
        ]  # fmt: skip
        assert result.stderr.splitlines()[-1] == (
            "archfrag: error: 1 of 2 failures may pass; the same command goes on"
        )
        centre.faults.pop(("dataselect", "BOTH"))
        assert done(*self.arguments(centre, tmp_path)).exit_code == 0

    def test_what_cannot_be_asked_for(self, centre, tmp_path):
        code, sentence = refused(*self.arguments(centre, tmp_path / "o", "--radius", "-1"))
        assert (code, sentence) == (2, "radius [km] = -1 must be from 0 to 2000")
        assert not (tmp_path / "o").exists()
        code, sentence = refused("fetch", "x", "--from", "NOPE", "--out", tmp_path / "o")
        assert sentence.startswith("'NOPE' is no data service that is known; allowed are an")


class TestMake:
    PLAN = (
        "--events", "2", "--records-per-event", "2", "--magnitude", "6:7",
        "--distance-km", "10,20",
        "--sites", "3", "--vs30", "500", "--vertical", "--pulses", "0.5", "--seed", "4",
    )  # fmt: skip

    def test_they_are_those_of_the_same_keys_in_a_study(self, tmp_path):
        from archfrag.study.synthetic import Synthetic, made_motions

        found = facts("make", "--out", tmp_path / "a", *self.PLAN)
        assert [file.rsplit("/", 1)[1] for file in found["files"]] == [
            "e1-r1.mseed", "e1-r2.mseed", "e2-r1.mseed", "e2-r2.mseed"
        ]  # fmt: skip
        done("make", "--out", tmp_path / "b", *self.PLAN)
        index = (tmp_path / "a" / "index.csv").read_text()
        assert index == (tmp_path / "b" / "index.csv").read_text()
        wanted = Synthetic(
            events=2, records_per_event=2, magnitude={"start": 6.0, "stop": 7.0},
            distance_km=(10.0, 20.0), sites=3, vs30=500.0, vertical=True, pulses=0.5, seed=4,
        )  # fmt: skip
        entries, made = load_index(tmp_path / "a"), list(made_motions(wanted))
        for entry, motion in zip(entries, made, strict=True):
            read = load_motion(entry)
            assert np.array_equal(read.acceleration, motion.acceleration)
            assert np.array_equal(read.vertical, motion.vertical)
            seeds = ("seed", "event_seed", "site_seed")
            assert [entry.metadata[s] for s in seeds] == [motion.metadata[s] for s in seeds]
        pulses = ["pulse_period_s" in motion.metadata for motion in made]
        assert [entry.metadata["pulse"] for entry in entries] == [str(each) for each in pulses]
        assert len(set(pulses)) == 2

    def test_the_shipped_ones(self, tmp_path):
        text = done("make", "--out", tmp_path).stdout
        assert text == f"30 records and index.csv written to {tmp_path}\n"
        assert (tmp_path / "index.csv").read_text() == (SHIPPED / "index.csv").read_text()

    @pytest.mark.parametrize(
        ("options", "sentence"),
        [
            (["--vertical"], "--events is missing (2 more keys are wrong too)"),
            (["--magnitude", "6,x"], "--magnitude 6,x: a list such as 6,6.5,7 or two ends such"),
            (["--magnitude", "7:6", "--events", "1", "--distance-km", "5"],
             "--magnitude must have stop above start = 7, not 6"),
            (["--magnitude", "6", "--events", "1", "--distance-km", "5,400"],
             "--distance-km[1] = 400.0 must be less than or equal to 300"),
        ],
    )  # fmt: skip
    def test_what_is_refused(self, tmp_path, options, sentence):
        code, text = refused("make", "--out", tmp_path / "o", *options)
        assert code == 2
        assert text.startswith(sentence)
        assert not (tmp_path / "o").exists()

    def test_an_index_of_other_records_is_left_alone(self, at2, tmp_path):
        done("convert", at2, "--out", tmp_path / "o")
        before = (tmp_path / "o" / "index.csv").read_text()
        code, text = refused("make", "--out", tmp_path / "o", *self.PLAN)
        assert (code, "lists other records (record); name another folder" in text) == (2, True)
        assert (tmp_path / "o" / "index.csv").read_text() == before


class TestColumns:
    """`--columns` for a plain text of numbers, in each command that reads a record."""

    @pytest.fixture
    def text(self, tmp_path):
        path = tmp_path / "plain.txt"
        rows = (f"{0.01 * i:.2f}, {value:.6f}" for i, value in enumerate(0.3 * wave()))
        path.write_text("\n".join(["any words", *rows]) + "\n")
        return path

    KNOWN = ("--unit", "g", "--columns", "time=1,acceleration=2,skip=1")

    def test_the_commands_read_it(self, text, tmp_path):
        peak = 0.3 * np.abs(wave()).max()
        (channel,) = facts("inspect", text, *self.KNOWN)[0]["channels"]
        (shown,) = facts("show", text, *self.KNOWN)
        assert channel["PGA"] == shown["PGA"] == pytest.approx(peak * G, rel=1e-5)
        (written,) = facts("convert", text, *self.KNOWN, "--out", tmp_path / "o", "--to", "at2")
        again = read_motion(written["file"]).acceleration
        assert np.abs(again).max() == pytest.approx(peak * G, rel=1e-5)
        arch = ("--radius", "10", "--thickness", "1.5", "--embrace", "157.5", "--voussoirs", "7",
                "--friction", "0.7", "--json")  # fmt: skip
        result = CliRunner().invoke(main, ["simulate", str(text), *self.KNOWN, *arch])
        assert json.loads(result.stdout)["status"]

    def test_a_flatfile_and_a_selection_know_the_columns(self, text, tmp_path):
        out, target = tmp_path / "flat.csv", tmp_path / "target.csv"
        (row,) = facts("measure", text, *self.KNOWN, "--out", out)
        assert row["columns"] == "acceleration=2 time=1 skip=1"
        target.write_text("period_s,Sa_g\n0.2,0.4\n0.5,0.3\n")
        found = tmp_path / "selected.csv"
        done("select", out, "--target", target, "--count", "1", "--max-scale", "100",
             "--out", found)  # fmt: skip
        motion = load_motion(load_index(found)[0])
        assert np.abs(motion.acceleration).max() == pytest.approx(row["PGA_g"] * G, rel=1e-4)
        found.write_text(found.read_text().replace("time=1", "tim=1"))
        with pytest.raises(RecordError, match=r"line 2: columns .*'tim=1' is not known"):
            load_index(found)

    def test_they_are_not_for_files_that_name_their_format(self, text, at2, three, tmp_path):
        rows = facts("measure", text, at2, *self.KNOWN, "--out", tmp_path / "flat.csv")
        assert [row["record"] for row in rows] == ["plain", "record"]
        assert [row["columns"] for row in rows] == ["acceleration=2 time=1 skip=1", None]
        assert [found["format"] for found in facts("inspect", text, at2, three, *self.KNOWN)] == [
            "COLUMNS", "AT2", "MSEED"
        ]  # fmt: skip
        assert facts("inspect", text, *self.KNOWN)[0]["faults"] == []

    @pytest.mark.parametrize(
        ("columns", "sentence"),
        [
            ("time=1,acc=2", "columns 'time=1,acc=2': 'acc=2' is not known; allowed are time=COL"),
            ("time=1,time=2", "columns 'time=1,time=2': 'time=2' occurs twice; allowed are"),
            ("time=1.5", "columns 'time=1.5': 'time=1.5' is not known; allowed are"),
            ("time", "columns 'time': 'time' is not known; allowed are"),
            ("time=1", "columns 'time=1' must have acceleration where another column is named"),
            ("dt=-1", "columns 'dt=-1' must have a positive dt, not -1"),
            ("", "columns '' must have either time or dt"),
        ],
    )
    def test_a_slip_of_the_pen_is_a_sentence(self, text, columns, sentence):
        code, said = refused("inspect", text, "--columns", columns)
        assert (code, said.startswith(sentence)) == (2, True), said


@needs("flatfile")
class TestMeasure:
    def test_a_flatfile_with_a_figure(self, at2, three, tmp_path):
        from archfrag.motions.flatfile import read_flatfile

        out, figure = tmp_path / "flat.csv", tmp_path / "spectra.svg"
        (row,) = facts("measure", at2, "--out", out, "--figure", figure)
        assert row["PGA_g"] == pytest.approx(0.3 * np.abs(wave()).max(), rel=1e-4)
        (file,) = read_flatfile(out)["file"]
        assert (out.parent / file).samefile(at2)
        assert "Sa, 5 % damping [g]" in texts(figure)
        text = done("measure", three, "--unit", "m/s2", "--out", out).stdout
        assert text == f"2 components measured: {out}\n"

    def test_many_files_are_shared_out_and_stay_in_order(self, tmp_path):
        files = []
        for number in range(40):
            files.append(tmp_path / f"r{number % 7}-{number:02d}.AT2")
            files[-1].write_text(at2_text((0.1 + 0.01 * number) * wave()))
        rows = facts("measure", *files, "--out", tmp_path / "f.csv", "--periods", "0.33")
        assert [row["record"] for row in rows] == [file.stem for file in files]
        (one,) = facts("measure", files[9], "--out", tmp_path / "g.csv", "--periods", "0.33")
        assert rows[9] == one
        assert one["T0.330S"] > 0.0
        files[20].write_text("no record")
        assert "r6-20.AT2" in refused("measure", *files, "--out", tmp_path / "h.csv")[1]
        assert not (tmp_path / "h.csv").exists()

    def test_a_vertical_beside_its_horizontals_is_left_out(self, tmp_path):
        for code in ("000", "090", "-UP"):
            (tmp_path / f"RSN1_{code}.AT2").write_text(at2_text(0.3 * wave()))
        files = sorted(tmp_path.glob("*.AT2"))
        rows = facts("measure", *files, "--out", tmp_path / "f.csv")
        assert [row["record"] for row in rows] == ["RSN1_000", "RSN1_090"]

    def test_what_is_refused(self, at2, tmp_path):
        assert refused("measure", tmp_path / "no.AT2", "--out", tmp_path / "f.csv")[0] == 2
        assert refused("measure", at2, "--out", tmp_path / "no" / "f.csv")[0] == 4
        for wrong in ("0.5,x", "0.001", "nan"):
            code, said = refused("measure", at2, "--out", tmp_path / "f.csv", "--periods", wrong)
            assert (code, said.startswith(f"--periods {wrong}: ")) == (2, True)
        assert not list(tmp_path.glob("*.csv"))


@needs("flatfile")
@needs("selection")
class TestSelect:
    SCENARIO = ("--magnitude", "6.5", "--distance", "20", "--vs30", "760", "--period", "0.5")

    @pytest.fixture
    def flatfile(self, tmp_path):
        path = tmp_path / "flat.csv"
        done("measure", *sorted((SHIPPED / "synthetic").glob("*.mseed")), "--out", path)
        return path

    def test_a_scenario(self, flatfile, tmp_path):
        out, figure = tmp_path / "selected.csv", tmp_path / "selected.svg"
        options = (*self.SCENARIO, "--epsilon", "0.5", "--count", "5", "--out", out)
        found = facts("select", flatfile, *options, "--figure", figure)
        assert len(found["records"]) == 5
        assert len(load_index(out)) == 5
        assert load_motion(load_index(out)[0]).duration > 1.0
        assert "period" in texts(figure).lower()
        assert facts("select", flatfile, *options)["records"] == found["records"]
        assert done("select", flatfile, *options).stdout.startswith("5 records selected of ")

    def test_a_target_of_a_file(self, flatfile, tmp_path):
        target = tmp_path / "target.csv"
        target.write_text("period_s,Sa_g\n0.2,0.4\n0.5,0.3\n1.0,0.1\n")
        out = tmp_path / "selected.csv"
        options = ("--target", target, "--count", "4", "--out", out)
        assert len(facts("select", flatfile, *options)["records"]) == 4
        code, sentence = refused("select", flatfile, *options, "--sa", "0.2")
        assert (code, sentence) == (2, "--target and --sa: a target is a file or a scenario")

    def test_what_is_refused(self, flatfile, tmp_path):
        rest = ("--count", "4", "--out", tmp_path / "s.csv")
        code, sentence = refused("select", flatfile, *self.SCENARIO[2:], *rest)
        assert code == 2
        assert sentence == ("a target is --target FILE.csv or a scenario; --magnitude is needed")
        _, sentence = refused("select", flatfile, *self.SCENARIO, *rest)
        assert sentence.endswith("one of --sa and --epsilon is needed")
        code, sentence = refused(
            "select", flatfile, *self.SCENARIO, "--sa", "0.2", "--count", "400", "--out",
            tmp_path / "s.csv",
        )  # fmt: skip
        assert code == 2
        assert not (tmp_path / "s.csv").exists()


def test_rows_and_spectra_of_a_flatfile():
    """What `measure` prints and draws, of a table in the layout that flatfiles have."""
    import pandas as pd

    from archfrag.report.record_figures import measured
    from archfrag.study.record_commands import table_rows, table_spectra

    table = pd.DataFrame(
        {"record": ["a", "b"], "magnitude": [6.5, np.nan], "pulse": [True, False],
         "T1.000S": [0.2, 0.4], "T0.100S": [0.5, 0.9], "T90": [1.0, 1.0]}
    )  # fmt: skip
    assert table_rows(table)[1]["magnitude"] is None
    spectra = table_spectra(table)
    assert {period: row.tolist() for period, row in spectra.items()} == {
        1.0: [0.2, 0.4], 0.1: [0.5, 0.9]
    }  # fmt: skip
    assert "2 components" in measured(spectra, "spectra").svg
