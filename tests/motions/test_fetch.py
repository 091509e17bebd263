"""Records from a data centre: what comes, what does not, and what is left of it on the disk."""

import csv
import time

import numpy as np
import pytest

from archfrag.errors import InputError
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
    endless,
    miniseed,
    quakeml,
    silent,
    station_xml,
)

PATIENT, QUICK = Limits(seconds=20.0, megabytes=1.0), Limits(seconds=0.5, megabytes=1.0)
NEAR, BOTH, SLOW = (
    f"{EVENT}_IV.NEAR..HN", f"{EVENT}_IV.BOTH..HN", f"{EVENT}_IV.SLOW.00.BN"
)  # fmt: skip


@pytest.fixture(autouse=True)
def _no_proxy(monkeypatch):
    monkeypatch.setenv("no_proxy", "127.0.0.1")


@pytest.fixture
def centre():
    with data_centre() as found:
        yield found


def request(centre, *events, **options):
    defaults = {"events_from": centre.address, "after": 20.0, "before": 5.0, "limits": PATIENT}
    return Request(events or (EVENT,), centre.address, **{**defaults, **options})


def tree(folder):
    return {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def fetch(centre, folder, *events, **options):
    messages = []
    result = fetch_records(request(centre, *events, **options), folder, messages.append)
    return result, messages


class TestWhatComes:
    def test_records_that_can_be_read_with_an_index(self, centre, tmp_path):
        result, messages = fetch(centre, tmp_path)
        assert result.new == [NEAR, BOTH, SLOW]
        assert (result.kept, result.refused) == ([], [])
        assert messages[0] == f"{EVENT} IV.NEAR: HNE HNN HNZ, 11.1 km from the epicentre"
        entries = {entry.id: entry for entry in load_index(tmp_path)}
        assert list(entries) == sorted(result.new)
        motion = load_motion(entries[NEAR])
        assert np.abs(motion.acceleration).max() == pytest.approx(1.0, rel=2e-2)
        assert np.abs(motion.vertical).max() == pytest.approx(3.0, rel=2e-2)
        facts = entries[NEAR].metadata
        assert facts["event"] == EVENT
        assert (facts["Mw"], facts["magnitude"], facts["magnitude_type"]) == (5.6, "5.4", "ml")
        assert float(facts["epicentral_km"]) == pytest.approx(11.1, abs=0.05)
        assert facts["distance_km"] == pytest.approx(np.hypot(11.1, 8.0), abs=0.05)
        assert motion.metadata["start_time"] == str(ORIGIN - 5.0)
        assert (tmp_path / EVENT / "event.xml").read_bytes() == centre.quakeml

    def test_the_best_kind_of_channel_that_has_data(self, centre, tmp_path):
        centre.faults["dataselect", "NEAR"] = 204
        result, messages = fetch(centre, tmp_path, channels=("BN", "HN"))
        assert result.new == [f"{EVENT}_IV.BOTH..BN", SLOW]
        assert [refusal.kind for refusal in result.refused] == ["no data"]
        assert messages[0].startswith(
            f"{EVENT} IV.NEAR: {centre.address}/fdsnws/dataselect/1: holds"
        )

    def test_the_nearest_within_the_radius(self, centre, tmp_path):
        assert fetch(centre, tmp_path / "a", most=1)[0].new == [NEAR]
        assert fetch(centre, tmp_path / "b", radius=25.0)[0].new == [NEAR, BOTH]
        result, messages = fetch(centre, tmp_path / "c", radius=5.0)
        assert not result.new
        assert messages[0].startswith(f"event {EVENT}: {centre.address}/fdsnws/station/1: holds n")


class TestGoingOn:
    def test_what_is_there_is_not_asked_for_again(self, centre, tmp_path):
        fetch(centre, tmp_path)
        before, asked = tree(tmp_path), centre.count("dataselect")
        result, _ = fetch(centre, tmp_path)
        assert (result.new, sorted(result.kept)) == ([], sorted([NEAR, BOTH, SLOW]))
        assert centre.count("dataselect") == asked
        assert tree(tmp_path) == before

    @pytest.mark.parametrize("lost", ["mseed", "xml", "cut"])
    def test_what_is_lost_or_damaged_comes_again(self, centre, tmp_path, lost):
        fetch(centre, tmp_path)
        record = tmp_path / EVENT / f"{NEAR}.mseed"
        if lost == "cut":
            record.write_bytes(record.read_bytes()[:512])
        else:
            (record if lost == "mseed" else record.with_name("IV.NEAR.xml")).unlink()
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
        left = tmp_path / EVENT / ".fetch-abc"
        left.mkdir(parents=True)
        (left / "half.mseed").write_bytes(b"half")
        (tmp_path / ".index.csv.ab_1.tmp").write_bytes(b"half")
        (tmp_path / EVENT / ".event.xml.ab_1.tmp").write_bytes(b"half")
        fetch(centre, tmp_path)
        assert not left.exists()
        assert not [path for path in tree(tmp_path) if path.name.startswith(".")]


def index_of(folder):
    with open(folder / "index.csv", newline="") as file:
        return [{k: v for k, v in row.items() if k != "sha256"} for row in csv.DictReader(file)]


class TestWhatDoesNotCome:
    @pytest.mark.parametrize(
        ("fault", "kind", "reason"),
        [
            (204, "no data", "holds nothing that was asked for"),
            (400, "unusable", "refuses the request, error 400 (the server says why at length)"),
            (403, "unusable", "the data are not open to all (the server says why at length)"),
            (413, "too large", "more was asked for than the service gives at once"),
            (429, "service", "answers with error 429"),
            (500, "service", "answers with error 500 (the server says why at length)"),
            (b"", "no data", "holds nothing that was asked for"),
            (silent(), "timeout", "no complete answer within 0.5 s"),
            (dripping(), "timeout", "no complete answer within 0.5 s"),
            (endless, "too large", "the answer is larger than the 1 MB allowed"),
            (broken_off(b"abc"), "service", "the answer broke off after 3 of 1003 bytes"),
        ],
        ids=[204, 400, 403, 413, 429, 500, "empty", "silent", "dripping", "endless", "broken off"],
    )  # fmt: skip
    @pytest.mark.parametrize("service", ["event", "station", "dataselect"])
    def test_one_line_and_nothing_half_written(
        self, centre, tmp_path, service, fault, kind, reason
    ):
        station = "" if service != "dataselect" else "NEAR"
        centre.faults[service, station] = fault
        started = time.monotonic()
        limits = QUICK if kind == "timeout" else PATIENT
        result, messages = fetch(centre, tmp_path, most=1, limits=limits)
        assert time.monotonic() - started < 4.0
        assert [refusal.kind for refusal in result.refused] == [kind]
        assert len(messages) == 1
        assert f"{centre.address}/fdsnws/{service}/1: " in messages[0]
        assert reason in messages[0]
        assert "\n" not in messages[0]
        assert {path.name for path in tree(tmp_path)} <= {"event.xml"}

    @pytest.mark.parametrize(
        ("fault", "reason"),
        [
            (b"no miniSEED at all", "the format is not recognised"),
            (miniseed("NEAR", "", ["HNZ"], ORIGIN, ORIGIN + 9), "holds only the vertical"),
            (
                miniseed("NEAR", "", ["HNE"], ORIGIN, ORIGIN + 9)
                + miniseed("NEAR", "", ["HNE"], ORIGIN + 12, ORIGIN + 20),
                "has a gap of 3",
            ),
            (miniseed("NEAR", "", ["HNE"], ORIGIN, ORIGIN + 9, peak=5e-5), "peak of channel HNE"),
            (miniseed("NEAR", "", ["HNE"], ORIGIN, ORIGIN + 9)[:-100], "truncated or not"),
        ],
    )
    def test_waveforms_that_are_no_record_are_not_kept(self, centre, tmp_path, fault, reason):
        centre.faults["dataselect", "NEAR"] = fault
        result, messages = fetch(centre, tmp_path, most=1)
        assert [refusal.kind for refusal in result.refused] == ["unusable"]
        assert messages[0].startswith(f"{tmp_path / EVENT / NEAR}.mseed: ")
        assert reason in messages[0]
        assert {path.name for path in tree(tmp_path)} == {"event.xml"}

    @pytest.mark.parametrize(
        ("service", "station", "fault", "reason"),
        [
            ("event", "", b"<html>Welcome</html>", "is not QuakeML"),
            ("event", "", quakeml(origins=False), "has no origin"),
            ("event", "", b"<!DOCTYPE x [<!ENTITY a SYSTEM 'file:///etc/passwd'>]>" + quakeml(),
             "is not plain QuakeML"),
            ("station", "", b"{}", "the list of stations is not StationXML"),
            ("station", "NEAR", b"<a>", "the responses of IV.NEAR is not StationXML"),
            ("station", "NEAR", station_xml(["FAR"]), "the StationXML has no response for"),
        ],
    )  # fmt: skip
    def test_answers_in_another_language(self, centre, tmp_path, service, station, fault, reason):
        centre.faults[service, station] = fault
        result, messages = fetch(centre, tmp_path, most=1)
        assert [refusal.kind for refusal in result.refused] == ["unusable"]
        assert reason in messages[0]
        assert {path.name for path in tree(tmp_path)} <= {"event.xml"}

    def test_codes_that_are_paths_name_no_file(self, centre, tmp_path):
        centre.faults["station", ""] = station_xml(["NEAR"]).replace(b'"NEAR"', b'"../../X"')
        result, messages = fetch(centre, tmp_path / "in", most=1)
        assert [refusal.kind for refusal in result.refused] == ["unusable"]
        assert "cannot name a file" in messages[0]
        assert {path.name for path in tree(tmp_path)} == {"event.xml"}

    def test_a_service_that_fails_is_left_alone(self, centre, tmp_path):
        for station in ("NEAR", "BOTH", "SLOW"):
            centre.faults["dataselect", station] = 500
        result, messages = fetch(centre, tmp_path, radius=400.0)
        assert centre.count("dataselect") == 3
        assert len(result.passing) == 4
        assert messages[3] == (
            f"{centre.address}: 3 requests in a row failed; 1 stations of event {EVENT} were not "
            "asked for"
        )

    def test_a_service_that_is_not_there(self, tmp_path):
        with data_centre() as centre:
            gone = centre
        result, messages = fetch(gone, tmp_path)
        assert [refusal.kind for refusal in result.refused] == ["service"]
        assert messages[0].endswith("the service cannot be reached (Connection refused)")
        assert tree(tmp_path) == {}

    def test_a_redirection_to_a_file_is_not_followed(self, centre, tmp_path):
        def elsewhere(handler):
            handler.send_response(302)
            handler.send_header("Location", "file:///etc/hostname")
            handler.end_headers()

        centre.faults["event", ""] = elsewhere
        result, _ = fetch(centre, tmp_path)
        assert [refusal.kind for refusal in result.refused] == ["unusable"]


class TestRequests:
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
    def test_what_cannot_be_asked_for(self, centre, tmp_path, options, reason):
        with pytest.raises(InputError, match=reason):
            fetch(centre, tmp_path, **options)
