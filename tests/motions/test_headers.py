"""What headers of obspy's formats and StationXML state, against the user and the channel code."""

import numpy as np
import pytest
from obspy import Stream, Trace, UTCDateTime
from obspy.core import AttribDict
from obspy.core.inventory import (
    Channel,
    InstrumentSensitivity,
    Inventory,
    Network,
    Response,
    ResponseStage,
    Station,
)

import archfrag as af
from archfrag.errors import RecordError
from archfrag.motions.formats.columns import Columns
from archfrag.motions.motion import Motion
from archfrag.motions.process import rotate
from archfrag.motions.read import inspect_record, read_motion

from .helpers import pga, refused, wave

START = UTCDateTime(2019, 3, 1)
NORTH = wave()
EAST = 0.7 * wave(frequency=2.3)
GAINS = (0.5, 10.0, 4e4)  # [V/(m/s2)], [V/V], [counts/V]
SCALE = 2e5
TO_45 = {"rotate": {"azimuth": 45}}


def write(path, form, code="HNE", samples=NORTH, **headers):
    header = {"station": "S", "channel": code, "delta": 0.01, "starttime": START}
    trace = Trace(np.asarray(samples, "i4" if form == "GSE2" else "f4"), header)
    trace.stats.update(headers)
    for key, facts in headers.items():
        trace.stats[key] = AttribDict(facts) if isinstance(facts, dict) else facts
    trace.write(str(path), format=form)
    return path


def with_station_xml(
    folder,
    codes=("HNN", "HNE"),
    azimuths=(0.0, 90.0),
    dips=(0.0, 0.0),
    *,
    total=SCALE,
    units=("M/S**2", "COUNTS"),
    depth=0.0,
):
    """Two channels in counts, and their StationXML."""
    stages = [
        ResponseStage(i + 1, gain, 1.0, units[0] if i == 0 else "V", "V")
        for i, gain in enumerate(GAINS)
    ]
    response = Response(
        instrument_sensitivity=InstrumentSensitivity(total, 1.0, *units),
        response_stages=stages,
    )
    channels = [
        Channel(
            code,
            "",
            38.0,
            23.0,
            10.0,
            depth,
            azimuth=azimuth,
            dip=dip,
            sample_rate=100.0,
            response=response,
            start_date=UTCDateTime(2000, 1, 1),
        )
        for code, azimuth, dip in zip(codes, azimuths, dips)
    ]
    station = Station("S", 38.0, 23.0, 10.0, channels=channels)
    table = Inventory([Network("XX", stations=[station])], source="test")
    table.write(str(folder / "a.xml"), format="STATIONXML")
    header = {"network": "XX", "station": "S", "delta": 0.01, "starttime": START}
    Stream(
        Trace(np.round(SCALE * samples).astype("i4"), {**header, "channel": code})
        for code, samples in zip(codes, (NORTH, EAST))
    ).write(str(folder / "a.mseed"), format="MSEED")
    return folder / "a.mseed"


def said(path, unit=None):
    """What `inspect` says of the first channel."""
    return inspect_record(path, unit)["channels"][0]["errors"]


@pytest.mark.parametrize("form", ["SLIST", "TSPAIR"])
@pytest.mark.parametrize(
    ("stated", "part"),
    [
        (
            "M/S",
            "states a velocity (its unit is 'M/S'); samples of acceleration are needed",
        ),
        ("CM/SEC", "states a velocity"),
        ("NM", "states a displacement"),
        ("NM/S**2", "states an acceleration in another unit"),
        ("V", "states no acceleration (its unit is 'V')"),
        (
            "CM/S**2",
            "unit 'm/s2' asked for but the {form} header states 'cm/s2'; leave",
        ),
        (
            "COUNTS",
            "states counts, and the unit m/s2 was given; to use it as it is give `accept`",
        ),
    ],
)
def test_a_unit_that_text_states_is_compared_with_the_users(
    tmp_path, form, stated, part
):
    path = write(tmp_path / "a.txt", form, ascii={"unit": stated})
    refused(lambda: read_motion(path, "m/s2"), part.format(form=form), start=path)


