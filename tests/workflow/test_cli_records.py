"""`archfrag records ...`: what each command prints, writes, draws and refuses."""

import json
from xml.etree import ElementTree

import numpy as np
import pytest
from obspy import Stream, Trace, UTCDateTime

from archfrag.motions.index import load_index
from archfrag.motions.read import load_motion
from archfrag.motions.selection import read_flatfile, target_of_index
from archfrag.motions.synthetic import make_motion, plan_motions
from tests.motions.fdsn_server import EVENT, data_centre
from tests.motions.helpers import SHIPPED, at2_text, wave
from tests.study.small import command, files_below

PEAK = 0.3 * np.abs(wave()).max()  # [g]
SCENARIO = (
    "--magnitude",
    "6.5",
    "--distance",
    "20",
    "--vs30",
    "760",
    "--period",
    "0.5",
)
PLAN = (
    "--events",
    "2",
    "--records-per-event",
    "2",
    "--magnitude",
    "6:7",
    "--distance-km",
    "10,20",
    "--sites",
    "3",
    "--vs30",
    "500",
    "--vertical",
    "--pulses",
    "0.5",
    "--seed",
    "4",
)


def done(*arguments):
    result = command("records", *arguments)
    assert result.exit_code == 0, result.stderr
    return result


def facts(*arguments):
    """JSON of a command; nothing else may be on its standard output."""
    return json.loads(done(*arguments, "--json").stdout)


def refused(*arguments, code=2):
    result = command("records", *arguments)
    assert (result.exit_code, result.stdout) == (code, "")
    assert result.stderr.startswith("archfrag: error: ")
    assert result.stderr.count("\n") == 1
    return result.stderr.removeprefix("archfrag: error: ").rstrip("\n")


def texts(svg):
    """Words of a figure that is complete XML."""
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
        "starttime": UTCDateTime(9.0e8),
    }
    shape = np.random.default_rng(1).normal(size=777)
    Stream(
        [
            Trace(k * shape, {**header, "channel": code})
            for k, code in enumerate(("HNE", "HNN", "HNZ"), start=1)
        ]
    ).write(str(path), format="MSEED")
    return path


@pytest.fixture(scope="module")
def flatfile(tmp_path_factory):
    path = tmp_path_factory.mktemp("flatfile") / "flat.csv"
    done("measure", *sorted((SHIPPED / "synthetic").glob("*.mseed")), "--out", path)
    return path


@pytest.mark.parametrize(
    ("arguments", "code", "part"),
    [
        ("measure {three} --out {tmp}/f.csv", 2, "three.mseed"),
        (
            "make --out {tmp}/o --vertical",
            2,
            "--events, --magnitude, --distance-km: needed",
        ),
        ("make --out {tmp}/o --magnitude 6,x", 2, "--magnitude 6,x: "),
        (
            "make --out {tmp}/o --magnitude 6 --events 1 --distance-km 5,400",
            2,
            "from 0 to 300",
        ),
        ("measure {tmp}/no.AT2 --out {tmp}/f.csv", 2, "no.AT2"),
        ("measure {at2} --out {tmp}/no/f.csv", 4, "no/f.csv"),
        ("measure {at2} --out {tmp}/f.csv --periods 0.5,x", 2, "--periods 0.5,x: "),
        ("measure {at2} --out {tmp}/f.csv --periods nan", 2, "--periods nan: "),
        (
            "measure {at2} --out {tmp}/f.csv --periods 0.1234",
            2,
            "of at most three decimals",
        ),
        (
            "select {flat} --target t.csv --sa 0.2",
            2,
            "--target and --sa: a target is a file or",
        ),
        (
            "select {flat} --distance 9 --vs30 760 --period 1",
            2,
            "--magnitude is needed",
        ),
        (
            f"select {{flat}} {' '.join(SCENARIO)}",
            2,
            "a scenario; one of --sa and --epsilon",
        ),
    ],
)
def test_what_is_refused_writes_nothing(
    flatfile, at2, three, tmp_path, arguments, code, part
):
    before = files_below(tmp_path)
    asked = arguments.format(at2=at2, three=three, tmp=tmp_path, flat=flatfile).split()
    if asked[0] == "select":
        asked += ["--count", "4", "--out", tmp_path / "s.csv"]
    assert part in refused(*asked, code=code)
    assert files_below(tmp_path) == before


