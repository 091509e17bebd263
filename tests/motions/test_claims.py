"""Plug-ins claim files of their own format and no others."""

import tomllib
from importlib import import_module
from pathlib import Path

import obspy
import pytest
from obspy.core.util.base import ENTRY_POINTS, buffered_load_entry_point

from archfrag.motions.formats.waveform import OWN, recognise

from .helpers import REAL_RECORDS, needs_real_records
from .samples import MADE_UP
from .test_manifest import FORMATS, rows

OBSPY = Path(obspy.__file__).parent
ROOT = Path(__file__).parents[2]


def claims(name):
    return getattr(import_module(f"archfrag.motions.formats.{OWN[name]}"), f"is_{name.lower()}")


def claimed_by_obspy(path):
    """Formats of obspy, ours among them, that claim a file."""
    found = []
    for name, point in ENTRY_POINTS["waveform"].items():
        group = f"obspy.plugin.waveform.{name}"
        test = buffered_load_entry_point(point.dist.name, group, "isFormat")
        try:
            claimed = test(str(path))
        except Exception:
            claimed = False
        if claimed:
            found.append(name)
    return found


def made_up_files(folder):
    for name, makers in MADE_UP.items():
        for number, make in enumerate(makers):
            path = folder / f"{name}-{number}.txt"
            path.write_text(make())
            yield name, path


def test_every_reader_is_a_plug_in_of_obspy():
    with open(ROOT / "pyproject.toml", "rb") as file:
        points = tomllib.load(file)["project"]["entry-points"]
    modules = {name: f"archfrag.motions.formats.{module}" for name, module in OWN.items()}
    assert points["obspy.plugin.waveform"] == modules
    for name in OWN:
        assert points[f"obspy.plugin.waveform.{name}"] == {
            "isFormat": f"{modules[name]}:is_{name.lower()}",
            "readFormat": f"{modules[name]}:read_{name.lower()}",
        }


def test_no_file_of_obspy_is_claimed():
    files = [path for path in OBSPY.glob("**/tests/data/**/*") if path.is_file()]
    if len(files) < 100:
        pytest.skip("this obspy came without its test data")
    claimed = [(str(path), name) for path in files for name in OWN if claims(name)(str(path))]
    assert claimed == []


def test_made_up_files_are_claimed_by_their_own_format_only(tmp_path):
    seen = set()
    for name, path in made_up_files(tmp_path):
        assert [other for other in OWN if claims(other)(str(path))] == [name]
        assert recognise(str(path), tuple(OWN)) == name
        with open(path, "rb") as file:
            assert claims(name)(file)
        if set(OWN) <= set(ENTRY_POINTS["waveform"]):
            assert claimed_by_obspy(path) == [name]
            assert obspy.read(str(path))[0].stats._format == name
        seen.add(name)
    assert seen >= {"AT2", "COSMOS", "DMG", "SMC"}


@needs_real_records
@pytest.mark.parametrize("file", sorted({row["file"] for row in rows()}))
def test_real_files_are_claimed_by_their_own_format_only(file):
    row = next(row for row in rows() if row["file"] == file)
    name, path = FORMATS[row["format"]], str(REAL_RECORDS / file)
    expected = [name] if name in OWN else []
    assert [other for other in OWN if claims(other)(path)] == expected
    if expected and set(OWN) <= set(ENTRY_POINTS["waveform"]):
        assert claimed_by_obspy(path) == expected


@pytest.mark.parametrize("name", OWN)
@pytest.mark.parametrize(
    "content",
    [b"", b"\n", b"\0" * 5000, bytes(range(256)) * 20, b"ACCELERATION\n" * 50, b"\xff\xfe" * 3000],
    ids=["empty", "blank", "zeros", "bytes", "prose", "wide"],
)
def test_other_content_is_not_claimed(tmp_path, name, content):
    path = tmp_path / "other"
    path.write_bytes(content)
    assert not claims(name)(path)
    assert not claims(name)(tmp_path / "missing")
