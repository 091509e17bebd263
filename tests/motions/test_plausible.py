"""What a record is refused for, and how it is accepted."""

import json
import re

import numpy as np
import pytest
from click.testing import CliRunner
from obspy import Stream, Trace

import archfrag as af
from archfrag.cli import main
from archfrag.errors import RecordError
from archfrag.motions.index import load_index
from archfrag.motions.plausible import ACCEPTABLE
from archfrag.motions.read import load_motion, read_motion, read_motions

from .helpers import at2_text, wave
from .test_read import knet


def at2(folder, samples=None, **options):
    path = folder / "a.AT2"
    path.write_text(at2_text(0.1 * wave() if samples is None else samples, **options))
    return path


def text_record(folder, form, kept, dt=0.01):
    """A record of 400 samples in one of obspy's text formats, cut off after some of its rows."""
    path = folder / f"a.{form.lower()}"
    header = {"network": "XX", "station": "AB", "channel": "HNE", "delta": dt}
    Stream([Trace(0.1 * wave(), header=header)]).write(str(path), format=form)
    path.write_text("\n".join(path.read_text().splitlines()[: 1 + kept]) + "\n")
    return path


def refused(path, word, sentence, **options):
    """The record is refused in that sentence, and read if the word is accepted."""
    with pytest.raises(RecordError, match=sentence) as caught:
        read_motion(path, **options)
    assert str(caught.value).startswith(f"{path}: ")
    assert f"give `accept` with {word} (--accept {word} on the command line)" in str(caught.value)
    others = [other for other in ACCEPTABLE if other != word]
    with pytest.raises(RecordError, match=sentence):
        read_motion(path, accept=others, **options)
    motion = read_motion(path, accept=[word], **options)
    assert len(motion.metadata["accepted"]) >= 1
    for line in motion.metadata["accepted"]:
        assert line in motion.log
    json.dumps(motion.metadata)
    return motion


class TestPeak:
    @pytest.mark.parametrize(
        ("peak", "value"), [(5.1, "5.1 g"), (351.6, "351.6 g"), (9e-6, "9e-06 g"), (0.0, "0 g")]
    )
    def test_outside_the_range(self, tmp_path, peak, value):
        samples = peak * wave() / np.abs(wave()).max()
        path = at2(tmp_path, samples)
        sentence = rf"peak of channel 180 is {value} by its unit g, outside 1e-05 to 5 g; to use"
        motion = refused(path, "pga", sentence)
        assert motion.metadata["accepted"] == [
            f"Accepted: peak of channel 180 is {value} by its unit g, outside 1e-05 to 5 g."
        ]

    @pytest.mark.parametrize("peak", [4.99, 1.01e-5])
    def test_inside(self, tmp_path, peak):
        motion = read_motion(at2(tmp_path, peak * wave() / np.abs(wave()).max()))
        assert "accepted" not in motion.metadata
        assert not any("ccepted" in line for line in motion.log)

    def test_in_the_unit_that_is_stated(self, tmp_path):
        path = text_record(tmp_path, "SLIST", 400)
        assert read_motion(path, unit="g").acceleration.size == 400
        path = at2(tmp_path, 0.05 * wave(), unit="MM/S2")
        refused(path, "pga", r"is 5\.0\d+e-06 g by its unit mm/s2, outside")

    def test_of_the_vertical(self, tmp_path):
        header = {"station": "AB", "delta": 0.01}
        traces = [
            Trace(factor * wave(), header={**header, "channel": channel})
            for channel, factor in (("HNE", 0.1), ("HNZ", 100.0))
        ]
        path = tmp_path / "a.mseed"
        Stream(traces).write(str(path), format="MSEED")
        motion = refused(path, "pga", r"peak of channel HNZ is 99\.11 g by its unit g", unit="g")
        assert motion.vertical is not None

    def test_motions_made_in_python_are_free(self):
        assert af.Motion(1e6 * wave(), dt=1.0).acceleration.max() > 1e5


class TestTimeStep:
    @pytest.mark.parametrize("dt", [9e-5, 0.11, 1e6, 1e-12])
    def test_outside_the_range(self, tmp_path, dt):
        path = at2(tmp_path, dt=dt, fourth="NPTS= {count:6d}, DT= {dt} SEC")
        shown = re.escape(f"{dt:g}")
        sentence = rf"time step of channel 180 is {shown} s, outside 0\.0001 to 0\.1 s; to use it"
        motion = refused(path, "time_step", sentence)
        assert motion.dt == pytest.approx(dt)

    @pytest.mark.parametrize("dt", [1e-4, 0.1])
    @pytest.mark.parametrize("form", ["AT2", "SLIST", "SAC"])
    def test_the_limits_are_inside(self, tmp_path, form, dt):
        path = tmp_path / "a.sac"
        if form == "AT2":
            path = at2(tmp_path, dt=dt)
        elif form == "SLIST":
            path = text_record(tmp_path, form, 400, dt)
        else:
            header = {"station": "AB", "channel": "HNE", "delta": dt}
            Trace(np.float32(0.1 * wave()), header=header).write(str(path), format="SAC")
        assert read_motion(path, unit="g").dt == pytest.approx(dt, rel=1e-6)


