"""Spoiled files, reproducible by their seed, read one after the other.

Run as a process of its own: ``python -m tests.motions.fuzz FIRST COUNT``. A file that takes too
long ends it; the last line of its standard error then names the seed.
"""

import collections
import functools
import json
import re
import resource
import signal
import sys
import tempfile
import traceback
from pathlib import Path

import numpy as np

from .samples import MADE_UP

MEMORY = 2**30  # [bytes] resident beyond what the interpreter with obspy has
SECONDS_A_FILE = 10  # of computing
_WORDS = ("NaN", "-Infinity", "1e999", "1D+03", "*" * 9, "1_0", "--1", "9" * 40, "", "\t", "½",
          "1,5", "-", "E", "0", "-5", "401", "99999999", "4.5")  # fmt: skip
_NUMBER = re.compile(rb"[-+]?\d*\.?\d+(?:[ED][-+]?\d+)?")
_ENDS = (b"\r\n", b"\r", b"\r\r\n", b"\n\n", b"\x0c", b"\0", b"\x1a", b"\t\n", b" \n")
_FILLING = (b" ", b"1", b"1 ", b"-.000001", b"9\t", b"E", b"a", b"(", b"=")


@functools.cache
def originals():
    """Contents of the good files."""
    return [make().encode("latin-1") for makers in MADE_UP.values() for make in makers]


def _any(things, random):
    return things[random.integers(len(things))]


def _inserted(content, random, more):
    place = random.integers(len(content))
    return content[:place] + more + content[place:]


def _replaced(content, random):
    found = list(_NUMBER.finditer(content, 0, _any((4000, len(content)), random)))
    chosen = random.integers(len(found), size=random.integers(1, 6)) if found else ()
    for match in sorted((found[i] for i in chosen), key=lambda match: -match.start()):
        word = _any(_WORDS, random).encode("latin-1").rjust(len(match[0]))
        content = content[: match.start()] + word + content[match.end() :]
    return content


def _lines(content, random):
    """Lines left out, doubled, of another file, or with other ends."""
    lines, others = content.split(b"\n"), _any(originals(), random).split(b"\n")
    for _ in range(random.integers(1, 8)):
        place, count = int(random.integers(len(lines))), int(random.integers(30))
        more = (b"", lines[place] + b"\n" + lines[place], _any(others, random),
                lines[place] + _any(_ENDS, random))  # fmt: skip
        lines[place : place + (1 if count else 20)] = [_any(more, random)]
    return b"\n".join(lines)


MUTATIONS = (
    lambda content, random: content[: random.integers(len(content) + 1)],
    lambda content, random: _inserted(content, random, random.bytes(random.integers(1, 300))),
    _replaced,
    lambda content, random: content.replace(b"\n", _any(_ENDS, random)),
    lambda content, random: re.sub(rb" +", b"\t", content),
    _lines,
    lambda content, random: _inserted(
        content, random, _any(_FILLING, random) * int(random.integers(1000, 100_000))
    ),
    lambda content, random: content + _any(originals(), random),
)


def run(first, count):
    """Counts of outcomes; what should not have come is printed with its seed at once."""
    from archfrag.errors import RecordError
    from archfrag.motions.read import read_motions

    found: collections.Counter[str] = collections.Counter()
    base = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    signal.signal(signal.SIGPROF, signal.SIG_DFL)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "record.txt"
        for seed in range(first, first + count):
            random = np.random.default_rng(seed)
            content = _any(originals(), random)
            for _ in range(random.integers(1, 4)):
                content = _any(MUTATIONS, random)(content, random) or b"\n"
            path.write_bytes(content)
            print(f"seed {seed}", file=sys.stderr, flush=True)
            signal.setitimer(signal.ITIMER_PROF, SECONDS_A_FILE)
            try:
                read_motions(path, accept="samples,pga,time_step,header")
                found["motion"] += 1
            except RecordError as error:
                found["refusal"] += 1
                if "\n" in str(error) or not str(error).startswith(str(path)):
                    print(json.dumps({"seed": seed, "message": str(error)[:500]}))
            except Exception:
                print(json.dumps({"seed": seed, "fault": traceback.format_exc()[-900:]}))
            signal.setitimer(signal.ITIMER_PROF, 0.0)
    used = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - base)
    print(json.dumps({"counts": found, "memory": used}))


if __name__ == "__main__":
    run(int(sys.argv[1]), int(sys.argv[2]))