class TestInspect:
    def test_channels_in_text_and_json(self, at2, three):
        (found,) = facts("inspect", at2)
        assert (found["format"], found["event"]) == ("AT2", "Imperial Valley-02")
        (channel,) = found["channels"]
        assert (channel["code"], channel["unit"], channel["count"]) == ("180", "g", 400)
        assert channel["PGA"] == pytest.approx(PEAK * 9.80665, rel=1e-6)
        assert channel["errors"] == found["errors"] == []
        text = done("inspect", three, "--unit", "m/s2").stdout.splitlines()
        assert text[0] == f"{three}: MSEED, XX.AB"
        assert text[1].startswith(
            "  HNE       777 samples at 0.005 s, 3.88 s, m/s2, PGA 0."
        )

    def test_faults_are_listed_and_nothing_is_refused(self, tmp_path, three):
        wrong = tmp_path / "wrong.AT2"
        gap = tmp_path / "gap.mseed"
        wrong.write_text(at2_text(300.0 + wave(), count=500))
        Stream(
            Trace(
                wave(count),
                {
                    "station": "AB",
                    "delta": 0.01,
                    "channel": code,
                    "starttime": UTCDateTime(start),
                },
            )
            for code, start, count in (
                ("HNE", 100, 300),
                ("HNE", 110, 300),
                ("HNN", 100, 310),
            )
        ).write(str(gap), format="MSEED")
        first, second, third = facts("inspect", wrong, three, gap)
        errors = first["channels"][0]["errors"]
        for fault, part in zip(
            errors[:3], ("announces 500", "offset", "peak"), strict=True
        ):
            assert part in fault
        assert (second["channels"][0]["unit"], second["channels"][0]["PGA"]) == (
            "",
            None,
        )
        assert "has a gap of 7 s" in third["errors"][0]
        assert "    ! the header announces 500" in done("inspect", wrong).stdout

    def test_an_unreadable_file_among_others(self, at2, tmp_path):
        lost = tmp_path / "lost.AT2"
        odd = tmp_path / "odd.bin"
        odd.write_bytes(b"\1\2\3")
        result = command("records", "inspect", lost, at2, odd)
        assert result.exit_code == 2
        assert "180       400 samples" in result.stdout
        first, second = result.stderr.splitlines()
        assert first == f"archfrag: error: {lost}: there is no such file"
        assert second.startswith(
            f"archfrag: error: {odd}: the format is not recognised"
        )
        found = json.loads(command("records", "inspect", lost, at2, "--json").stdout)
        assert ["error" in entry for entry in found] == [True, False]


def test_fetch_continues_and_its_exit_code_tells_what_may_pass(monkeypatch, tmp_path):
    monkeypatch.setenv("no_proxy", "127.0.0.1")
    with data_centre() as centre:
        asked = (
            "fetch",
            EVENT,
            "--from",
            centre.address,
            "--events-from",
            centre.address,
            "--after",
            "20",
            "--out",
        )
        result = done(*asked, tmp_path, "--channels", "HN?,BN?")
        assert result.stdout == f"3 records fetched, 0 were there: {tmp_path}\n"
        found = facts(*asked, tmp_path)
        assert (found["new"], len(found["kept"]), found["failures"]) == ([], 3, [])
        assert [entry.metadata["event"] for entry in load_index(tmp_path)] == [
            EVENT
        ] * 3
        centre.faults |= {("dataselect", "BOTH"): 503, ("dataselect", "NEAR"): 204}
        result = command("records", *asked, tmp_path / "other", "--json")
        assert result.exit_code == 7
        kinds = [entry["kind"] for entry in json.loads(result.stdout)["failures"]]
        assert kinds == ["no data", "service"]
        assert "1 request failed; try again later" in result.stderr.splitlines()[-1]
        centre.faults |= {
            ("dataselect", name): 204 for name in ("NEAR", "BOTH", "SLOW")
        }
        result = command("records", *asked, tmp_path / "none")
        assert result.exit_code == 2
        assert "no record was fetched" in result.stderr.splitlines()[-1]


class TestMake:
    def test_they_are_those_of_the_same_plan(self, tmp_path):
        found = facts("make", "--out", tmp_path / "a", *PLAN)
        names = ["e1-r1.mseed", "e1-r2.mseed", "e2-r1.mseed", "e2-r2.mseed"]
        assert [file.rsplit("/", 1)[1] for file in found["files"]] == names
        recipes = plan_motions(
            2,
            2,
            magnitude=[6.0, 7.0],
            distance=[10.0, 20.0],
            drawn_magnitude=True,
            sites=3,
            vs30=500.0,
            vertical=True,
            pulses=0.5,
            seed=4,
        )
        for entry, recipe in zip(load_index(tmp_path / "a"), recipes, strict=True):
            read = load_motion(entry)
            motion = make_motion(recipe)
            assert np.array_equal(read.acceleration, motion.acceleration)
            assert np.array_equal(read.vertical, motion.vertical)
            for key in ("seed", "event_seed", "site_seed"):
                assert entry.metadata[key] == motion.metadata[key]

    def test_the_shipped_ones_unless_an_index_lists_other_records(self, at2, tmp_path):
        text = done("make", "--out", tmp_path / "a").stdout
        assert text == f"30 records and index.csv written to {tmp_path / 'a'}\n"
        assert (tmp_path / "a" / "index.csv").read_text() == (
            SHIPPED / "index.csv"
        ).read_text()
        listed = tmp_path / "o" / "index.csv"
        listed.parent.mkdir()
        listed.write_text("id,file,unit\nrecord,record.AT2,g\n")
        before = files_below(tmp_path / "o")
        message = refused("make", "--out", tmp_path / "o", *PLAN)
        assert "lists other records (record)" in message
        assert files_below(tmp_path / "o") == before


