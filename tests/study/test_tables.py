"""Tables as spreadsheets write them, in every reader; and paths as other systems have them."""

import shutil
import unicodedata
from pathlib import Path

import numpy as np
import pytest

import archfrag as af
from archfrag.fragility.curve import Curve
from archfrag.motions.index import load_index
from archfrag.motions.read import read_motion
from archfrag.motions.selection import read_flatfile, read_targets
from archfrag.study.file.arches import ArchEntry
from archfrag.study.file.members import expand
from archfrag.study.file.schema import load_study
from archfrag.study.file.sources import find_sources
from archfrag.study.hazard import load_hazard
from tests.study.small import TEXT, command, small_study

PRIOR = Curve(
    0.39,
    0.5,
    np.diag([0.2, 0.0]),
    kind="posterior",
    measure="PGA",
    unit="g",
    si=9.80665,
)
RUNS = "record;PGA [g];verdict\n" + "".join(
    f"r{i};{level};{int(level * (1 + 0.1 * i) > 0.5)}\n"
    for i in range(8)
    for level in (0.2, 0.4, 0.6, 0.8)
)
DAMAGE = "state;median;tau;phi;lon;lat\n" + "".join(
    f"{state};{median};0.05;0.1;{lon};42.1\n"
    for state, median in (("collapsed", 0.15), ("survived", 0.1))
    for lon in (13.05, 13.25, 13.45)
)
STATIONS = "observed;median;tau;phi;lon;lat\n0.35;0.2;0.05;0.1;13.15;42.1\n"


def index(path):
    (entry,) = load_index(path)
    path = path.rename(path.with_name("index.csv"))
    return entry.metadata, read_motion(path.parent / "wave0.AT2").id


def arches(path):
    shared = {"id": "ring", "profile": "circular", "embrace": 157.5, "voussoirs": 7}
    members = expand([ArchEntry(table=str(path), **shared)])
    return [each.entry.model_dump(exclude={"table"}) for each in members]


def update(path):
    return PRIOR.update(path, beta_model=0.3).theta


def stations(path):
    damage = path.with_name("damage.csv")
    damage.write_text(DAMAGE, encoding="utf-8")
    return PRIOR.update(damage, beta_model=0.3, stations=path).theta


READERS = {
    "index": (index, "id;file;unit;Mw;distance_km\nä;wave0.AT2;g;6.5;12.25\n"),
    "flatfile": (
        lambda path: read_flatfile(path).to_dict(),
        "record;magnitude;T0.100S;PGA_g\nä;6.5;0.25;0.1\nb;6;0.5;2e-1\n",
    ),
    "target": (
        lambda path: read_targets(path)[None].ln_mean.tolist(),
        "period_s;Sa_g;sd\n0.1;0.5;0.25\n0.5;0.3;0.4\n",
    ),
    "arches": (arches, "id;radius;thickness;friction\na;10.5;1.5;0.7\nb;8;1.25;0.6\n"),
    "hazard": (
        lambda path: load_hazard([path], "PGA").main.rate.tolist(),
        "PGA [g];rate\n0.1;1.5e-2\n0.5;1e-3\n",
    ),
    "runs": (lambda path: af.fit(path).curve.theta, RUNS),
    "damage": (update, DAMAGE),
    "stations": (stations, STATIONS),
}
FORMS = {
    "first line of Excel": lambda text: "sep=;\n" + text,
    "mark of the encoding": lambda text: "\ufeff" + text,
    "line ends": lambda text: text.replace("\n", "\r\n"),
    "decimal commas": lambda text: (
        text.replace(".", ",")
        .replace("T0,100S", "T0.100S")
        .replace("wave0,AT2", "wave0.AT2")
    ),
    "empty column": lambda text: text.replace("\n", ";\n"),
    "commas": lambda text: text.replace(";", ","),
    "tabs": lambda text: text.replace(";", "\t"),
}
FORMS["all of Excel"] = lambda text: (
    "\ufeffsep=;\r\n" + FORMS["line ends"](FORMS["decimal commas"](text))
)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("reader", READERS)
def test_a_table_says_the_same_in_every_form(tmp_path, reader, form):
    read, text = READERS[reader]
    found = []
    for name, content in (("plain", text), ("form", FORMS[form](text))):
        small_study(tmp_path / name)
        path = tmp_path / name / "records" / "table.csv"
        path.write_bytes(content.encode())
        found.append(read(path))
    assert found[0] == found[1]


@pytest.mark.parametrize("folder", ["my records", "Erdbeben Ä", "a.b;c", "é" * 60])
@pytest.mark.parametrize("stored", ["NFC", "NFD"])
def test_paths_of_other_systems(tmp_path, folder, stored):
    """Backslashes in each key that is a path; signs of accents of macOS, in names and patterns."""
    written = unicodedata.normalize("NFC", folder)
    place = tmp_path / unicodedata.normalize(stored, folder)
    small_study(place)
    (place / "fleet.csv").write_text("id,radius\none,10.0\n", encoding="utf-8")
    (place / "hazard.csv").write_text("PGA [g],rate\n0.1,1e-2\n0.5,1e-3\n", "utf-8")
    rows = "sep=;\nid;file;unit\nw;records\\wave1.AT2;g\n"
    (place / "own.csv").write_text(rows, encoding="utf-8")
    fleet = TEXT.replace("id: ring,", f"id: ring, table: '{written}\\fleet.csv',")
    text = fleet.replace("records/*.AT2", f"{written}\\\\records\\\\*0.at2")
    text += f"risk: {{hazard: '{written}\\hazard.csv'}}\n"
    text = text.replace("files:", f"index: '.\\{written}\\own.csv'\n  files:")
    path = small_study(tmp_path, text.replace("output: out", "output: .\\made\\here"))
    shutil.rmtree(tmp_path / "records")
    study = load_study(path, ["method.dt=1e-3", f"output=set\\{written}"])
    assert study.folder == tmp_path / "set" / written
    study = load_study(path)
    assert study.folder == tmp_path / "made" / "here"
    sources = find_sources(study.motions, "PGA")
    assert [each.path.name for each in sources] == ["wave1.AT2", "wave0.AT2"]
    assert expand(study.arches)[0].id == "one"
    assert load_hazard([Path(study.risk.hazard)], "PGA").main.im.size == 2


@pytest.mark.parametrize("length", [240, 700])
def test_a_study_in_a_folder_of_a_long_name(tmp_path, length):
    place = tmp_path
    while len(str(place)) < length - 60:
        place /= "of a long name " + "x" * 35
    place /= "y" * max(length - len(str(place)) - 1, 1)
    path = small_study(place)
    assert len(str(place)) in (length, length + 1)
    done = command("run", path, "--quiet", "--set", "intensity.levels=[0.1, 0.6]")
    assert done.exit_code == 0, done.output
    assert (place / "out" / "report.html").is_file()
