"""Spoiled files, reproducible by their seed, read one after the other.

Run as a process of its own: ``python -m tests.motions.fuzz FIRST COUNT``. It ends itself
when a file takes too long or more memory than allowed; the last line then names the seed.
"""

import collections
import functools
import json
import re
import resource
import signal
import sys
import tempfile
import time
import traceback
from pathlib import Path

import numpy as np

from .samples import MADE_UP

MEMORY = 2**30  # [bytes] resident beyond what the interpreter with obspy has
SECONDS_A_FILE = 10  # of computing
_WORDS = ("NaN", "inf", "-Infinity", "1e999", "1D+03", "1.5d-2", "*" * 9, "1_0", "0x1F", "--1",
          "9" * 40, "", "\t", "½", "1,5", "TRUE", "-", ".", "E", "+-1")  # fmt: skip
_COUNTS = ("0", "1", "-5", "399", "401", "2147483648", "99999999", "9" * 30, "1e9", "4.5", "NaN")
_NUMBER = re.compile(rb"[-+]?\d*\.?\d+(?:[ED][-+]?\d+)?")
_INTEGER = re.compile(rb"(?<![\d.])\d{1,6}(?![\d.])")
_ENDS = (b"\r\n", b"\r", b"\r\r\n", b"\n\n", b"\x0c", b"\0", b"\x1a", b"\t\n", b" \n")
_FILLING = (b" ", b"1", b"1 ", b"-.000001", b"9\t", b"E", b"a", b"(", b"=")


@functools.cache
def originals():
    """Names and contents of the good files."""
    return [
        (name, make().encode("latin-1")) for name, makers in MADE_UP.items() for make in makers
    ]


def _any(things, random):
    return things[random.integers(len(things))]


def _inserted(content, random, more):
    place = random.integers(len(content))
    return content[:place] + more + content[place:]


def _flip(content, random):
    changed = bytearray(content)
    for place in random.integers(len(changed), size=random.integers(1, 40)):
        changed[place] ^= 1 << int(random.integers(8))
    return bytes(changed)


def _replaced(pattern, words, content, random, first=None):
    found = list(pattern.finditer(content, 0, first or len(content)))
    chosen = random.integers(len(found), size=random.integers(1, 6)) if found else ()
    for match in sorted((found[i] for i in chosen), key=lambda match: -match.start()):
        word = _any(words, random).encode("latin-1")
        if random.random() < 0.5:
            word = word.rjust(len(match[0]))[: len(match[0])]
        content = content[: match.start()] + word + content[match.end() :]
    return content


def _lines(content, random):
    """Lines left out, doubled, of another file, or with other ends."""
    lines, others = content.split(b"\n"), _any(originals(), random)[1].split(b"\n")
    for _ in range(random.integers(1, 8)):
        place, count = int(random.integers(len(lines))), int(random.integers(30))
        more = (b"", lines[place] + b"\n" + lines[place], _any(others, random),
                lines[place] + _any(_ENDS, random))  # fmt: skip
        lines[place : place + (1 if count else 20)] = [_any(more, random)]
    return b"\n".join(lines)


MUTATIONS = (
    lambda content, random: content[: random.integers(len(content) + 1)],
    _flip,
    lambda content, random: _inserted(content, random, random.bytes(random.integers(1, 300))),
    functools.partial(_replaced, _NUMBER, _WORDS),
    functools.partial(_replaced, _INTEGER, _COUNTS, first=4000),
    lambda content, random: content.replace(b"\n", _any(_ENDS, random)),
    lambda content, random: re.sub(rb" +", b"\t", content),
    lambda content, random: re.sub(rb"(\d\.\d+)(?![\dE])", rb"\1D+00", content),
    _lines,
    lambda content, random: _inserted(
        content, random, _any(_FILLING, random) * int(random.integers(1000, 100_000))
    ),
    lambda content, random: content + _any(originals(), random)[1],
)


def mutant(seed):
    """Name of the format that a file comes from, and its spoiled content."""
    random = np.random.default_rng(seed)
    name, content = _any(originals(), random)
    for _ in range(random.integers(1, 4)):
        content = _any(MUTATIONS, random)(content, random) or b"\n"
    return name, content


def is_read(read, path):
    """Whether a function gives something; if not, its refusal is a line that names the file."""
    from archfrag.errors import RecordError

    try:
        return bool(read(path))
    except RecordError as error:
        message = str(error)
    if "\n" in message or not message.startswith(str(path)) or len(message) > 1000:
        raise AssertionError(f"not one line that begins with the file: {message[:500]!r}")
    return False


def run(first, count):
    """Counts of outcomes; what should not have come is printed with its seed at once."""
    from archfrag.motions.formats.waveform import _function
    from archfrag.motions.read import read_motions

    accepting = functools.partial(read_motions, accept=("samples", "pga", "time_step", "header"))
    found: collections.Counter[str] = collections.Counter()
    slowest, base = 0.0, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    signal.signal(signal.SIGPROF, signal.SIG_DFL)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "record.txt"
        for seed in range(first, first + count):
            name, content = mutant(seed)
            path.write_bytes(content)
            print(f"seed {seed}", file=sys.stderr, flush=True)
            start = time.process_time()
            signal.setitimer(signal.ITIMER_PROF, SECONDS_A_FILE)
            try:
                found["motion" if is_read(accepting, path) else "refusal"] += 1
                # The reader itself, for files that are no longer recognised.
                is_read(_function(name, "read", ""), path)
            except Exception:
                print(json.dumps({"seed": seed, "fault": traceback.format_exc()[-900:]}))
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            slowest = max(slowest, time.process_time() - start)
    used = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - base)
    print(json.dumps({"counts": found, "slowest": slowest, "memory": used}))
    return used < MEMORY


if __name__ == "__main__":
    sys.exit(0 if run(int(sys.argv[1]), int(sys.argv[2])) else 3)
