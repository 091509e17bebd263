"""Whatever is wrong with a study file, `archfrag validate` answers in one line."""

import copy
import datetime
import math
import os
import random
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml

from tests.study.small import ROOT, TEXT, command, small_study

RING = "radius: 10.0"
FILES = '["records/*.AT2"]'
BLOCK = "profile: block, width: 0.4, height: 2.0"
LEVELS = "[0.1, 0.6, 1.2]"
MANY = "".join(
    f"  - {{id: a{i}, profile: block, width: 1.0, height: 2.0, friction: 1}}\n"
    for i in range(999)
)
UNIFORM = "distribution: uniform, start: 0.6, stop: 0.8"
NORMAL = "distribution: normal, mean: 1, cov: 0.1"
# What varies of the ring, and a part of the message.
VARY = [
    ("each_joint: {}", "vary must have a key of or each_joint"),
    (
        "of: {frictions: {UNIFORM}}",
        "sample 1 (frictions = 0.657234): frictions is not a known",
    ),
    (
        "of: {friction: {distribution: normal, cov: 0.1}}",
        "vary.of.friction.mean must be given",
    ),
    (
        "of: {friction: {UNIFORM, mean: 1}}",
        ".mean is not a known key; allowed are distribution",
    ),
    ("of: {friction: {NORMAL, sd: 0.1}}", "one of cov and sd"),
    ("of: {friction: {NORMAL, lower: 2.9, upper: 1.8}}", "is cut too far"),
    (
        "of: {dead_load: {NORMAL, relative: true}}",
        "relative needs a key dead_load of the arch",
    ),
    (
        "of: {friction: {UNIFORM}}, correlation: {friction: {density: 0.5}}",
        "vary.correlation is not a known key",
    ),
    (
        "each_joint: {friction: {NORMAL, relative: true}}",
        "relative cannot be used for each_joint",
    ),
    ("of: {thickness: {distribution: normal, mean: 1.5, cov: 3}}", "sample 1 ("),
    (
        "of: {density: {distribution: normal, mean: 2e6, cov: 0.01}}",
        "sample 1 (density = ",
    ),
]
# What is done to the records, and a part of the message.
STEPS = [
    ("[bandpas]", "processing[0].bandpas is not a known key; did you mean bandpass?"),
    ("[{bandpass: {low: 1}}]", "processing[0].bandpass.low is not a known key"),
    ("[{demean: 3}]", "processing[0].demean = 3 must be a block of keys\n"),
    ("[bandpass]", "processing[0] (bandpass): wave0: corners None and None Hz"),
    ("[{trim: {}}]", "(trim): one of arias, threshold_g and times is needed"),
    ("[{trim: {arias: [0.9, 0.1]}}]", "(trim): wave0: cannot cut from"),
    ("[demean, {bandpass: {highest: 60}}]", "processing[1] (bandpass): wave0: corner"),
    ("[{demean: {}, taper: {}}]", "processing[0] must have one of the keys demean"),
    ("[{taper: {side: top}}]", "side = top must be"),
    ("[response]", "has no StationXML"),
]
# Text of the small study (None: all of it), what stands in its place, and a part of the message.
BAD = [
    *(
        (old, f"{key}: {value}", key)
        for key, old in (("radius", RING), ("dt", "dt: 2.0e-3"))
        for value in (
            "abc",
            ".nan",
            ".inf",
            "-1",
            "1e300",
            "[1]",
            "{a: 1}",
            "'1'",
            "'1:30'",
        )
    ),
    *(
        ("friction: 0.7", f"friction: 0.7, vary: {{samples: 4, {vary}}}", part)
        for vary, part in VARY
    ),
    *(
        (f"files: {FILES}", f"files: {FILES}\n  processing: {steps}", part)
        for steps, part in STEPS
    ),
    # YAML.
    ("title: A small study", "title: !!int abc", "is not valid YAML"),
    (
        "title: A small study",
        "title: !!python/object/apply:os.system [ls]",
        "line 2: could not",
    ),
    (
        "title: A small study",
        r'title: "a\0b"',
        "line 2: text must hold no control characters",
    ),
    ("title: A small study", "title:\n" + "- " * 2000 + "a", "is not valid YAML"),
    ("title: A small study", "id: other", "line 2: the key id is given twice"),
    (None, "? [a, b]\n: 3\n", "line 1: found unhashable key"),
    (None, f"{TEXT}---\n{TEXT}", "but found another document"),
    (None, "", "must hold keys with values"),
    (None, "# long\n" * 72_000, "bytes; at most 500000 are allowed"),
    # Names and keys.
    (
        "dt: 2.0e-3",
        "colour: 1",
        "method.colour is not a known key; allowed are name, dt, rtol",
    ),
    ("dt: 2.0e-3", "folow: 1", "method.folow is not a known key; did you mean follow?"),
    ("id: small", "id: a/b", "id = a/b must begin with a letter or a digit"),
    ("id: slab", "id: ring", "arches[1] (ring): the id 'ring' already belongs to"),
    ("output: out", "output: ~nosuchuser/x", "of a user who does not exist"),
    ("output: out", "output: small.yaml/out", "small.yaml/out: "),
    # Arches.
    (
        "  - {id: slab",
        "  - []\n  - {id: slab",
        "arches[1] = [] must be a block of keys, such as {id: ...}",
    ),
    ("  - {id: slab", f"{MANY}  - {{id: slab", "must have at most 1000"),
    (
        "profile: block",
        "profile: blok",
        "arches[1].profile = blok must be 'circular', 'segm",
    ),
    ("profile: block, ", "", "arches[1].profile must be given"),
    (
        f"{RING}, thickness: 1.5, ",
        "",
        "arches[0].radius, arches[0].thickness must be given",
    ),
    (
        BLOCK,
        f"{BLOCK}, span: 3",
        "arches[1].span is not a known key; allowed are profile, id",
    ),
    (
        "voussoirs: 7",
        "voussoirs: '15'",
        "arches[0].voussoirs = '15' must be a valid integer",
    ),
    (
        "friction: 0.7",
        "friction: 0.7, vary: {samples: 12, of: {friction: {UNIFORM}}}",
        "power of",
    ),
    (
        "thickness: 1.5",
        "thickness: 0.3",
        "arches[0] (ring): does not stand under its own weight",
    ),
    ("friction: 0.7", "friction: 1e9", "and at most 1e+06 (inf: the limit of"),
    *(
        ("friction: 0.7", f"friction: 0.7, joints: {given}", part)
        for given, part in (
            (
                "3.0e+10",
                "joints = 30000000000.0 must be a block of keys, such as {stiffness: ...}",
            ),
            (
                "{stiffness: soft}",
                "arches[0].joints.stiffness = 'soft' must be a valid number",
            ),
            (
                "{stiffness: 100.0}",
                "joints.stiffness = 100.0 is impossible; it must be one number",
            ),
            (
                "{stiffness: 3.0e+10, model: soft}",
                "joints.model = soft must be 'inset' or 'face'",
            ),
            (
                "{stiffness: 3.0e+10, points: 3}",
                "joints.points = 3 needs joints.model face",
            ),
            ("{damping: 0.1}", "arches[0].joints.stiffness must be given"),
            (
                "{stiffnes: 3.0e+10}",
                "joints.stiffnes is not a known key; did you mean stiffness?",
            ),
            (
                "null, vary: {samples: 4, of: {joints.stiffness: {NORMAL, relative: true}}}",
                "vary.of.joints.stiffness.relative needs a key joints.stiffness of the",
            ),
            (
                "[0, 20]",
                "joints = [0, 20] is a block with stiffness; positions are joint_positions:",
            ),
            (
                "{positions: [0, 20]}",
                "joints is a block with stiffness; positions are ",
            ),
            (
                "null, vary: {samples: 4, of: {joints: {NORMAL}}}",
                "vary.of.joints is joints.stiffness",
            ),
            (
                "null, vary: {samples: 4, joints: {friction: {NORMAL}}}",
                "vary.joints is not a known key",
            ),
            (
                "{stiffness: 3.0e+10, model: face}, strength: 1.0e+6",
                "strength = 1e+06 needs joints.model inset",
            ),
            (
                "{stiffness: 3.0e+10, model: face}, ties: [{level: 6, area: 0.001}]",
                "a tie needs rigid joints: joints.model inset",
            ),
            ("{stiffness: 1.0e+7}", "does not stand with joints of 1e+07 Pa/m"),
        )
    ),
    (
        BLOCK,
        f"{BLOCK}, joint_positions: [0, 1]",
        "arches[1].joint_positions is not a known key",
    ),
    (
        BLOCK,
        "profile: from_joints, intrados: [[0, 1, 2]], extrados: [[0, 1]]",
        "intrados[0] = [0, 1, 2] must have at most 2",
    ),
    # Motions.
    (
        f"files: {FILES}",
        "synthetic: {events: 2}",
        "motions.synthetic is not a known key; allowed",
    ),
    (FILES, "[]", "the study has no record; give an index or files"),
    (FILES, "[lost.AT2]", "lost.AT2: there is no such file"),
    (f"files: {FILES}", "index: lost.csv", "lost.csv cannot"),
    (
        f"files: {FILES}",
        f"files: {FILES}\n  select: [wave]",
        "'wave' is not a record of the",
    ),
    # Intensity.
    ("unit: g", "unit: cm/s", "intensity.unit = cm/s must be one of g, m/s2"),
    ("measure: PGA", "measure: Sa(1e9)", "must have periods from 0.01 to 20 s"),
    ("measure: PGA", "measure: AvgSA(2.0,0.5)", "needs its shorter period first"),
    ("measure: PGA", "measure: D5_95", "no motion can be scaled to it"),
    (LEVELS, "[.nan]", "intensity.levels[0] = nan must be a finite number"),
    (
        LEVELS,
        "{start: 1.0, stop: 0.5, count: 3}",
        "levels must increase, but 0.75 follows 1",
    ),
    # Method, design and execution.
    ("time_stepping", "euler", "method.name = euler must be one of auto"),
    ("dt: 2.0e-3", "dt: 2.0e-3, rtol: 1e-6", "method time_stepping takes one of them"),
    ("dt: 2.0e-3", "settings: {}", "method.settings is not a known key; allowed are"),
    (
        "execution:",
        "design: {kind: idda}\nexecution:",
        "design.kind = idda must be one of",
    ),
    ("execution:", "design: idda\nexecution:", "design.kind = idda must be one of"),
    ("execution:", "design: 3\nexecution:", "design = 3 must be a block of keys"),
    (
        "execution:",
        "risk: 3\nexecution:",
        "risk = 3 must be a block of keys, such as {hazard: ...}",
    ),
]


