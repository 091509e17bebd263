"""The page and its figures: readable by themselves, and made of what was measured alone."""

import sys
from xml.etree import ElementTree

import pandas as pd
import pytest

import archfrag
from archfrag.errors import InputError
from archfrag.evidence import command
from archfrag.evidence.guide import PAGE, write_guide
from archfrag.evidence.part import Note, Section
from archfrag.evidence.peers.client import peer_versions
from archfrag.report.canvas import picture


class Part:
    """Stands in for a part of the evidence."""

    @staticmethod
    def show(frames):
        def draw(figure):
            figure.subplots().plot(frames["points"]["error"], frames["points"]["cost"], "o")

        shown = picture("dots", (3.0, 2.0), draw, alternative="dots", caption="Cost & error.")
        note = Note("What broke", "All of it.", ("what", "measured"), (("a < b", "1"),))
        return Section("A part", ["Nothing broke."], {"dots": shown}, [note])


@pytest.fixture
def guide(tmp_path, monkeypatch):
    monkeypatch.setattr(command, "part", lambda name: Part)
    frame = pd.DataFrame({"error": [1.0, 2.0], "cost": [3.0, 4.0]})
    found = {"growth": {"points": frame}}
    return write_guide(found, tmp_path / "evidence", {"another solver": "another 4.2"})


def test_the_page_holds_sentences_tables_methods_and_provenance(guide):
    text = guide.read_text(encoding="utf-8")
    assert guide.name == PAGE
    for part in ("Nothing broke.", "a &lt; b", "Moreau-Jean", "archfrag", "another 4.2", "<svg"):
        assert part in text
    assert "http://" not in text.replace("http://www.w3.org", "")


def test_a_figure_is_a_file_that_any_viewer_opens(guide):
    root = ElementTree.parse(guide.parent / "figures" / "dots.svg").getroot()
    assert root.tag == "{http://www.w3.org/2000/svg}svg"
    assert root.find("{http://www.w3.org/2000/svg}desc").text == "Cost & error."


def test_tables_of_another_version_are_named_in_a_sentence(tmp_path, monkeypatch):
    monkeypatch.setattr(command, "part", lambda name: Part)
    found = {"growth": {"points": pd.DataFrame({"error": [1.0]})}}
    with pytest.raises(InputError, match="a table of evidence there has no 'cost'"):
        write_guide(found, tmp_path)


def test_a_peer_says_its_version_or_why_it_is_not_there(monkeypatch):
    monkeypatch.setenv("ARCHFRAG_SICONOS_PYTHON", sys.executable)
    monkeypatch.setenv("PYTHONPATH", "")
    found = peer_versions(["archfrag", "siconos"])
    assert found["archfrag"] == f"archfrag {archfrag.__version__}"
    assert found["siconos"].startswith(("siconos ", "not installed: ModuleNotFoundError"))
