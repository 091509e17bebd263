"""Files to motions: formats, units, components, and what is wrong with a file."""

import csv
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from obspy import Inventory, Stream, Trace, UTCDateTime
from obspy.core.inventory import Channel, InstrumentSensitivity, Network, Response, Station

from archfrag.cli import main
from archfrag.errors import RecordError
from archfrag.motions.measures import measure, pga, spectral_acceleration
from archfrag.motions.process import bandpass
from archfrag.motions.read import read_motion, read_motions

from .helpers import REAL_RECORDS, SHIPPED, at2_text, needs_real_records, real_rows, wave

G = 9.80665


RAMP = np.arange(400, dtype=np.int32) // 10


def trace(channel="HNE", data=None, dt=0.01, start=0.0):
    samples = np.round(40.0 * wave()).astype(np.int32) if data is None else np.asarray(data)
    header = {"network": "XX", "station": "AB", "channel": channel, "delta": dt}
    return Trace(samples, header={**header, "starttime": UTCDateTime(2020, 1, 1) + start})


def write(path, *traces, form="MSEED", **options):
    Stream(list(traces)).write(str(path), format=form, **options)
    return path


def station_xml(sensitivity=2000.0, unit="M/S**2", code="HNE", dip=0.0):
    response = Response(
        instrument_sensitivity=InstrumentSensitivity(sensitivity, 1.0, unit, "COUNTS")
    )
    channel = Channel(code, "", 0.0, 0.0, 0.0, 0.0, azimuth=90.0, dip=dip, response=response)
    station = Station("AB", 0.0, 0.0, 0.0, channels=[channel])
    return Inventory(networks=[Network("XX", stations=[station])], source="test")


KNET_HEADER = """Origin Time       2018/01/24 19:51:00
Lat.              41.0
Long.             142.5
Depth. (km)       30
Mag.              6.2
Station Code      AOM005
Station Lat.      41.2948
Station Long.     141.1972
Station Height(m) 10
Record Time       2018/01/24 19:51:40
Sampling Freq(Hz) 100Hz
Duration Time(s)  {duration}
Dir.              {direction}
Scale Factor      {scale}
Max. Acc. (gal)   {peak:.3f}
Last Correction   2018/01/24 19:51:41
Memo.
"""


def knet(path, counts, direction="E-W", scale="2000(gal)/8000000", duration=None):
    header = KNET_HEADER.format(
        duration=len(counts) / 100 if duration is None else duration,
        direction=direction,
        scale=scale,
        peak=np.abs(counts - np.mean(counts)).max() * 2000 / 8e6,
    )
    rows = [" ".join(f"{c:8d}" for c in counts[i : i + 8]) for i in range(0, len(counts), 8)]
    path.write_text(header + "\n".join(rows) + "\n")
    return path