def peak_memory():
    """Largest resident memory of this program so far [MB]; `ru_maxrss` counts the parent's too."""
    status = Path("/proc/self/status").read_text()
    return int(re.search(r"VmHWM:\s+(\d+) kB", status)[1]) * 1024 / 1e6


def check(folder, content=b"", *options, path=None):
    """Validate a file, or `content` as one: exit code and message, empty if in order."""
    if path is None:
        path = folder / "small.yaml"
        path.write_bytes(content)
    result = command("validate", path, *options)
    assert result.exit_code in (0, 2, 3, 4), (
        result.exit_code,
        result.stderr,
        result.exception,
    )
    if result.exit_code:
        assert isinstance(result.exception, SystemExit)
        assert result.stderr.startswith("archfrag: error: ")
        assert len(result.stderr.splitlines()) == 1, result.stderr
        for foreign in (
            "Input should",
            "String should",
            "Value error",
            "of a kind that has no",
        ):
            assert foreign not in result.stderr, result.stderr
    return result.exit_code, result.stderr


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("bad")
    small_study(place)
    for text in (TEXT, TEXT.replace(BLOCK, "drawing: lost.dxf")):
        check(place, text.encode())  # loads what any other will need
    return place


@pytest.mark.parametrize(
    "number", range(len(BAD)), ids=lambda n: f"{n}-{BAD[n][2][:30]}"
)
def test_bad_study_is_refused_by_a_line_that_names_the_fault(folder, number):
    old, new, part = BAD[number]
    assert old is None or TEXT.count(old) == 1
    text = new if old is None else TEXT.replace(old, new)
    text = text.replace("UNIFORM", UNIFORM).replace("NORMAL", NORMAL)
    code, message = check(folder, text.encode("utf-8", "surrogatepass"))
    assert code != 0
    assert part in message
    assert len(message) < 1000