class TestNumberOfSamples:
    @pytest.mark.parametrize(("form", "kept", "held"), [("SLIST", 30, 180), ("TSPAIR", 200, 200)])
    def test_cut_off_text(self, tmp_path, form, kept, held):
        path = text_record(tmp_path, form, kept)
        sentence = f"announces 400 samples of channel HNE, the file holds only {held}; to use it"
        motion = refused(path, "samples", sentence, unit="g")
        assert motion.acceleration.size == held

    def test_cut_off_knet(self, tmp_path):
        path = knet(tmp_path / "a.EW", np.round(1e4 * wave()).astype(int), duration=5)
        sentence = "announces 500 samples of channel EW, the file holds only 400; to use it"
        assert refused(path, "samples", sentence).acceleration.size == 400

    def test_cut_off_at2(self, tmp_path):
        path = at2(tmp_path, count=500)
        sentence = "announces 500 samples of channel 180, the file holds only 400; to use it"
        assert refused(path, "samples", sentence).acceleration.size == 400

    def test_more_than_announced(self, tmp_path):
        path = at2(tmp_path, count=300)
        sentence = "announces 300 samples of channel 180, the file holds 400; to use it"
        assert refused(path, "samples", sentence).acceleration.size == 400

    def test_a_number_that_breaks_off_is_left_out(self, tmp_path):
        path = at2(tmp_path)
        cut = path.read_text()[:3000]
        path.write_text(cut)
        assert cut[-1].isdigit()
        held = len(" ".join(cut.splitlines()[4:]).split())
        motion = refused(path, "samples", f"file holds only {held}; to use it")
        assert motion.acceleration.size == held - 1
        assert motion.metadata["accepted"][1].startswith("Last sample left out: the file ends in")

    def test_one_of_several_channels(self, tmp_path):
        whole, cut = tmp_path / "b", text_record(tmp_path, "SLIST", 30)
        whole.write_text(text_record(tmp_path, "SLIST", 400).read_text().replace("HNE", "HNN"))
        cut = text_record(tmp_path, "SLIST", 30)
        cut.write_text(whole.read_text() + cut.read_text())
        with pytest.raises(RecordError, match="announces 400 samples of channel HNE"):
            read_motions(cut, "g")
        north, east = read_motions(cut, "g", accept=["samples"])
        assert (north.id, east.id) == ("a:HNN", "a:HNE")
        assert "accepted" not in north.metadata
        assert len(east.metadata["accepted"]) == 1


class TestWhereItIsSaid:
    def test_in_an_index(self, tmp_path):
        at2(tmp_path, 10.0 * wave(), count=500)
        index = tmp_path / "index.csv"
        index.write_text("id,file,unit,accept\nstrong,a.AT2,g,pga samples\n")
        (entry,) = load_index(index)
        assert entry.accept == ("pga", "samples")
        for motion in (load_motion(entry), read_motion(tmp_path / "a.AT2")):
            assert motion.id == "strong"
            assert len(motion.metadata["accepted"]) == 2
        index.write_text("id,file,unit,accept\nstrong,a.AT2,g,pga\n")
        with pytest.raises(RecordError, match="holds only 400; to use it"):
            load_motion(load_index(index)[0])
        index.write_text("id,file,unit,accept\nstrong,a.AT2,g,all\n")
        with pytest.raises(RecordError, match=r"index\.csv, line 2: accept 'all' is not one of"):
            load_index(index)

    def test_unknown_word(self, tmp_path):
        path = at2(tmp_path)
        sentence = "accept 'dt' is not one of pga, time_step, samples, header$"
        with pytest.raises(RecordError, match=sentence):
            read_motion(path, accept="dt")
        assert read_motion(path, accept="pga").id == "a"

    def test_on_the_command_line(self, tmp_path):
        path = str(at2(tmp_path, 10.0 * wave()))
        show = ["records", "show", path]
        arch = ["simulate", "--radius", "10", "--thickness", "1.5", "--embrace", "157.5",
                "--voussoirs", "7", "--friction", "0.7", path, "--scale", "0"]  # fmt: skip
        for command in (show, arch):
            result = CliRunner().invoke(main, command)
            assert result.exit_code == 2
            assert result.output.startswith(f"archfrag: error: {path}: peak of channel 180 is")
            assert CliRunner().invoke(main, [*command, "--accept", "pga"]).exit_code == 0
        assert "  Accepted: peak of" in CliRunner().invoke(main, [*show, "--accept", "pga"]).output

    def test_the_command_line_has_every_word(self):
        for command in (main.commands["simulate"], main.commands["records"].commands["show"]):
            (option,) = (p for p in command.params if p.name == "accept")
            assert tuple(option.type.choices) == ACCEPTABLE
