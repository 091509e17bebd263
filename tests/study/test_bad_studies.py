"""Whatever is wrong with a study file, `archfrag validate` answers in one sentence."""

import os
import subprocess
import sys

import pytest

from tests.study.mutated_studies import check
from tests.study.small import ROOT, TEXT, small_study

# Text of the small study, what stands in its place, and a part of the sentence.
RING, SLAB = "radius: 10.0", "width: 0.4"
NUMBERS = {
    "arches[0].radius": (RING, "radius"),
    "arches[0].thickness": ("thickness: 1.5", "thickness"),
    "arches[0].embrace": ("embrace: 157.5", "embrace"),
    "arches[0].voussoirs": ("voussoirs: 7", "voussoirs"),
    "arches[0].density": (RING, f"{RING}, density"),
    "arches[0].depth": (RING, f"{RING}, depth"),
    "arches[1].width": (SLAB, "width"),
    "method.dt": ("dt: 2.0e-3", "dt"),
    "method.rtol": ("name: time_stepping, dt: 2.0e-3", "name: auto, rtol"),
    "method.follow": ("follow: 2.0", "follow"),
}
NO_NUMBERS = {
    "text": "abc",
    "NaN": ".nan",
    "infinity": ".inf",
    "infinity in words": "inf",
    "below zero": "-1",
    "beyond": "1e300",
    "list": "[1]",
    "mapping": "{a: 1}",
    "truth": "true",
    "quoted": "'1'",
    "5000 digits": "9" * 5000,
    "sexagesimal": "1:30",
}
BAD = {
    f"{name} is {kind}": ((old, f"{key}: {value}"), name.rpartition(".")[2])
    for name, (old, key) in NUMBERS.items()
    for kind, value in NO_NUMBERS.items()
}


def title(value):
    return ("title: A small study", f"title: {value}")


def output(value):
    return ("output: out", f"output: {value}")


def levels(value):
    return ("[0.1, 0.6, 1.2]", value)


def measure(value):
    return ("measure: PGA", f"measure: {value}")


def everything(value):
    return (TEXT, value)