def test_columns_of_a_plain_text_are_known_to_each_command(at2, tmp_path):
    text = tmp_path / "plain.txt"
    out = tmp_path / "flat.csv"
    rows = (f"{0.01 * i:.2f}, {value:.6f}" for i, value in enumerate(0.3 * wave()))
    text.write_text("\n".join(["any words", *rows]) + "\n")
    known = ("--unit", "g", "--columns", "time=1,acceleration=2,skip=1")
    peak = pytest.approx(PEAK * 9.80665, rel=1e-4)
    assert facts("inspect", text, *known)[0]["channels"][0]["PGA"] == peak
    rows = facts("measure", text, at2, *known, "--out", out)
    assert [row["columns"] for row in rows] == ["acceleration=2 time=1 skip=1", None]
    (tmp_path / "target.csv").write_text("period_s,Sa_g\n0.2,0.4\n0.5,0.3\n")
    asked = ("--target", tmp_path / "target.csv", "--count", "2", "--max-scale", "100")
    done("select", out, *asked, "--out", tmp_path / "selected.csv")
    motions = {
        entry.id: load_motion(entry) for entry in load_index(tmp_path / "selected.csv")
    }
    assert np.abs(motions["plain"].acceleration).max() == peak


class TestMeasure:
    def test_a_flatfile_with_a_figure(self, at2, three, tmp_path):
        out = tmp_path / "flat.csv"
        figure = tmp_path / "spectra.svg"
        (row,) = facts("measure", at2, "--out", out, "--figure", figure)
        assert row["PGA_g"] == pytest.approx(PEAK, rel=1e-4)
        (file,) = read_flatfile(out)["file"]
        assert (out.parent / file).samefile(at2)
        assert "Sa, 5 % damping [g]" in texts(figure)
        assert "f.png: figures and films are written as .svg" in refused(
            "measure", at2, "--out", out, "--figure", tmp_path / "f.png"
        )
        text = done("measure", three, "--unit", "m/s2", "--out", out).stdout
        assert text == f"2 components measured: {out}\n"

    def test_many_files_stay_in_order(self, tmp_path):
        files = [tmp_path / f"r{number % 7}-{number:02d}.AT2" for number in range(40)]
        for number, file in enumerate(files):
            file.write_text(at2_text((0.1 + 0.01 * number) * wave()))
        rows = facts(
            "measure", *files, "--out", tmp_path / "f.csv", "--periods", "0.33"
        )
        assert [row["record"] for row in rows] == [file.stem for file in files]
        (one,) = facts(
            "measure", files[9], "--out", tmp_path / "g.csv", "--periods", "0.33"
        )
        assert rows[9] == one
        assert one["T0.330S"] > 0.0
        files[20].write_text("no record")
        assert "r6-20.AT2" in refused("measure", *files, "--out", tmp_path / "h.csv")
        assert not (tmp_path / "h.csv").exists()


def test_select_for_targets_of_levels_gives_an_index_of_levels(flatfile, tmp_path):
    out = tmp_path / "selected.csv"
    target = tmp_path / "targets.csv"
    target.write_text(
        "level,period_s,Sa_g,sd\n"
        + "".join(
            f"{level},{period},{level * share},{sd}\n"
            for level in (0.1, 0.4)
            for period, share, sd in ((0.2, 1.2, 0.3), (0.5, 1.0, 0.0), (1.0, 0.5, 0.3))
        )
    )
    options = ("--target", target, "--count", "4", "--max-scale", "100", "--out", out)
    found = facts("select", flatfile, *options, "--figure", tmp_path / "spectra.svg")[
        "levels"
    ]
    for level in ("0.1", "0.4"):
        assert found[level]["target_median_g"][1] == pytest.approx(float(level))
    entries = load_index(out)
    for level in (0.1, 0.4):
        own = {entry.id for entry in entries if level in entry.levels}
        assert own == {*found[f"{level:g}"]["records"]}
        assert (tmp_path / f"spectra-{level:g}.svg").exists()
    rows = out.read_text().splitlines()
    assert len(rows) == 9
    assert sum(len(entry.levels) for entry in entries) == 8
    assert target_of_index(out) is None  # the report has no figure of several targets
    assert (
        "level 0.4: 4 records selected of" in done("select", flatfile, *options).stdout
    )
    target.write_text(target.read_text().replace("0.4,0.2", "-0.4,0.2"))
    assert "level -0.4: a level must be a number above 0" in refused(
        "select", flatfile, *options
    )


def test_select_for_a_scenario_gives_an_index(flatfile, tmp_path):
    out = tmp_path / "selected.csv"
    figure = tmp_path / "selected.svg"
    options = (*SCENARIO, "--epsilon", "0.5", "--count", "5", "--out", out)
    found = facts("select", flatfile, *options, "--figure", figure)
    assert len(found["records"]) == len(load_index(out)) == 5
    assert load_motion(load_index(out)[0]).duration > 1.0
    assert "period" in texts(figure).lower()
    assert done("select", flatfile, *options).stdout.startswith(
        "5 records selected of "
    )
