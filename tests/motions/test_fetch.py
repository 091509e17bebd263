"""Records from a data centre: what comes, what does not, and what is left of it on the disk."""

import numpy as np
import pytest

from archfrag.errors import InputError
from archfrag.motions.fetch import fetch_records
from archfrag.motions.index import load_index
from archfrag.motions.read import load_motion

from . import fdsn_server as fdsn
from .fdsn_server import EVENT, ORIGIN, data_centre

NEAR, BOTH, SLOW = (
    f"{EVENT}_IV.{end}" for end in ("NEAR..HN", "BOTH..HN", "SLOW.00.BN")
)


@pytest.fixture
def centre(monkeypatch):
    monkeypatch.setenv("no_proxy", "127.0.0.1")
    with data_centre() as found:
        yield found


def fetch(centre, folder, **options):
    """Ids of new and of kept records, and kinds and messages of failures."""
    defaults = {
        "after": 20.0,
        "before": 5.0,
        "timeout": 20.0,
        "radius": 100.0,
        "channels": ("HN", "EN", "BN"),
        "most": 100,
    }
    options = {**defaults, **options}
    services = centre.address, options.pop("events_from", centre.address)
    found = list(fetch_records(folder, (EVENT,), services, **options))
    new, kept = (
        [id for kind, id in found if kind == kind_of] for kind_of in ("new", "kept")
    )
    return new, kept, [each for each in found if each[0] not in ("new", "kept")]


class TestWhatComes:
    def test_records_that_can_be_read_with_an_index(self, centre, tmp_path):
        new, kept, failures = fetch(centre, tmp_path)
        assert (new, kept, failures) == ([NEAR, BOTH, SLOW], [], [])
        entries = {entry.id: entry for entry in load_index(tmp_path)}
        assert list(entries) == sorted(new)
        motion = load_motion(entries[NEAR])
        facts = entries[NEAR].metadata
        assert np.abs(motion.acceleration).max() == pytest.approx(1.0, rel=2e-2)
        assert np.abs(motion.vertical).max() == pytest.approx(3.0, rel=2e-2)
        assert [facts[key] for key in ("event", "Mw", "magnitude")] == [
            EVENT,
            5.6,
            "5.4",
        ]
        assert float(facts["epicentral_km"]) == pytest.approx(11.1, abs=0.05)
        assert facts["distance_km"] == pytest.approx(np.hypot(11.1, 8.0), abs=0.05)
        assert motion.metadata["start_time"] == str(ORIGIN - 5.0)
        assert (tmp_path / EVENT / "event.xml").is_file()

    def test_the_best_kind_of_channel_that_has_data(self, centre, tmp_path):
        centre.faults["dataselect", "NEAR"] = 204
        new, _, ((kind, message),) = fetch(centre, tmp_path, channels=("BN", "HN"))
        assert (new, kind) == ([f"{EVENT}_IV.BOTH..BN", SLOW], "no data")
        assert message.startswith(f"{EVENT} IV.NEAR: {centre.address}")

    def test_the_nearest_within_the_radius(self, centre, tmp_path):
        assert fetch(centre, tmp_path / "b", radius=25.0)[0] == [NEAR, BOTH]
        assert fetch(centre, tmp_path / "b", most=1)[1] == [NEAR]
        new, _, ((kind, message),) = fetch(centre, tmp_path / "c", radius=5.0)
        assert (new, kind) == ([], "no data")
        assert message.startswith(f"event {EVENT}: {centre.address}")

    def test_what_is_there_is_not_asked_for_again_what_is_lost_is(
        self, centre, tmp_path
    ):
        fetch(centre, tmp_path)
        asked = centre.asked.count("dataselect")
        assert fetch(centre, tmp_path)[:2] == ([], [NEAR, BOTH, SLOW])
        assert centre.asked.count("dataselect") == asked
        record = tmp_path / EVENT / f"{NEAR}.mseed"
        for lose in (
            record.unlink,
            record.with_name("IV.NEAR.xml").unlink,
            lambda: record.write_bytes(record.read_bytes()[:512]),
        ):
            lose()
            assert fetch(centre, tmp_path)[0] == [NEAR]
        # Another window comes anew.
        assert fetch(centre, tmp_path, most=1, after=10.0)[0] == [NEAR]
        motions = [load_motion(entry) for entry in load_index(tmp_path)]
        assert min(motion.duration for motion in motions) == pytest.approx(
            15.0, abs=0.1
        )


def wave_of(channel, start=0.0, end=9.0):
    return fdsn.miniseed("NEAR", "", [channel], ORIGIN + start, ORIGIN + end)


DATA = ("dataselect", "NEAR")
EVENTS = ("event", "")
LIST = ("station", "")
RESPONSE = ("station", "NEAR")


class TestWhatDoesNotCome:
    @pytest.mark.parametrize(
        ("place", "fault", "kind", "reason"),
        [
            (DATA, 204, "no data", "No data available"),
            (EVENTS, 403, "unusable", "Authentication failed"),
            (DATA, 429, "service", "too many requests"),
            (LIST, fdsn.silent, "service", "Timed Out"),
            (EVENTS, fdsn.broken_off, "service", "IncompleteRead"),
            (DATA, b"no miniSEED at all", "unusable", "the format is not recognised"),
            (
                DATA,
                wave_of("HNE") + wave_of("HNE", 12, 20),
                "unusable",
                "has a gap of 3",
            ),
            (DATA, wave_of("HNE")[:-100], "unusable", "truncated or not"),
            (EVENTS, fdsn.quakeml(origins=False), "unusable", "has no origin"),
            (RESPONSE, fdsn.station_xml(["FAR"]), "unusable", "no response for"),
            (
                LIST,
                fdsn.station_xml(["NEAR"]).replace(b'"NEAR"', b'"../../X"'),
                "unusable",
                "cannot name a file",
            ),
        ],
    )
    def test_one_line_and_nothing_half_written(
        self, centre, tmp_path, place, fault, kind, reason
    ):
        centre.faults[place] = fault
        timeout = 0.5 if fault is fdsn.silent else 20.0
        _, _, (failure,) = fetch(centre, tmp_path / "in", most=1, timeout=timeout)
        assert failure[0] == kind
        assert reason in failure[1]
        assert "\n" not in failure[1]
        assert {p.name for p in tmp_path.rglob("*") if p.is_file()} <= {"event.xml"}

    def test_a_service_that_fails_is_left_alone(self, centre, tmp_path):
        centre.faults |= {
            ("dataselect", name): 500 for name in ("NEAR", "BOTH", "SLOW")
        }
        _, _, failures = fetch(centre, tmp_path, radius=400.0)
        assert centre.asked.count("dataselect") == 3
        assert [kind for kind, _ in failures] == ["service"] * 3
        assert failures[2][1].endswith("; this service is left alone")

    def test_a_service_that_is_not_there(self, tmp_path):
        with data_centre() as centre:
            pass
        _, _, ((kind, message),) = fetch(centre, tmp_path)
        assert (kind, "Connection refused" in message) == ("service", True)
        assert list(tmp_path.rglob("*.*")) == []


@pytest.mark.parametrize("name", ["NOWHERE", "file:///etc", "https://"])
def test_what_is_no_service(centre, tmp_path, name):
    with pytest.raises(InputError, match="service"):
        fetch(centre, tmp_path, events_from=name)