DEEP = "more than 20 levels of nesting"
BAD |= {
    "0x_": ((RING, "radius: 0x_"), "radius = 0x_ must be a number"),
    "an explicit int": (title("!!int abc"), "line 2: tags such as tag:yaml.org,2002:int have no"),
    "an explicit float": (title("!!float abc"), "line 2: tags such as tag:yaml.org,2002:float"),
    "an explicit bool": (title("!!bool abc"), "line 2: tags such as"),
    "an explicit timestamp": (title("!!timestamp abc"), "line 2: tags such as"),
    "an explicit binary": (title("!!binary abc"), "line 2: tags such as"),
    "an object": (title("!!python/object/apply:os.system [ls]"), "line 2: tags such as"),
    "a long tag": (title(f"!{'a' * 900} b"), "line 2: tags such as"),
    "a number as title": (title("2020"), "title = 2020 must be text"),
    "no title": (title(""), "title = empty must be text"),
    "empty title": (title("''"), "title =  must not be empty"),
    "long title": (title("t" * 501), "must have at most 500 characters"),
    "truth as title": (title("true"), "title = True must be text"),
    "NUL in a title": (title(r'"a\0b"'), "line 2: text must hold no control characters"),
    "escape sequence": (title(r'"\e[2J"'), "line 2: text must hold no control characters"),
    "half a character": (title(r'"\ud800"'), "line 2: text must hold no control characters"),
    "raw NUL": (title("a\0b"), "special characters are not allowed"),
    "list 3000 deep": (title("[" * 3000 + "]" * 3000), DEEP),
    "map 3000 deep": (title("{a: " * 3000 + "1" + "}" * 3000), DEEP),
    "open list 3000 deep": (title("[" * 3000), DEEP),
    "deep by dashes": (title("\n" + "- " * 200 + "a"), DEEP),
    "deep by aliases": (
        everything("a0: &a0 [x]\n" + "".join(f"a{i}: &a{i} [*a{i - 1}]\n" for i in range(1, 999))),
        DEEP,
    ),
    "many by aliases": (
        everything(
            "a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n"
            + "".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]\n" for i in range(1, 12))
        ),
        "or 200000 values",
    ),
    "inside itself": (title("&a [*a]"), "line 2: the alias a stands inside what it repeats"),
    "alias of nothing": (title("*nothing"), "line 2: found undefined alias"),
    "a merge": (everything("a: &a {b: 1}\n<<: *a\n"), "a is no known key"),
    "a list as key": (everything("? [a, b]\n: 3\n"), "line 1: found unhashable key"),
    "an unfinished quote": (title('"abc'), "line 9: expected <block end>, but found"),
    "a tab": (title("\t- a"), "line 2: found character '\\t' that cannot start any token"),
    "two documents": (everything(f"{TEXT}---\n{TEXT}"), "but found another document"),
    "nothing": (everything(""), "must hold keys with values"),
    "a comment": (everything("# nothing\n"), "must hold keys with values"),
    "a list": (everything("- a\n"), "must hold keys with values"),
    "a word": (everything("study\n"), "must hold keys with values"),
    "a number": (everything("3\n"), "must hold keys with values"),
    "too large": (everything("# long\n" * 72_000), "is too large; it must have at most 500000"),
    "a number as key": (everything("3: a\n"), "3 is no known key"),
    "a long key": (everything(f"{'k' * 100}: a\n"), "is no known key"),
    "nothing as key": (everything("~: a\n"), "None is no known key"),
    "all keys missing": (everything("id: a\n"), "title is missing (3 more keys are wrong too)"),
    "NUL in output": (output(r'"a\0b"'), "line 3: text must hold no control characters"),
    "output of 300 characters": (output("o" * 300), "must have names of at most 255 bytes"),
    "output of 300 bytes": (output("ö" * 150), "must have names of at most 255 bytes"),
    "output 30 x 200": (output("/".join(["o" * 200] * 30)), "must have at most 3900 bytes"),
    "output of nobody": (output("~nosuchuser/x"), "of a user that there is not"),
    "output is a number": (output("3"), "output = 3 must be text"),
    "output is a list": (output("[a]"), "output = ['a'] must be text"),
    "output is nothing": (output(""), "output = empty must be text"),
    "output is empty": (output("''"), "output =  must not be empty"),
    "output is a file": (output("small.yaml"), "small.yaml: "),
    "output below a file": (output("small.yaml/out"), "small.yaml/out: "),
    "id missing": (("id: small\n", ""), "id is missing"),
    "id of 200 characters": (("id: small", f"id: {'i' * 200}"), "must have at most 80 characters"),
    "id with a slash": (("id: small", "id: a/b"), "must begin with a letter or a digit"),
    "id of dots": (("id: small", "id: .."), "must begin with a letter or a digit"),
    "id is a number": (("id: small", "id: 5"), "id = 5 must be text"),
    "id of an arch of 200 characters": (("id: slab", f"id: {'i' * 200}"), "at most 80 characters"),
    "id of an arch is missing": (("{id: slab, ", "{"), "arches[1].id is missing"),
    "no arch": (("arches:\n", "arches: []\nx:\n"), "x is no known key"),
    "arches empty": (
        everything("id: a\ntitle: a\noutput: a\narches: []\n"),
        "arches = [] must have",
    ),
    "arches a word": (("arches:\n", "arches: a\nx:\n"), "x is no known key"),
    "an empty arch": (("  - {id: slab", "  - []\n  - {id: slab"), "arches[1] = [] must be a map"),
    "an arch of nothing": (("  - {id: slab", "  -\n  - {id: slab"), "arches[1] = empty must be"),
    "1001 arches": (
        (
            "  - {id: slab",
            "".join(
                f"  - {{id: a{i}, profile: block, width: 1.0, height: 2.0, friction: 1}}\n"
                for i in range(999)
            )
            + "  - {id: slab",
        ),
        "must have at most 1000 entries",
    ),
    "profile is a list": (("profile: block", "profile: [block]"), "arches[1].profile"),
    "a billion voussoirs": (("voussoirs: 7", "voussoirs: 1000000000"), "it must be at most 2000"),
    "2001 voussoirs": (("voussoirs: 7", "voussoirs: 2001"), "voussoirs = 2001 is too many"),
    "one voussoir": (("voussoirs: 7", "voussoirs: 1"), "voussoirs = 1 makes no arch"),
    "friction of text": (
        ("friction: 0.7", "friction: rough"),
        "friction = rough must be a number",
    ),
    "friction below zero": (("friction: 0.7", "friction: -0.1"), "friction = -0.1 is impossible"),
    "friction -inf": (("friction: 0.7", "friction: -.inf"), "friction = -inf is impossible"),
    "friction 1e9": (("friction: 0.7", "friction: 1e9"), "must be at most 1e+06, or inf"),
    "friction of too few": (("friction: 0.7", "friction: [1, 1]"), "friction has shape (2,)"),
    "friction of none": (("friction: 0.7", "friction: []"), "friction has shape (0,)"),
    "friction of 3000": (
        ("friction: 0.7", f"friction: [{', '.join(['1'] * 3000)}]"),
        "at most 2001 entries",
    ),
    "friction a mapping": (("friction: 0.7", "friction: {a: 1}"), "must be a number"),
    "dead load below zero": ((RING, f"{RING}, dead_load: -1"), "dead_load = -1.0"),
    "dead load 1e20": ((RING, f"{RING}, dead_load: 1e20"), "must be less than or equal to 1e+12"),
    "dead load of text": ((RING, f"{RING}, dead_load: [a]"), "dead_load[0] = a must be a number"),
    "joints of text": ((RING, f"{RING}, joints: abc"), "joints = abc must be a list"),
    "joints too few": ((RING, f"{RING}, joints: [0, 157.5]"), "joints has shape (2,)"),
    "sector of text": ((RING, f"{RING}, sector: maybe"), "sector = maybe must be true or false"),
    "span of a circular arch": ((RING, f"{RING}, span: 3"), "arches[0].span is no known key"),
    "radius twice": ((RING, f"{RING}, {RING}"), "the key radius is given twice"),
    "points of text": (
        (
            "profile: block, width: 0.4, height: 2.0",
            "profile: from_joints, intrados: [a], extrados: [[0, 1]]",
        ),
        "arches[1].intrados[0] = a must be a list",
    ),
    "points of three": (
        (
            "profile: block, width: 0.4, height: 2.0",
            "profile: from_joints, intrados: [[0, 1, 2]], extrados: [[0, 1]]",
        ),
        "intrados[0] = [0, 1, 2] must have at most 2 entries, not 3",
    ),
    "thin": (("thickness: 1.5", "thickness: 0.3"), "does not stand under its own weight"),
    "thicker than its radius": (("thickness: 1.5", "thickness: 25"), "less than 20 m"),
    "no motions": (('motions:\n  files: ["records/*.AT2"]\n', ""), "motions is missing"),
    "motions a word": (('motions:\n  files: ["records/*.AT2"]', "motions: a"), "motions = a must"),
    "files empty": (('["records/*.AT2"]', "[]"), "must have a key index, files or synthetic"),
    "files nothing": (('["records/*.AT2"]', ""), "motions.files = empty must be a list"),
    "files a word": (('["records/*.AT2"]', "records"), "motions.files = records must be a list"),
    "a file of a number": (('["records/*.AT2"]', "[3]"), "motions.files[0] = 3 must be"),
    "a file without a path": (('["records/*.AT2"]', "[{unit: g}]"), "files[0].path is missing"),
    "an empty path": (('["records/*.AT2"]', "['']"), "motions.files[0] =  must not be empty"),
    "a lost file": (('["records/*.AT2"]', "[lost.AT2]"), "lost.AT2: there is no such record file"),
    "a pattern of nothing": (('["records/*.AT2"]', '["*.lost"]'), "*.lost"),
    "the study as record": (('["records/*.AT2"]', "[small.yaml]"), "small.yaml"),
    "a folder as record": (('["records/*.AT2"]', "[records]"), "records"),
    "a record of nobody": (('["records/*.AT2"]', "[~nosuchuser/a.AT2]"), "a.AT2"),
    "a lost index": (
        ('files: ["records/*.AT2"]', "index: lost.csv"),
        "lost.csv: the index cannot",
    ),
    "NUL in an index": (('files: ["records/*.AT2"]', r'index: "a\0b"'), "no control characters"),
    "an index of 300 characters": (
        ('files: ["records/*.AT2"]', f"index: {'i' * 300}"),
        "at most 255 bytes",
    ),
    "the study as index": (('files: ["records/*.AT2"]', "index: small.yaml"), "small.yaml"),
    "select of nothing": (
        ('files: ["records/*.AT2"]', "index: a.csv\n  select: []"),
        "at least one",
    ),
    "no intensity": (everything(TEXT[: TEXT.index("intensity")]), "intensity is missing"),
    "Sa(1e9)": (measure("Sa(1e9)"), "has a period of 1e+09 s; it must be from 0.01 to 20 s"),
    "Sa(1e-9)": (measure("Sa(1e-9)"), "has a period of 1e-09 s; it must be from 0.01 to 20 s"),
    "AvgSA(0.1,1e9)": (measure("AvgSA(0.1,1e9)"), "has a period of 1e+09 s"),
    "Sa(nan)": (measure("Sa(nan)"), "needs 1 period(s) in seconds, each above 0"),
    "Sa(-1)": (measure("Sa(-1)"), "needs 1 period(s)"),
    "Sa()": (measure("Sa()"), "needs 1 period(s)"),
    "Sa of two": (measure("Sa(1,2)"), "intensity.measure"),
    "AvgSA of one": (measure("AvgSA(1)"), "intensity.measure"),
    "AvgSA upside down": (measure("AvgSA(2.0,0.5)"), "needs its shorter period first"),
    "measure in small letters": (measure("pga"), "did you mean PGA?"),
    "measure is a number": (measure("1"), "intensity.measure = 1 must be text"),
    "measure is a duration": (measure("D5_95"), "to which no motion can be scaled"),
    "unit of a velocity": (("unit: g", "unit: cm/s"), "unit 'cm/s' is not one of g, m/s2"),
    "unit is nothing": (("unit: g", "unit:"), "intensity.unit = empty must be text"),
    "levels of text": (levels("[a]"), "intensity.levels[0] = a must be a number"),
    "levels of NaN": (levels("[.nan]"), "intensity.levels[0] = nan must be a finite number"),
    "levels of infinity": (levels("[.inf]"), "must be a finite number"),
    "levels a number": (levels("0.5"), "intensity.levels = 0.5 must be a list"),
    "levels fall": (levels("[2, 1]"), "must increase, but 1 follows 2"),
    "levels twice": (levels("[1, 1]"), "must increase, but 1 follows 1"),
    "levels empty": (levels("[]"), "must have at least one entry"),
    "level 1e9": (levels("[1, 1e9]"), "must be at most 1e+06, but entry 1 is 1e+09"),
    "1001 levels": (levels(str(list(range(1, 1002)))), "must have at most 1000 entries, not 1001"),
    "100000000 levels": (
        levels("{start: 1, stop: 2, count: 100000000}"),
        "less than or equal to 1000",
    ),
    "count of one": (levels("{start: 1, stop: 2, count: 1}"), "greater than or equal to 2"),
    "count of a half": (levels("{start: 1, stop: 2, count: 2.5}"), "must be a whole number"),
    "50 equal levels": (
        levels("{start: 1, stop: 1.0000000000000002, count: 50}"),
        "intensity.levels must have 50 different levels, but start = 1.0 and stop = "
        "1.0000000000000002 are too close for that",
    ),
    "start from 1e9": (levels("{start: 1e9, stop: 2e9, count: 3}"), "less than or equal to 1e+06"),
    "start in text": (levels("{start: a, stop: 2, count: 3}"), "start = a must be a number"),
    "step of a range": (levels("{start: 1, stop: 2, step: 3}"), "step is no known key"),
    "stop missing": (levels("{start: 1, count: 3}"), "intensity.levels.stop is missing"),
    "dt of 1e-9 s": (("dt: 2.0e-3", "dt: 1e-9"), "must be greater than or equal to 1e-06"),
    "dt of 10 s": (("dt: 2.0e-3", "dt: 10"), "must be less than or equal to 0.1"),
    "follow for a day": (("follow: 2.0", "follow: 86400"), "must be less than or equal to 3600"),
    "rtol for time stepping": (
        ("dt: 2.0e-3", "dt: 2.0e-3, rtol: 1e-6"),
        "rtol is 1e-06 and dt is 0.002; method time_stepping takes one of them",
    ),
    "dt for four_link": (("time_stepping", "four_link"), "method four_link does not use it"),
    "a setting of another": (
        ("dt: 2.0e-3", "settings: {stiffness: 1e9}"),
        "settings has 'stiffness'; allowed for",
    ),
    "a setting of text": (
        ("name: time_stepping, dt: 2.0e-3", "name: auto, settings: {coarse: a}"),
        "must be a number",
    ),
    "a setting out of range": (
        ("name: time_stepping, dt: 2.0e-3", "name: auto, settings: {coarse: 2}"),
        "from 0 to 1",
    ),
    "settings a list": (("dt: 2.0e-3", "settings: [1]"), "must be a mapping of keys to values"),
    "settings with a number": (("dt: 2.0e-3", "settings: {1: 2}"), "must be text"),
    "method a word": (("method: {", "method: auto\nx: {"), "x is no known key"),
    "method of nothing": (("name: time_stepping", "name:"), "method.name = empty must be text"),
    "no workers": (("workers: 2", "workers: 0"), "execution.workers = 0 must be greater"),
    "chunks of text": (("chunk: 2", "chunk: a"), "execution.chunk = a must be a whole number"),
    "execution a list": (
        ("execution: {chunk: 2, workers: 2}", "execution: [1]"),
        "must be a mapp",
    ),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("bad")
    small_study(place)
    return place