def test_the_unit_of_geocsv(tmp_path):
    path = tmp_path / "a.csv"
    given = {"columns": Columns(acceleration=2, dt=0.01, skip=3)}
    rows = "".join(
        f"2019-03-01T00:00:{i / 100:09.6f}Z, {x:.5f}\n" for i, x in enumerate(NORTH)
    )
    for unit, part in (
        ("M/S", "states a velocity"),
        ("COUNTS", "the file states counts, and"),
        ("M/S**2", ""),
    ):
        path.write_text(
            f"# dataset: GeoCSV 2.0\n# field_unit: UTC, {unit}\nTime, Sample\n{rows}"
        )
        if part:
            refused(lambda: read_motion(path, "m/s2", **given), part, start=path)
    assert pga(read_motion(path, **given)) == pytest.approx(
        np.abs(NORTH).max(), abs=1e-5
    )


def test_units_that_text_states_are_read(tmp_path):
    for stated, factor in (("M/S**2", 1.0), ("CM/S**2", 0.01), ("gal", 0.01)):
        path = write(tmp_path / "a.txt", "TSPAIR", ascii={"unit": stated})
        assert pga(read_motion(path)) == pytest.approx(
            factor * np.abs(NORTH).max(), rel=1e-6
        )
    path = write(tmp_path / "a.txt", "SLIST", ascii={"unit": "COUNTS"})
    refused(
        lambda: read_motion(path),
        "states counts and does not state the unit of one; give its",
    )


@pytest.mark.parametrize(
    ("headers", "parts"),
    [
        ({"sac": {"idep": 7}}, ["states a velocity"]),
        ({"sac": {"idep": 6}}, ["states a displacement"]),
        ({"sac": {"idep": 50}}, ["states volts"]),
        (
            {"calib": 4e5},
            ["a calibration factor of 400000", "samples are counts", "header"],
        ),
        (
            {"channel": "HHE"},
            ["HHE is of a seismometer (velocity)", "accept` with header"],
        ),
        (
            {"sac": {"cmpaz": 90.0, "cmpinc": 0.0}},
            ["horizontal by its code", "dip of -90"],
        ),
        (
            {"sac": {"cmpaz": 0.0, "cmpinc": 90.0}, "channel": "HNZ"},
            ["vertical by its code"],
        ),
        ({"sac": {"cmpaz": 0.0, "cmpinc": 55.0}}, ["neither vertical nor horizontal"]),
    ],
)
def test_sac_headers_that_contradict(tmp_path, headers, parts):
    path = write(tmp_path / "a.sac", "SAC", **headers)
    refused(lambda: read_motion(path, "m/s2"), *parts, start=path)


def test_gse_states_directions_and_counts(tmp_path):
    turned = {"gse2": {"hang": 180.0, "vang": 90.0}}
    path = write(tmp_path / "a.gse", "GSE2", "HNN", 1e3 * NORTH, **turned)
    motion = read_motion(path, "mm/s2")
    assert motion.metadata["azimuth"] == 180.0
    assert motion.metadata["cautions"] == [
        "channel HNN has azimuth 0 by its code, 180 by the GSE2 header; its polarity is reversed"
    ]
    path = write(tmp_path / "a.gse", "GSE2", "HNN", 1e3 * NORTH, calib=0.02)
    refused(
        lambda: read_motion(path, "mm/s2"),
        "states a calibration factor of 0.02",
        start=path,
    )
    upside_down = {"gse2": {"hang": 0.0, "vang": 180.0}}
    write(tmp_path / "z.gse", "GSE2", "HNZ", 1e3 * NORTH, **upside_down)
    write(tmp_path / "n.gse", "GSE2", "HNN", 1e3 * NORTH)
    both = read_motion(tmp_path / "n.gse", "mm/s2", vertical=tmp_path / "z.gse")
    assert np.array_equal(both.vertical, -both.acceleration)