# Key, text of the small study and what stands in its place, to name the file {}.
NAMED = [
    ("study", None, "{}"),
    ("drawing", BLOCK, "drawing: {}"),
    ("table", BLOCK, "table: {}"),
    ("index", f"files: {FILES}", "index: {}"),
    ("record", FILES, "[{}]"),
    ("columns", FILES, "[{path: {}, columns: 'time=1,acceleration=2', unit: g}]"),
    ("inventory", FILES, "[{path: records/wave0.AT2, inventory: {}}]"),
    ("hazard", "method:", "risk: {hazard: {}}\nmethod:"),
    ("cube", "output: out", "output: made"),
]


@pytest.mark.parametrize(
    "kind",
    [
        "missing",
        pytest.param("pipe", marks=pytest.mark.posix),
        pytest.param("device", marks=pytest.mark.posix),
        "folder",
        "circle",
        "huge",
    ],
)
@pytest.mark.parametrize(("key", "old", "new"), NAMED, ids=[key for key, _, _ in NAMED])
def test_what_is_no_file_is_not_waited_for(folder, tmp_path, key, old, new, kind):
    """As a command of its own it may take 2 s of CPU and 500 MB besides what starting takes."""
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
    study = (
        None
        if key == "study"
        else TEXT.replace(old, new.replace("{}", str(path))).encode()
    )
    started = time.process_time()
    before = peak_memory()
    code, message = check(tmp_path, study or b"", path=path if key == "study" else None)
    assert time.process_time() - started < 2.0
    assert peak_memory() - before < 500.0
    if key == "cube" and kind in ("missing", "circle"):
        assert code == 0
    else:
        assert code in (2, 4)
        assert str(path) in message


