"""Study files spoilt at random, each checked as `archfrag validate` does; run by a test.

``python -m tests.study.mutated_studies FOLDER COUNT`` works in FOLDER and prints the number of
files that were refused, the longest time [s] and the peak memory [MB].
"""

import copy
import re
import resource
import sys
import time
from pathlib import Path

import yaml
from click.testing import CliRunner
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from archfrag.cli import main
from tests.study.small import TEXT, small_study

LONGEST, LARGEST = 5.0, 500.0  # [s] of CPU time: other work on the machine is no fault; [MB]
CODES = (0, 2, 3, 4)
NUMBERS = st.one_of(
    st.integers(), st.floats(), st.sampled_from([0, -1, 1, 2, 10**9, 1e-300, 1e300, 0.5, 1e8])
)
TEXTS = st.one_of(
    st.text(st.characters(exclude_characters="/"), max_size=20),
    st.sampled_from(["", "~", "~nobody", "inf", "Sa(1e9)", "Sa(1e-9)", "AvgSA(1,2)", "PGV", "g"]),
)
VALUES = st.recursive(
    st.one_of(NUMBERS, TEXTS, st.none(), st.booleans(), st.dates()),
    lambda inner: st.one_of(
        st.lists(inner, max_size=4), st.dictionaries(TEXTS | NUMBERS, inner, max_size=3)
    ),
    max_leaves=8,
)


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


@st.composite
def spoilt_values(draw):
    """A study with one to three of its values replaced, taken out, repeated or renamed."""
    study = yaml.safe_load(TEXT)
    for _ in range(draw(st.integers(1, 3))):
        found = list(places(study))
        if not found:
            break
        *outer, last = draw(st.sampled_from(found))
        parent = study
        for key in outer:
            parent = parent[key]
        what = draw(st.sampled_from(["replace", "replace", "replace", "drop", "repeat", "rename"]))
        if what == "replace":
            parent[last] = draw(VALUES)
        elif what == "drop":
            del parent[last]
        elif isinstance(parent, list):
            parent.insert(last, copy.deepcopy(parent[last]))
        elif what == "rename":
            parent[draw(TEXTS)] = parent.pop(last)
        else:
            parent[last] = [parent[last]] * draw(st.integers(0, 5000))
    return yaml.safe_dump(study, allow_unicode=True).encode("utf-8", "surrogatepass")


def check(folder, content=b"", *options, path=None):
    """Validate a file, or `content` as one: exit code and message, empty if in order."""
    if path is None:
        path = folder / "small.yaml"
        path.write_bytes(content)
    result = CliRunner().invoke(main, ["validate", str(path), *options])
    assert result.exit_code in CODES, (result.exit_code, result.stderr, result.exception)
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
    seen = []

    @settings(
        max_examples=count, deadline=None, derandomize=True, database=None,
        suppress_health_check=list(HealthCheck), phases=[Phase.generate, Phase.shrink],
    )  # fmt: skip
    @given(spoilt_values())
    def all_are_answered(content):
        started = time.process_time()
        code, _ = check(folder, content)
        seen.append((code, time.process_time() - started))
        assert seen[-1][1] < LONGEST

    all_are_answered()
    assert len(seen) >= count
    assert peak_memory() < LARGEST
    refused = sum(code != 0 for code, _ in seen)
    print(len(seen), refused, f"{max(took for _, took in seen):.2f}", f"{peak_memory():.0f}")


if __name__ == "__main__":
    run(Path(sys.argv[1]), int(sys.argv[2]))
