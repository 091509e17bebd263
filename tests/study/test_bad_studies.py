"""Whatever is wrong with a study file, `archfrag validate` answers in one line."""

import os
import subprocess
import sys
import time

import pytest
from click.testing import CliRunner

from archfrag.cli import main
from archfrag.study.worker import peak_memory
from tests.study.mutated_studies import check
from tests.study.small import ROOT, TEXT, small_study

RING, FILES = "radius: 10.0", '["records/*.AT2"]'
BLOCK = "profile: block, width: 0.4, height: 2.0"
# A key, its text in the small study, and what stands before the value in its place.
NUMBERS = [
    ("arches[0].radius", RING, "radius"),
    ("arches[0].voussoirs", "voussoirs: 7", "voussoirs"),
    ("method.dt", "dt: 2.0e-3", "dt"),
]
NO_NUMBERS = (
    "abc", ".nan", ".inf", "-1", "1e300", "[1]", "{a: 1}", "true", "'1'", "9" * 5000, "1:30",
)  # fmt: skip
# Text of the small study (None: all of it), what stands in its place, and a part of the message.
BAD = [
    (old, f"{name}: {value}", key.rpartition(".")[2])
    for key, old, name in NUMBERS
    for value in (NO_NUMBERS if key in ("arches[0].radius", "method.dt") else (".nan", "-1", "a"))
]
DEEP = "more than 20 levels of nesting"
BAD += [
    ("title: A small study", f"title: {value}", part)
    for value, part in [
        ("!!int abc", "line 2: tags such as tag:yaml.org,2002:int have no"),
        ("!!python/object/apply:os.system [ls]", "line 2: tags such as"),
        ("''", "title =  must not be empty"),
        ("t" * 501, "must have at most 500 characters"),
        (r'"a\0b"', "line 2: text must hold no control characters"),
        ("a\0b", "special characters are not allowed"),
        ("\n" + "- " * 200 + "a", DEEP),
        ("&a [*a]", "line 2: aliases such as *a have no place"),
    ]
]
BAD += [
    (None, text, part)
    for text, part in [
        ("a: &a {b: 1}\n<<: *a\n", "line 2: aliases such as *a have no place"),
        ("? [a, b]\n: 3\n", "line 1: found unhashable key"),
        (f"{TEXT}---\n{TEXT}", "but found another document"),
        ("", "must hold keys with values"),
        ("# long\n" * 72_000, "bytes; at most 500000 are allowed"),
        ("id: a\ntitle: a\noutput: a\narches: []\n", "arches = [] must have"),
    ]
]
BAD += [
    ("output: out", f"output: {value}", part)
    for value, part in [
        (r'"a\0b"', "line 3: text must hold no control characters"),
        ("~nosuchuser/x", "of a user that there is not"),
        ("small.yaml", "small.yaml: "),
        ("small.yaml/out", "small.yaml/out: "),
    ]
]
MANY = "".join(
    f"  - {{id: a{i}, profile: block, width: 1.0, height: 2.0, friction: 1}}\n" for i in range(999)
)
BAD += [
    # Names and keys.
    ("title: A small study", "id: other", "line 2: the key id is given twice"),
    ("dt: 2.0e-3", "colour: 1", "method.colour is no known key; allowed are name, dt, rtol"),
    ("id: small", "id: a/b", "must begin with a letter or a digit"),
    ("id: slab", "id: ring", "arches[1] (ring): an arch has the id 'ring', which"),
    # Arches.
    ("  - {id: slab", "  - []\n  - {id: slab", "arches[1] = [] must be a map"),
    ("  - {id: slab", f"{MANY}  - {{id: slab", "must have at most 1000 entries"),
    ("profile: block", "profile: blok", "arches[1].profile = blok must be one of circular"),
    ("voussoirs: 7", "voussoirs: 1000000000", "it must be at most 2000"),
    ("voussoirs: 7", "voussoirs: '15'", "arches[0].voussoirs = '15' must be an integer without q"),
    ("friction: 0.7", "friction: 1e9", "must be at most 1e+06, or inf"),
    ("friction: 0.7", f"friction: [{', '.join(['1'] * 3000)}]", "at most 2001 entries"),
    (RING, f"{RING}, sector: maybe", "sector = maybe must be true or false"),
    (BLOCK, "profile: from_joints, intrados: [a], extrados: [[0, 1]]",
     "arches[1].intrados[0] = a must be a list"),
    (BLOCK, "profile: from_joints, intrados: [[0, 1, 2]], extrados: [[0, 1]]",
     "intrados[0] = [0, 1, 2] must have at most 2 entries, not 3"),
    # Motions.
    (FILES, "[]", "must have a key index, files or synthetic"),
    (FILES, "[lost.AT2]", "lost.AT2: there is no such file"),
    (f"files: {FILES}", "index: lost.csv", "lost.csv cannot"),
    (f"files: {FILES}", "{index: a.csv, select: [b, b]}", "but 'b' is there twice"),
    # Intensity.
    ("unit: g", "unit: cm/s", "unit 'cm/s' is not one of g, m/s2"),
    # Method and execution.
    ("time_stepping", "euler", "method.name = euler must be one of auto"),
    ("dt: 2.0e-3", "dt: 2.0e-3, rtol: 1e-6", "method time_stepping takes one of them"),
    ("time_stepping", "four_link", "method four_link does not use it"),
    ("dt: 2.0e-3", "settings: {stiffness: 1e9}", "settings has 'stiffness'; allowed for"),
    ("name: time_stepping, dt: 2.0e-3", "name: auto, settings: {coarse: 2}", "has 'coarse'"),
    ("workers: 2", "workers: 0", "execution.workers = 0 must be greater"),
]  # fmt: skip
BAD += [
    (f"files: {FILES}", f"files: {FILES}\n  processing: [{step}]", part)
    for step, part in [("response", "has no StationXML"), ("smooth", "smooth is no known step")]
]
BAD += [
    ("measure: PGA", f"measure: {value}", part)
    for value, part in [
        ("Sa(1e9)", "has a period of 1e+09 s; it must be from 0.01 to 20 s"),
        ("AvgSA(2.0,0.5)", "needs its shorter period first"),
        ("pga", "did you mean PGA?"),
        ("D5_95", "to which no motion can be scaled"),
    ]
]
BAD += [
    ("[0.1, 0.6, 1.2]", value, part)
    for value, part in [
        ("[.nan]", "intensity.levels[0] = nan must be a finite number"),
        ("[0.0, 0.6]", "intensity.levels[0] = 0.0 must be greater than 0"),
        ("[1, 1]", "must increase, but 1 follows 1"),
        ("{start: 1, stop: 2, count: 100000000}", "less than or equal to 1000"),
        ("{start: 1.0, stop: 0.5, count: 3}", "must have stop above start = 1, not 0.5"),
        ("{start: 1, stop: 1.0000000000000002, count: 50}", "must increase, but 1 follows 1"),
    ]
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("bad")
    small_study(place)
    check(place, TEXT.encode())  # loads what any other will need
    return place


@pytest.mark.parametrize("number", range(len(BAD)), ids=lambda n: f"{n}-{BAD[n][2][:30]}")
def test_bad_study_is_refused_by_a_line_that_names_the_fault(folder, number):
    old, new, part = BAD[number]
    assert old is None or TEXT.count(old) == 1
    text = new if old is None else TEXT.replace(old, new)
    code, message = check(folder, text.encode("utf-8", "surrogatepass"))
    assert code != 0
    assert part in message
    assert len(message) < 1000


@pytest.mark.parametrize(
    ("old", "new"),
    [("title: A small study", f"title: {t}") for t in ("2020-13-45", "yes", "1:30", "1_000")]
    + [("friction: 0.7", f"friction: {f}") for f in ("inf", "[1, inf, 1, 1, 1, 1, 1, .inf]")]
    + [(RING, "radius: 1.e+1")],
)
def test_what_yaml_1_1_would_have_converted_is_text_and_inf_is_a_number(folder, old, new):
    assert check(folder, TEXT.replace(old, new).encode())[0] == 0


SAMPLES = "{time: 1, acceleration: 2}"
# Key, text of the small study and what stands in its place, to name the file {}.
NAMED = [
    ("study", None, "{}"),
    ("drawing", "profile: block, width: 0.4, height: 2.0", "drawing: {}"),
    ("table", "profile: block, width: 0.4, height: 2.0", "table: {}"),
    ("index", f"files: {FILES}", "index: {}"),
    ("record", FILES, "[{}]"),
    ("columns", FILES, f"[{{path: {{}}, columns: {SAMPLES}, unit: g}}]".replace("{{}}", "{}")),
    ("inventory", FILES, "[{path: records/wave0.AT2, inventory: {}}]"),
    ("hazard", "method:", "risk: {hazard: {}}\nmethod:"),
    ("cube", "output: out", "output: made"),
]


@pytest.mark.parametrize("kind", ["missing", "pipe", "device", "folder", "circle", "huge"])
@pytest.mark.parametrize(("key", "old", "new"), NAMED, ids=[key for key, _, _ in NAMED])
def test_what_is_no_file_is_not_waited_for(folder, tmp_path, key, old, new, kind):
    """As a command of its own it may take 2 s and 500 MB besides what starting takes."""
    small_study(tmp_path)
    path = tmp_path / ("made/cube.nc" if key == "cube" else "given.x")
    path.parent.mkdir(exist_ok=True)
    if kind == "pipe":
        os.mkfifo(path)
    elif kind in ("device", "circle"):
        path.symlink_to("/dev/zero" if kind == "device" else path)
    elif kind == "folder":
        path.mkdir()
    elif kind == "huge":
        with open(path, "wb") as file:
            file.truncate(2**36)
    study = None if key == "study" else TEXT.replace(old, new.replace("{}", str(path))).encode()
    started, before = time.monotonic(), peak_memory()
    code, message = check(tmp_path, study or b"", path=path if key == "study" else None)
    assert time.monotonic() - started < 2.0
    assert peak_memory() - before < 500.0
    if key == "cube" and kind in ("missing", "circle"):
        assert code == 0
    else:
        assert code in (2, 4)
        assert str(path) in message


RATES = "PGA [g],rate\n"
NRML = '<nrml><hazardCurves IMT="PGA" investigationTime="50"></hazardCurves></nrml>'
BAD_HAZARDS = {
    "measure": "PGV [cm/s],rate\n1,1e-2\n9,1e-3\n", "unit": "PGA [cm/s],rate\n1,1e-2\n9,1e-3\n",
    "no unit": "PGA,rate\n0.1,1e-2\n0.2,1e-3\n", "kind": "PGA [g],often\n0.1,1e-2\n0.2,1e-3\n",
    "rising": RATES + "0.1,1e-3\n0.2,1e-2\n", "levels in no order": RATES + "0.2,1e-2\n0.1,1e-3\n",
    "nan": RATES + "0.1,nan\n0.2,1e-3\n", "inf": RATES + "inf,1e-2\n0.2,1e-3\n",
    "negative": RATES + "0.1,1e-2\n0.2,-1e-3\n", "level 0": RATES + "0,-1\n0.2,1e-3\n",
    "above 1": "PGA [g],poe_50\n0.1,1.5\n0.2,0.5\n", "one row": RATES + "0.1,1e-2\n",
    "heads only": RATES, "text": RATES + "a,b\nc,d\n", "cells": RATES + "0.1,1e-2,3\n0.2,1e-3\n",
    "twice": "PGA [g],rate,rate\n0.1,1,1\n0.2,.1,.1\n", "empty": "", "binary": "\0\1\2" * 50,
    "no XML": "<nrml", "no site": NRML, "other XML": "<html></html>",
    "entity": f'<!DOCTYPE a [<!ENTITY e SYSTEM "file:///etc/passwd">]>{NRML}&e;',
    "bomb": '<!DOCTYPE a [<!ENTITY a "aa"><!ENTITY b "&a;&a;">]><nrml>&b;</nrml>',
    "latin-1": b"PGA [g],rate\n0.1,1e-2 \xe9\n", "years": "PGA [g],poe_0\n0.1,.5\n0.2,.1\n",
    "passwd": None,
}  # fmt: skip


@pytest.mark.parametrize("kind", BAD_HAZARDS)
def test_a_bad_hazard_is_refused_before_anything_runs(tmp_path, kind):
    small_study(tmp_path)
    path, content = tmp_path / "hazard.csv", BAD_HAZARDS[kind]
    if content is None:
        path = "/etc/passwd"
    else:
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    study = TEXT.replace("method:", f"risk: {{hazard: {path}}}\nmethod:").encode()
    started = time.monotonic()
    code, message = check(tmp_path, study)
    assert (code, str(path) in message) == (2, True)
    ran = CliRunner().invoke(main, ["run", str(tmp_path / "small.yaml")])
    assert time.monotonic() - started < 5.0
    assert (ran.exit_code, ran.stderr) == (code, message)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("override", "part"),
    [
        ("arches.²=z", "arches has 2 entries, counted from 0, and ² is none of them"),
        (f"arches.{'9' * 5000}=z", "arches has 2 entries"),
        ("a." * 3000 + "a=1", "must be key=value"),
        ("dt", "--set dt: must be key=value"),
        ("id.x=1", "--set id.x=1: id has no keys"),
        ("title=!!int abc", "--set title: line 1: tags such as"),
        (f"title={'[' * 3000}", "--set title: line 1: more than 20 levels"),
        ("output=~nosuchuser/x", "of a user that there is not"),
    ],
)
def test_bad_override_is_refused(folder, override, part):
    code, message = check(folder, TEXT.encode(), "--set", override)
    assert code == 2
    assert part in message


def test_spoilt_studies_are_answered_within_5_seconds_and_500_megabytes(tmp_path):
    """ARCHFRAG_SPOILT_STUDIES=2000 is the number that the project's figures are of."""
    count = os.environ.get("ARCHFRAG_SPOILT_STUDIES", "60")
    done = subprocess.run(
        [sys.executable, "-m", "tests.study.mutated_studies", str(tmp_path), count],
        cwd=ROOT, capture_output=True, text=True, timeout=600,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-4000:]
    checked, refused, _, _ = done.stdout.split()
    assert int(checked) >= int(count)
    assert int(refused) > 0.9 * int(checked)