class TestUnits:
    @pytest.mark.parametrize(
        ("unit", "factor"),
        [("m/s2", 1.0), ("cm/s2", 0.01), ("gal", 0.01), ("mm/s2", 0.001), ("g", G)],
    )
    @pytest.mark.parametrize("form", ["MSEED", "SAC", "GSE2", "SLIST"])
    def test_asked_for_where_the_file_does_not_say(self, tmp_path, form, unit, factor):
        path = write(tmp_path / "record", trace(), form=form)
        motion = read_motion(path, unit=unit, accept=["pga"])
        assert np.allclose(motion.acceleration, trace().data * factor, rtol=1e-12)
        assert any(f"unit {unit} as asked for" in step for step in motion.log)

    def test_at2_is_converted_once(self, tmp_path):
        path = tmp_path / "record.AT2"
        path.write_text(at2_text(wave()))
        motion = read_motion(path)
        assert pga(motion) == pytest.approx(np.abs(wave()).max() * G, rel=1e-6)
        assert motion.id == "record"
        assert motion.metadata["unit_in_file"] == "g"
        assert read_motion(path, unit="g").acceleration[7] == motion.acceleration[7]

    def test_at2_in_other_units(self, tmp_path):
        path = tmp_path / "record.AT2"
        path.write_text(at2_text(wave(), unit="CM/S2"))
        assert pga(read_motion(path)) == pytest.approx(np.abs(wave()).max() * 0.01, rel=1e-6)

    def test_counts_with_station_xml_beside_are_demeaned(self, tmp_path):
        path = write(tmp_path / "record.mseed", trace(data=trace().data + 5000))
        station_xml().write(str(tmp_path / "record.xml"), format="STATIONXML")
        expected = (trace().data - trace().data.mean()) / 2000.0
        motion = read_motion(path)
        assert np.allclose(motion.acceleration, expected, atol=1e-12)
        assert any("Mean removed" in step for step in motion.log)
        given = read_motion(path, inventory=tmp_path / "record.xml")
        assert np.array_equal(given.acceleration, motion.acceleration)

    def test_station_xml_named_on_the_command_line(self, tmp_path):
        path = str(write(tmp_path / "record.mseed", trace()))
        (tmp_path / "elsewhere").mkdir()
        table = str(tmp_path / "elsewhere" / "[1]*.xml")
        station_xml().write(table, format="STATIONXML")
        arch = ["--radius", "10", "--thickness", "1.5", "--embrace", "157.5", "--voussoirs", "7",
                "--friction", "0.7", "--scale", "0"]  # fmt: skip
        for command in (["records", "show", path], ["simulate", *arch, path]):
            refused = CliRunner().invoke(main, command)
            assert refused.exit_code == 2
            assert "or by `inventory` (--inventory on the command line)" in refused.output
            assert CliRunner().invoke(main, [*command, "--inventory", table]).exit_code == 0

    def test_station_xml_named_after_the_station(self, tmp_path):
        path = write(tmp_path / "anything.mseed", trace())
        station_xml().write(str(tmp_path / "XX.AB.xml"), format="STATIONXML")
        assert read_motion(path).metadata["unit_in_file"] == "counts"

    def test_knet_scale_factor_is_applied_once_and_the_offset_removed(self, tmp_path):
        counts = np.round(1e5 * wave()).astype(int) + 400_000
        motion = read_motion(knet(tmp_path / "AOM.EW", counts))
        expected = (counts - counts.mean()) * 0.01 * 2000.0 / 8_000_000
        assert np.allclose(motion.acceleration, expected, rtol=1e-9, atol=1e-12)
        assert motion.id == "AOM.EW"
        assert sum("Mean removed" in step for step in motion.log) == 1

    def test_unit_from_an_index_in_the_folder_above(self, tmp_path):
        (tmp_path / "data").mkdir()
        write(tmp_path / "data" / "record.mseed", trace())
        with open(tmp_path / "index.csv", "w", newline="") as file:
            csv.writer(file).writerows(
                [["id", "file", "unit", "Mw"], ["first", "data/record.mseed", "gal", "6.5"]]
            )
        motion = read_motion(tmp_path / "data" / "record.mseed")
        assert np.allclose(motion.acceleration, trace().data * 0.01)
        assert motion.id == "first"
        assert motion.metadata["Mw"] == 6.5

    def test_a_table_that_is_no_index_is_passed_over(self, tmp_path):
        path = write(tmp_path / "record.mseed", trace())
        (tmp_path / "index.csv").write_text("a,b\n1,2\n")
        assert read_motion(path, unit="gal").id == "record"