def test_there_are_as_many_kinds_as_the_reading_tried():
    assert len(BAD) >= 178


@pytest.mark.parametrize("case", BAD)
def test_bad_study_is_refused_in_a_sentence_that_names_the_fault(folder, case):
    (old, new), part = BAD[case]
    assert TEXT.count(old) == 1
    code, sentence = check(folder, TEXT.replace(old, new).encode("utf-8", "surrogatepass"))
    assert code != 0
    assert part in sentence
    assert len(sentence) < 1000


@pytest.mark.parametrize(
    "text",
    [
        title("2020-13-45"), title("yes"), title("1:30"), title("1_000"), title("0x10"),
        ("friction: 0.7", "friction: inf"), ("friction: 0.7", "friction: .inf"),
        ("friction: 0.7", "friction: [1, inf, 1, 1, 1, 1, 1, .inf]"), (RING, "radius: 1.e+1"),
    ],
)  # fmt: skip
def test_what_yaml_1_1_would_have_converted_is_text_and_inf_is_a_number(folder, text):
    assert check(folder, TEXT.replace(*text).encode())[0] == 0


@pytest.mark.parametrize("kind", ["pipe", "device", "folder"])
def test_what_is_no_file_is_not_waited_for(tmp_path, kind):
    path = {"pipe": tmp_path / "small.yaml", "device": "/dev/zero", "folder": tmp_path}[kind]
    if kind == "pipe":
        os.mkfifo(path)
    code, sentence = check(tmp_path, path=path)
    assert code == 2
    assert f"the study file {path} cannot be read" in sentence