@pytest.mark.parametrize(
    "content", [b"", b"\0\1\2" * 50, b"PGA [g],rate\n0.1,1e-2 \xe9\n"]
)
def test_a_bad_hazard_is_refused_before_anything_runs(tmp_path, content):
    small_study(tmp_path)
    path = tmp_path / "hazard.csv"
    path.write_bytes(content)
    text = TEXT.replace("method:", f"risk: {{hazard: {path}}}\nmethod:")
    code, message = check(tmp_path, text.encode())
    assert (code, str(path) in message) == (2, True)
    ran = command("run", tmp_path / "small.yaml")
    reading = f"archfrag: reading {tmp_path / 'small.yaml'}\n"
    assert (ran.exit_code, ran.stderr) == (code, reading + message)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("override", "part"),
    [
        (
            "arches.2.friction=1",
            "no such place; only a block has keys, and a list items, num",
        ),
        ("arches.friction=1", "--set arches.friction=1: the study has no such place"),
        ("a." * 3000 + "a=1", "a is not a known key"),
        ("dt", "--set dt: must be key=value"),
        ("id.x=1", "--set id.x=1: the study has no such place"),
        (f"title={'[' * 3000}", "--set title: is not valid YAML"),
    ],
)
def test_bad_override_is_refused(folder, override, part):
    code, message = check(folder, TEXT.encode(), "--set", override)
    assert code == 2
    assert part in message


LONGEST = 5.0  # [s] of CPU time: other work on the machine is no fault; [MB]
LARGEST = 500.0
PLAIN = (
    0,
    -1,
    1,
    2,
    10**9,
    -(2**70),
    1e-300,
    1e300,
    0.5,
    math.inf,
    math.nan,
    None,
    True,
    datetime.date(2020, 1, 1),
    "",
    "~",
    "~nobody",
    "inf",
    "Sa(1e9)",
    "Sa(1e-9)",
    "AvgSA(1,2)",
    "PGV",
    "g",
    "a\0b",
    "\x1b[2J",
    "é\u202e\ud800",
    "x" * 5000,
    "yes",
    "[a",
    "*.AT2",
    "2e-3",
)


def places(value):
    """All mappings and lists inside a value, each with each of its keys or indices."""
    for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
        yield value, key
        if isinstance(inner, dict | list):
            yield from places(inner)


def value(draw):
    some = [draw.choice(PLAIN) for _ in range(draw.randint(0, 4))]
    mapping = {draw.choice(PLAIN): inner for inner in some}
    return draw.choice([draw.choice(PLAIN), draw.choice(PLAIN), some, mapping])


def spoilt(draw):
    """A study with one to three of its values replaced, taken out, repeated or renamed."""
    study = yaml.safe_load(TEXT)
    for _ in range(draw.randint(1, 3)):
        if not (found := list(places(study))):
            break
        parent, last = draw.choice(found)
        what = draw.choice(
            ["replace", "replace", "replace", "drop", "repeat", "rename"]
        )
        if what == "replace":
            parent[last] = value(draw)
        elif what == "drop":
            del parent[last]
        elif isinstance(parent, list):
            parent.insert(last, copy.deepcopy(parent[last]))
        elif what == "rename":
            parent[draw.choice(PLAIN)] = parent.pop(last)
        else:
            parent[last] = [parent[last]] * draw.choice([0, 2, 5000])
    return yaml.safe_dump(study, allow_unicode=True).encode("utf-8", "surrogatepass")


def check_spoilt(folder, count):
    """Check so many studies spoilt at random, with little more memory than what is loaded now."""
    small_study(folder)
    check(folder, TEXT.encode())  # loads what any other will need
    import resource

    size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (size + int(LARGEST * 1e6),) * 2)
    draw = random.Random(1)
    refused = 0
    for _ in range(count):
        content = spoilt(draw)
        started = time.process_time()
        refused += check(folder, content)[0] != 0
        assert time.process_time() - started < LONGEST, content[:2000]
    assert peak_memory() < LARGEST
    print(refused)


def test_spoilt_studies_are_answered_within_5_seconds_and_500_megabytes(tmp_path):
    """ARCHFRAG_SPOILT_STUDIES=2000 is the number that the project's figures are of."""
    count = os.environ.get("ARCHFRAG_SPOILT_STUDIES", "60")
    paths = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, "-m", "tests.study.test_bad_studies", str(tmp_path), count],
        env=os.environ | {"PYTHONPATH": paths},
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stderr[-4000:]
    assert int(done.stdout) > 0.8 * int(count)


if __name__ == "__main__":
    check_spoilt(Path(sys.argv[1]), int(sys.argv[2]))
