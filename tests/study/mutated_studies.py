"""Study files spoilt at random, each checked as `archfrag validate` does; run by a test.

``python -m tests.study.mutated_studies FOLDER COUNT`` works in FOLDER and prints how many of the
files were refused.
"""

import copy
import datetime
import math
import random
import re
import resource
import sys
import time
from pathlib import Path

import yaml

from tests.study.small import TEXT, command, small_study

LONGEST, LARGEST = 5.0, 500.0  # [s] of CPU time: other work on the machine is no fault; [MB]
PLAIN = (
    0, -1, 1, 2, 10**9, -(2**70), 1e-300, 1e300, 0.5, math.inf, math.nan, None, True,
    datetime.date(2020, 1, 1), "", "~", "~nobody", "inf", "Sa(1e9)", "Sa(1e-9)", "AvgSA(1,2)",
    "PGV", "g", "a\0b", "\x1b[2J", "é\u202e\ud800", "x" * 5000, "yes", "[a", "*.AT2", "2e-3",
)  # fmt: skip


def peak_memory():
    """Largest resident memory of this program so far [MB]; `ru_maxrss` counts the parent's too."""
    status = Path("/proc/self/status").read_text()
    return int(re.search(r"VmHWM:\s+(\d+) kB", status)[1]) * 1024 / 1e6


def places(value, here=()):
    """Keys and indices of all that is inside a value."""
    items = value.items() if isinstance(value, dict) else enumerate(value)
    for key, inner in items:
        yield (*here, key)
        if isinstance(inner, dict | list):
            yield from places(inner, (*here, key))


def value(draw):
    """Any value: a plain one, or some of them in a list or a mapping."""
    some = [draw.choice(PLAIN) for _ in range(draw.randint(0, 4))]
    mapping = {draw.choice(PLAIN): inner for inner in some}
    return draw.choice([draw.choice(PLAIN), draw.choice(PLAIN), some, mapping])


def spoilt(draw):
    """A study with one to three of its values replaced, taken out, repeated or renamed."""
    study = yaml.safe_load(TEXT)
    for _ in range(draw.randint(1, 3)):
        if not (found := list(places(study))):
            break
        *outer, last = draw.choice(found)
        parent = study
        for key in outer:
            parent = parent[key]
        what = draw.choice(["replace", "replace", "replace", "drop", "repeat", "rename"])
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


def check(folder, content=b"", *options, path=None):
    """Validate a file, or `content` as one: exit code and message, empty if in order."""
    if path is None:
        path = folder / "small.yaml"
        path.write_bytes(content)
    result = command("validate", path, *options)
    assert result.exit_code in (0, 2, 3, 4), (result.exit_code, result.stderr, result.exception)
    if result.exit_code:
        assert isinstance(result.exception, SystemExit)
        assert result.stderr.startswith("archfrag: error: ")
        assert len(result.stderr.splitlines()) == 1, result.stderr
        for foreign in ("Input should", "String should", "Value error", "of a kind that has no"):
            assert foreign not in result.stderr, result.stderr
    return result.exit_code, result.stderr


def run(folder, count):
    """Check so many files, with little more memory to take than what is loaded now."""
    small_study(folder)
    check(folder, TEXT.encode())  # loads what any other will need
    size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (size + int(LARGEST * 1e6),) * 2)
    draw, refused = random.Random(1), 0
    for _ in range(count):
        content, started = spoilt(draw), time.process_time()
        refused += check(folder, content)[0] != 0
        assert time.process_time() - started < LONGEST, content[:2000]
    assert peak_memory() < LARGEST
    print(refused)


if __name__ == "__main__":
    run(Path(sys.argv[1]), int(sys.argv[2]))