class TestRotation:
    """Motion in a direction from stated azimuths: a(azimuth) = N cos + E sin."""

    @pytest.mark.parametrize(
        ("codes", "azimuths"),
        [
            (("HNN", "HNE"), (180.0, 90.0)),
            (("HNN", "HNE"), (0.0, 270.0)),
            (("HN1", "HN2"), (30.0, 120.0)),
            (("HN1", "HN2"), (0.0, 70.0)),
            (("HN1", "HN2"), (200.0, 110.0)),
        ],
    )
    def test_by_station_xml(self, tmp_path, codes, azimuths):
        path = with_station_xml(tmp_path, codes, azimuths)
        (motion,) = af.read_motions(path, processing=[TO_45])
        basis = np.deg2rad(azimuths)
        north_east = np.linalg.solve(
            np.column_stack([np.cos(basis), np.sin(basis)]), np.array([NORTH, EAST])
        )
        expected = north_east.sum(axis=0) / np.sqrt(2.0)
        # Of counts the mean is removed.
        assert np.allclose(motion.acceleration, expected - expected.mean(), atol=2e-5)

    def test_by_sac_headers_of_two_files(self, tmp_path):
        for code, azimuth, samples in (("HNN", 180.0, NORTH), ("HNE", 90.0, EAST)):
            stated = {"cmpaz": azimuth, "cmpinc": 90.0}
            write(tmp_path / f"x.{code}.sac", "SAC", code, samples, sac=stated)
        (motion,) = af.read_motions(tmp_path / "*.sac", unit="m/s2", processing=[TO_45])
        assert np.allclose(
            motion.acceleration, (EAST - NORTH) / np.sqrt(2.0), atol=1e-6
        )

    def test_where_components_must_be_at_right_angles(self):
        about = {"azimuth": 10.0, "of_transverse": {"azimuth": 75.0}}
        skewed = Motion(NORTH, 0.01, transverse=EAST, metadata=about, id="m")
        angle = "azimuths 10 and 75 degrees, not at right angles"
        refused(lambda: rotate(skewed, angle=30.0), angle, "give an azimuth instead")
        refused(
            lambda: skewed.measures("RotD50(PGA)"),
            angle,
            "rotate them to an azimuth first",
        )
        turned = rotate(Motion(NORTH, 0.01, transverse=EAST), angle=30.0)
        refused(lambda: rotate(turned, azimuth=0.0), "is not known; give an angle")


class TestStationXml:
    def test_total_sensitivity_against_stages(self, tmp_path):
        assert said(with_station_xml(tmp_path, total=1.01 * SCALE)) == []
        for total in (0.1 * SCALE, 1.05 * SCALE, -SCALE):
            path = with_station_xml(tmp_path, total=total)
            (text,) = said(path)
            both = (
                f"a total sensitivity of {total:.6g} and stages whose product is 200000"
            )
            assert both in text
            motion = read_motion(path, accept=["pga"])
            assert motion.metadata["cautions"] == [text]
            assert f"Caution: {text}." in motion.log

    @pytest.mark.parametrize(
        ("options", "parts"),
        [
            ({"units": ("M/S", "COUNTS")}, ["200000 counts/(M/S)"]),
            ({"units": ("M/S**2", "V"), "total": 0.5}, ["0.5 v/(M/S**2)"]),
            (
                {"dips": (-90.0, 0.0)},
                ["HNN is horizontal by its code", "a dip of -90 degrees"],
            ),
            ({"dips": (-35.0, -35.0)}, ["neither vertical nor horizontal"]),
        ],
    )
    def test_contradictions(self, tmp_path, options, parts):
        path = with_station_xml(tmp_path, **options)
        refused(lambda: read_motion(path), *parts, start=path)

    def test_a_dip_tells_which_channel_is_vertical(self, tmp_path):
        path = with_station_xml(tmp_path, ("HN1", "HN3"), dips=(0.0, -90.0))
        motion = read_motion(path)
        assert motion.facts.of_vertical.component == "HN3"

    def test_a_sensor_below_the_ground_is_named(self, tmp_path):
        assert said(with_station_xml(tmp_path, depth=2.0)) == []
        path = with_station_xml(tmp_path, depth=103.0)
        assert said(path) == [
            "channel HNN is 103 m below the surface by its StationXML"
        ]
        two = [
            Trace(
                NORTH,
                {"station": "S", "location": place, "channel": "HNE", "delta": 0.01},
            )
            for place in ("00", "10")
        ]
        Stream(two).write(str(tmp_path / "two.mseed"), format="MSEED")
        (text,) = said(tmp_path / "two.mseed", "m/s2")
        assert text.endswith("at locations 00 and 10; one may be in a borehole")
        path = write(tmp_path / "b.sac", "SAC", sac={"stdp": 100.0})
        assert said(path, "m/s2") == [
            "channel HNE is 100 m below the surface by its SAC header"
        ]


@pytest.mark.parametrize("samples", [NORTH + 1j, np.ma.masked_greater(NORTH, 0.5)])
def test_samples_of_obspy_that_are_no_real_numbers(samples):
    with pytest.raises(RecordError, match=r"has (complex samples|gaps)"):
        Motion.from_obspy(Trace(samples))