class TestComponents:
    def test_first_horizontal_and_the_vertical(self, tmp_path):
        upward = trace("HNZ", data=RAMP)
        path = write(tmp_path / "three.mseed", trace(), trace("HNN", data=-trace().data), upward)
        motion = read_motion(path, unit="m/s2")
        assert np.array_equal(motion.acceleration, trace().data)
        assert np.array_equal(motion.vertical, RAMP)
        assert "Horizontal HNE taken, the first of HNE, HNN." in motion.log

    @pytest.mark.parametrize("name", ["HNN", "N", "n", "XX.AB..HNN"])
    def test_component_asked_for(self, tmp_path, name):
        path = write(tmp_path / "two.mseed", trace(), trace("HNN", data=-trace().data))
        motion = read_motion(path, unit="m/s2", component=name)
        assert np.array_equal(motion.acceleration, -trace().data)

    def test_every_horizontal_with_the_vertical(self, tmp_path):
        upward = trace("HNZ", data=RAMP)
        path = write(tmp_path / "three.mseed", trace(), trace("HNN"), upward)
        motions = read_motions(path, unit="m/s2")
        assert [m.id for m in motions] == ["three:HNE", "three:HNN"]
        assert all(np.array_equal(m.vertical, RAMP) for m in motions)

    def test_unequal_lengths_are_cut_to_the_shorter(self, tmp_path):
        upward = trace("HNZ", data=RAMP[:300])
        motion = read_motion(write(tmp_path / "two.mseed", trace(), upward), unit="m/s2")
        assert motion.acceleration.size == motion.vertical.size == 300
        assert "Cut to the 300 samples common to HNE (400) and HNZ (300)." in motion.log

    def test_channels_are_aligned_in_time(self, tmp_path):
        upward = trace("HNZ", data=RAMP, start=0.5)
        motion = read_motion(write(tmp_path / "two.mseed", trace(), upward), unit="m/s2")
        assert np.array_equal(motion.acceleration, trace().data[50:])
        assert np.array_equal(motion.vertical, RAMP[:350])

    def test_vertical_from_its_own_file_counts_upwards(self, tmp_path):
        for name, component in (("h", "180"), ("up", "UP"), ("down", "DWN")):
            (tmp_path / f"{name}.AT2").write_text(at2_text(wave(), component=component))
        up = read_motion(tmp_path / "h.AT2", vertical=tmp_path / "up.AT2")
        down = read_motion(tmp_path / "h.AT2", vertical=tmp_path / "down.AT2")
        assert np.array_equal(up.vertical, up.acceleration)
        assert np.array_equal(down.vertical, -up.vertical)
        assert any("Sign of DWN changed" in step for step in down.log)

    def test_a_single_channel_of_unclear_code_is_the_horizontal(self, tmp_path):
        motion = read_motion(write(tmp_path / "one.mseed", trace("ABC")), unit="m/s2")
        assert "Channel code 'ABC' taken to be horizontal: the only one." in motion.log

    def test_split_but_gapless_traces_are_joined(self, tmp_path):
        first, second = trace(data=trace().data[:150]), trace(data=trace().data[150:], start=1.5)
        path = write(tmp_path / "split.mseed", first, second)
        assert np.array_equal(read_motion(path, unit="m/s2").acceleration, trace().data)

    def test_name_with_wildcards(self, tmp_path):
        path = write(tmp_path / "a[1]*?.mseed", trace())
        assert read_motion(path, unit="m/s2").acceleration.size == 400


def _missing(folder):
    return {"path": folder / "missing.AT2"}


def _folder(folder):
    return {"path": folder}


def _empty(folder):
    (folder / "empty.AT2").touch()
    return {"path": folder / "empty.AT2"}


def _prose(folder):
    (folder / "prose.txt").write_text("no record at all")
    return {"path": folder / "prose.txt"}


def _truncated_mseed(folder):
    path = write(folder / "cut.mseed", trace(data=wave()), reclen=512)
    path.write_bytes(path.read_bytes()[:-100])
    return {"path": path, "unit": "g"}


def _truncated_sac(folder):
    path = write(folder / "cut.sac", trace(), form="SAC")
    path.write_bytes(path.read_bytes()[:900])
    return {"path": path, "unit": "g"}


def _truncated_knet(folder):
    return {"path": knet(folder / "cut.EW", np.arange(200), duration=5)}


def _not_finite(folder):
    data = wave()
    data[17] = np.nan
    return {"path": write(folder / "nan.mseed", trace(data=data)), "unit": "g"}


def _gap(folder):
    return {"path": write(folder / "gap.mseed", trace(), trace(start=10.0)), "unit": "g"}