@pytest.mark.parametrize(
    ("override", "part"),
    [
        ("arches.²=z", "arches has 2 entries, counted from 0, and ² is none of them"),
        (f"arches.{'9' * 5000}=z", "arches has 2 entries"),
        ("a." * 3000 + "a=1", "must be key=value"),
        ("title=!!int abc", "--set title: line 1: tags such as"),
        (f"title={'[' * 3000}", "--set title: line 1: more than 20 levels"),
        ("output=~nosuchuser/x", "of a user that there is not"),
    ],
)
def test_bad_override_is_refused_in_a_sentence(folder, override, part):
    code, sentence = check(folder, TEXT.encode(), "--set", override)
    assert code == 2
    assert part in sentence


def test_spoilt_studies_are_answered_within_5_seconds_and_500_megabytes(tmp_path):
    """ARCHFRAG_SPOILT_STUDIES=2000 is the number that the project's figures are of."""
    count = os.environ.get("ARCHFRAG_SPOILT_STUDIES", "150")
    done = subprocess.run(
        [sys.executable, "-m", "tests.study.mutated_studies", str(tmp_path), count],
        cwd=ROOT, capture_output=True, text=True, timeout=600,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-4000:]
    checked, refused, _, _ = done.stdout.split()
    assert int(checked) >= int(count)
    assert int(refused) > 0.9 * int(checked)
