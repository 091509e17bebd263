"""Records from a data centre: what comes, what does not, and what is left of it on the disk."""

import csv
import os
import subprocess
import time

import numpy as np
import pytest

from archfrag.errors import InputError
from archfrag.files import temporary_prefix
from archfrag.motions.fdsn import Limits
from archfrag.motions.fetch import Request, fetch_records
from archfrag.motions.index import load_index
from archfrag.motions.read import load_motion

from .fdsn_server import (
    EVENT,
    ORIGIN,
    broken_off,
    data_centre,
    dripping,
    elsewhere,
    endless,
    length_of_words,
    miniseed,
    quakeml,
    redirected,
    silent,
    slow_headers,
    station_xml,
)

PATIENT, QUICK = Limits(seconds=20.0, megabytes=1.0), Limits(seconds=0.5, megabytes=1.0)
NEAR, BOTH, SLOW = (f"{EVENT}_IV.{end}" for end in ("NEAR..HN", "BOTH..HN", "SLOW.00.BN"))


@pytest.fixture(autouse=True)
def _no_proxy(monkeypatch):
    monkeypatch.setenv("no_proxy", "127.0.0.1")


@pytest.fixture
def centre():
    with data_centre() as found:
        yield found


def tree(folder):
    return {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def fetch(centre, folder, **options):
    messages = []
    defaults = {"events_from": centre.address, "after": 20.0, "before": 5.0, "limits": PATIENT}
    request = Request((EVENT,), centre.address, **{**defaults, **options})
    return fetch_records(request, folder, messages.append), messages


class TestWhatComes:
    def test_records_that_can_be_read_with_an_index(self, centre, tmp_path):
        result, messages = fetch(centre, tmp_path)
        assert (result.new, result.kept, result.refused) == ([NEAR, BOTH, SLOW], [], [])
        assert messages[0] == f"{EVENT} IV.NEAR: HNE HNN HNZ, 11.1 km from the epicentre"
        entries = {entry.id: entry for entry in load_index(tmp_path)}
        assert list(entries) == sorted(result.new)
        motion, facts = load_motion(entries[NEAR]), entries[NEAR].metadata
        assert np.abs(motion.acceleration).max() == pytest.approx(1.0, rel=2e-2)
        assert np.abs(motion.vertical).max() == pytest.approx(3.0, rel=2e-2)
        keys = ("event", "Mw", "magnitude", "magnitude_type")
        assert [facts[key] for key in keys] == [EVENT, 5.6, "5.4", "ml"]
        assert float(facts["epicentral_km"]) == pytest.approx(11.1, abs=0.05)
        assert facts["distance_km"] == pytest.approx(np.hypot(11.1, 8.0), abs=0.05)
        assert motion.metadata["start_time"] == str(ORIGIN - 5.0)
        assert (tmp_path / EVENT / "event.xml").read_bytes() == centre.quakeml

    def test_the_best_kind_of_channel_that_has_data(self, centre, tmp_path):
        centre.faults["dataselect", "NEAR"] = 204
        result, messages = fetch(centre, tmp_path, channels=("BN", "HN"))
        assert result.new == [f"{EVENT}_IV.BOTH..BN", SLOW]
        assert [refusal.kind for refusal in result.refused] == ["no data"]
        assert messages[0].startswith(f"{EVENT} IV.NEAR: {centre.address}/fdsnws/dataselect/1: ")

    def test_the_nearest_within_the_radius(self, centre, tmp_path):
        assert fetch(centre, tmp_path / "b", radius=25.0)[0].new == [NEAR, BOTH]
        result, messages = fetch(centre, tmp_path / "c", radius=5.0)
        assert not result.new
        assert messages[0].startswith(f"event {EVENT}: {centre.address}/fdsnws/station/1: holds n")


class TestGoingOn:
    def test_what_is_there_is_not_asked_for_again_what_is_lost_is(self, centre, tmp_path):
        fetch(centre, tmp_path)
        before, asked = tree(tmp_path), centre.asked.count("dataselect")
        result, _ = fetch(centre, tmp_path)
        assert (result.new, sorted(result.kept)) == ([], sorted([NEAR, BOTH, SLOW]))
        assert centre.asked.count("dataselect") == asked
        assert tree(tmp_path) == before
        record = tmp_path / EVENT / f"{NEAR}.mseed"
        for lose in (record.unlink, record.with_name("IV.NEAR.xml").unlink,
                     lambda: record.write_bytes(record.read_bytes()[:512])):  # fmt: skip
            lose()
            assert fetch(centre, tmp_path)[0].new == [NEAR]

    def test_after_a_failure_only_what_lacks_comes(self, centre, tmp_path):
        centre.faults["dataselect", "BOTH"] = 503
        result, _ = fetch(centre, tmp_path / "a")
        assert [refusal.kind for refusal in result.passing] == ["service"]
        assert [entry.id for entry in load_index(tmp_path / "a")] == [NEAR, SLOW]
        centre.faults.clear()
        result, _ = fetch(centre, tmp_path / "a")
        assert (result.new, result.kept) == ([BOTH], [NEAR, SLOW])
        fetch(centre, tmp_path / "b")
        assert index_of(tmp_path / "a") == index_of(tmp_path / "b")

    def test_another_window_comes_anew(self, centre, tmp_path):
        fetch(centre, tmp_path, most=1)
        result, _ = fetch(centre, tmp_path, most=1, after=10.0)
        assert result.new == [NEAR]
        (entry,) = load_index(tmp_path)
        assert load_motion(entry).duration == pytest.approx(15.0, abs=0.1)

    def test_what_a_killed_run_left_goes(self, centre, tmp_path):
        left = subprocess.Popen(["true"])
        left.wait()
        half = temporary_prefix().replace(f"-{os.getpid()}-", f"-{left.pid}-") + "abcd123"
        (tmp_path / EVENT / f"{half}1.tmp").mkdir(parents=True)
        mine = (f"{EVENT}/.fetch-notes", ".index.csv.old.tmp")
        for name in (f"{EVENT}/{half}1.tmp/half.mseed", f"{EVENT}/{half}2.tmp", *mine):
            (tmp_path / name).write_bytes(b"half")
        fetch(centre, tmp_path)
        assert {str(path) for path in tree(tmp_path) if "/." in f"/{path}"} == set(mine)


def index_of(folder):
    with open(folder / "index.csv", newline="") as file:
        return [{k: v for k, v in row.items() if k != "sha256"} for row in csv.DictReader(file)]


def wave_of(channel, start=0.0, end=9.0, **options):
    return miniseed("NEAR", "", [channel], ORIGIN + start, ORIGIN + end, **options)


UTF_7 = b'<?xml version="1.0" encoding="UTF-7"?>'
ENTITY = b"<!DOCTYPE x [<!ENTITY a SYSTEM 'file:///etc/passwd'>]>"
DATA, EVENTS, LIST, RESPONSE = (
    ("dataselect", "NEAR"), ("event", ""), ("station", ""), ("station", "NEAR")
)  # fmt: skip


class TestWhatDoesNotCome:
    @pytest.mark.parametrize(
        ("place", "fault", "kind", "reason"),
        [
            (DATA, 204, "no data", "holds nothing that was asked for"),
            (DATA, 400, "unusable", "error 400 (the server explains at length)"),
            (EVENTS, 403, "unusable", "not open to all (the server explains at length)"),
            (LIST, 413, "too large", "more was asked for than the service gives at once"),
            (DATA, 429, "service", "error 429 (the server explains at length)"),
            (LIST, b"", "no data", "holds nothing that was asked for"),
            (LIST, silent, "timeout", "within 0.5 s"),
            (DATA, dripping, "timeout", "within 0.5 s"),
            (DATA, endless, "too large", "larger than the 1 MB allowed"),
            (EVENTS, broken_off, "service", "broke off after 3 of 1003 bytes"),
            (EVENTS, redirected, "unusable", "refuses the request"),
            (EVENTS, elsewhere, "unusable", "points to another server, http://localhost:1/"),
            (EVENTS, slow_headers, "timeout", "within 0.5 s"),
            (EVENTS, length_of_words, "service", "states 'zzz' as the length"),
            (EVENTS, UTF_7 + quakeml(), "unusable", "is not plain QuakeML"),
            (EVENTS, quakeml().replace(b">40.0<", b">4500<"), "unusable", "latitude 4500"),
            (DATA, b"no miniSEED at all", "unusable", "the format is not recognised"),
            (DATA, wave_of("HNZ"), "unusable", "holds only the vertical"),
            (DATA, wave_of("HNE") + wave_of("HNE", 12, 20), "unusable", "has a gap of 3"),
            (DATA, wave_of("HNE", peak=5e-5), "unusable", "peak of channel HNE"),
            (DATA, wave_of("HNE")[:-100], "unusable", "truncated or not"),
            (EVENTS, quakeml(origins=False), "unusable", "has no origin"),
            (EVENTS, ENTITY + quakeml(), "unusable", "is not plain QuakeML"),
            (LIST, b"{}", "unusable", "the list of stations is not StationXML"),
            (RESPONSE, station_xml(["FAR"]), "unusable", "no response for"),
            (LIST, station_xml(["NEAR"]).replace(b'"NEAR"', b'"../../X"'), "unusable",
             "cannot name a file"),
        ],
    )  # fmt: skip
    def test_one_line_and_nothing_half_written(self, centre, tmp_path, place, fault, kind, reason):
        centre.faults[place] = fault
        started = time.monotonic()
        limits = QUICK if kind == "timeout" else PATIENT
        result, (message,) = fetch(centre, tmp_path / "in", most=1, limits=limits)
        assert time.monotonic() - started < 4.0
        assert [refusal.kind for refusal in result.refused] == [kind]
        assert reason in message
        assert "\n" not in message
        assert {path.name for path in tree(tmp_path)} <= {"event.xml"}

    def test_a_service_that_fails_is_left_alone(self, centre, tmp_path):
        centre.faults |= {("dataselect", name): 500 for name in ("NEAR", "BOTH", "SLOW")}
        result, messages = fetch(centre, tmp_path, radius=400.0)
        assert centre.asked.count("dataselect") == 3
        assert len(result.passing) == 4
        assert "3 requests in a row failed; 1 stations" in messages[3]

    def test_a_service_that_is_not_there(self, tmp_path):
        with data_centre() as centre:
            gone = centre
        _, messages = fetch(gone, tmp_path)
        assert messages[0].endswith("the service cannot be reached (Connection refused)")
        assert tree(tmp_path) == {}


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"radius": 1e5}, "radius .km. = 100000 must be from 0 to 2000"),
        ({"radius": float("nan")}, "radius .km. = nan must be from 0 to 2000"),
        ({"after": 0.0}, "after .s. = 0 must be from 1 to 7200"),
        ({"channels": ("HNE",)}, "channels 'HNE' must be two capitals"),
        ({"events_from": "NOWHERE"}, "'NOWHERE' is no data service that is known"),
        ({"events_from": "file:///etc"}, "'file:///etc' is no data service"),
        ({"events_from": "https://"}, "'https://' is not the address of a data service"),
    ],
)
def test_what_cannot_be_asked_for(centre, tmp_path, options, reason):
    with pytest.raises(InputError, match=reason):
        fetch(centre, tmp_path, **options)