def _no_unit(folder):
    return {"path": write(folder / "counts.mseed", trace())}


def _unknown_unit(folder):
    return {"path": write(folder / "a.mseed", trace()), "unit": "furlong"}


def _contradicting_unit(folder):
    (folder / "a.AT2").write_text(at2_text(wave()))
    return {"path": folder / "a.AT2", "unit": "m/s2"}


def _contradicting_knet(folder):
    return {"path": knet(folder / "a.EW", np.arange(200)), "unit": "gal"}


def _fewer_at2(folder):
    (folder / "few.AT2").write_text(at2_text(wave(), count=500))
    return {"path": folder / "few.AT2"}


def _slist(folder, rate):
    path = folder / "steps.slist"
    path.write_text(
        f"TIMESERIES XX_AB__HNE_R, 4 samples, {rate} sps, 2003-05-29T02:13:22.043400, SLIST, "
        "FLOAT, \n1.0\t2.0\t3.0\t4.0\n"
    )
    return {"path": path, "unit": "g"}


def _zero_step(folder):
    return _slist(folder, "0.0")


def _negative_step(folder):
    return _slist(folder, "-100.0")


def _only_vertical(folder):
    return {"path": write(folder / "z.mseed", trace("HNZ")), "unit": "g"}


def _no_such_component(folder):
    return {"path": write(folder / "e.mseed", trace()), "unit": "g", "component": "N"}


def _unclear(folder):
    path = write(folder / "two.mseed", trace("ABC"), trace("ABD"))
    return {"path": path, "unit": "g"}


def _velocity_xml(folder):
    station_xml(unit="M/S").write(str(folder / "a.xml"), format="STATIONXML")
    return {"path": write(folder / "a.mseed", trace())}


def _other_xml(folder):
    station_xml(code="HNN").write(str(folder / "a.xml"), format="STATIONXML")
    return {"path": write(folder / "a.mseed", trace())}


def _no_xml(folder):
    return {"path": write(folder / "a.mseed", trace()), "inventory": folder / "none.xml"}


def _unequal_steps(folder):
    path = write(folder / "two.mseed", trace(), trace("HNZ", dt=0.02))
    return {"path": path, "unit": "g"}


def _changed(folder):
    write(folder / "a.mseed", trace())
    (folder / "index.csv").write_text(f"id,file,sha256,unit\none,a.mseed,{'0' * 64},gal\n")
    return {"path": folder / "a.mseed"}


@pytest.mark.parametrize(
    ("case", "sentence"),
    [
        (_missing, r"missing\.AT2: there is no such file$"),
        (_folder, r": this is a folder; a record is one file$"),
        (_empty, r"empty\.AT2: the file is empty$"),
        (_prose, r"prose\.txt: the format is not recognised"),
        (_truncated_mseed, r"cut\.mseed: truncated miniSEED: \d+ bytes"),
        (_truncated_sac, r"cut\.sac: the file is damaged, truncated or not what it seems"),
        (_truncated_knet, r"cut\.EW: the header announces 500 samples of channel EW, the file "
                         r"holds only 200; to use it as it is give `accept` with samples \("),
        (_not_finite, r"nan\.mseed: channel XX\.AB\.\.HNE has 1 sample\(s\) .* at index 17$"),
        (_gap, r"gap\.mseed: channel XX\.AB\.\.HNE has a gap of [\d.]+ s after .* without gaps$"),
        (_no_unit, r"counts\.mseed: the file does not state the unit of its samples; give `unit`, "
                   r"one of m/s2, cm/s2, gal, mm/s2, g \(--unit .* counts\.xml beside it or by "
                   r"`inventory` \(--inventory on the command line\)$"),
        (_unknown_unit, r"unknown unit 'furlong' of acceleration; allowed are m/s2, cm/s2, gal"),
        (_contradicting_unit, r"unit 'm/s2' was asked for but the AT2 header states 'g'"),
        (_contradicting_knet, r"unit 'gal' was asked for but a K-NET file has its own scale"),
        (_fewer_at2, r"few\.AT2: the header announces 500 samples of channel 180, the file "
                     r"holds only 400;"),
        (_zero_step, r"steps\.slist: time step 0\.0 s of channel .* must be a positive number"),
        (_negative_step, r"steps\.slist: time step -0\.01 s of channel .* must be a positive"),
        (_only_vertical, r"z\.mseed: holds only the vertical component \(HNZ\)"),
        (_no_such_component, r"e\.mseed: there is no horizontal component 'N'; there is HNE$"),
        (_unclear, r"which of the channels 'ABC', 'ABD' is horizontal .* give `component` \("),
        (_velocity_xml, r"channel XX\.AB\.\.HNE measures M/S by its StationXML"),
        (_other_xml, r"the StationXML has no response for channel XX\.AB\.\.HNE"),
        (_no_xml, r"none\.xml: there is no such StationXML file$"),
        (_unequal_steps, r"time step of HNE is 0\.01 s and of the vertical HNZ 0\.02 s"),
        (_changed, r"a\.mseed: sha256 is .* the file has changed since it was listed$"),
    ],
)  # fmt: skip
def test_bad_file_gives_one_sentence(tmp_path, case, sentence):
    arguments = case(tmp_path)
    with pytest.raises(RecordError, match=sentence) as caught:
        read_motion(arguments.pop("path"), **arguments)
    assert str(tmp_path) in str(caught.value)
    assert "\n" not in str(caught.value)


@needs_real_records
class TestRealRecords:
    """Against the manifest, which gives Sa as total (not pseudo-) acceleration at samples."""

    @pytest.mark.parametrize("row", real_rows("at2"), ids=lambda row: row["file"])
    def test_measures_of_at2(self, row):
        motion = read_motion(REAL_RECORDS / row["file"])
        assert pga(motion) / G == pytest.approx(float(row["PGA_g"]), rel=1e-3)
        assert measure(motion, "PGV") * 100 == pytest.approx(float(row["PGV_cms"]), rel=1e-3)
        assert measure(motion, "Arias") == pytest.approx(float(row["arias_mps"]), rel=1e-3)
        assert measure(motion, "D5_95") == pytest.approx(float(row["D5_95_s"]), abs=0.021)
        spectrum = spectral_acceleration(motion, (0.2, 1.0)) / G
        assert spectrum[0] == pytest.approx(float(row["Sa_0p2_g"]), rel=0.03)
        assert spectrum[1] == pytest.approx(float(row["Sa_1p0_g"]), rel=0.02)

    @pytest.mark.parametrize(
        "row", real_rows("knet") + real_rows("mseed"), ids=lambda row: row["file"]
    )
    def test_measures_of_raw_records(self, row):
        motion = read_motion(REAL_RECORDS / row["file"])
        # The manifest rounds to 1e-4 g, which is 0.17 % of the weak ones.
        assert pga(motion) / G == pytest.approx(float(row["PGA_g"]), rel=1e-4, abs=5.5e-5)
        filtered = bandpass(motion, 0.1, 25.0)
        velocity = measure(filtered, "PGV") * 100
        assert velocity == pytest.approx(float(row["PGV_cms"]), rel=1e-3, abs=6e-3)
        assert measure(motion, "Arias") == pytest.approx(float(row["arias_mps"]), rel=2e-3)
        assert measure(motion, "D5_95") == pytest.approx(float(row["D5_95_s"]), abs=0.021)


def test_channels_that_are_unclear_in_a_study(tmp_path):
    case = _unclear(tmp_path)
    with pytest.raises(
        RecordError, match=r"from their codes; name them as SEED does \(HNE, HNN, "
    ):
        read_motions(case["path"], case["unit"])


def test_the_shipped_index_is_found_for_a_single_file():
    path = next(Path(SHIPPED / "synthetic").glob("*.mseed"))
    motion = read_motion(path)
    assert motion.metadata["unit_in_file"] == "m/s2"
    assert motion.id == path.stem
