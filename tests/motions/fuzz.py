"""Read spoiled files one after the other and say what came of each.

Run as a process of its own: ``python -m tests.motions.fuzz FIRST COUNT [SECONDS]``. It ends itself
when a file takes too long or more memory than allowed; the last line then names the seed.
"""

import collections
import json
import resource
import signal
import sys
import tempfile
import time
import traceback
from importlib import import_module
from pathlib import Path

MEMORY = 2**30  # [bytes] resident beyond what the interpreter with obspy has
SECONDS_A_FILE = 10


def outcome(path, name):
    """What a file gives: a motion, a sentence, or an exception that should not have come."""
    from archfrag.motions.formats.waveform import OWN
    from archfrag.motions.read import read_motions

    accept = ("samples", "pga", "time_step", "header")
    motions = sentence_or(lambda: read_motions(path, accept=accept), path)
    # The reader itself, for files that are no longer recognised.
    module = import_module(f"archfrag.motions.formats.{OWN[name]}")
    sentence_or(lambda: getattr(module, f"read_{name.lower()}")(path), path)
    return "sentence" if motions is None else "motion"


def sentence_or(read, path):
    """What a function gives, None if it is one sentence that names the file."""
    from archfrag.errors import RecordError

    try:
        return read()
    except RecordError as error:
        sentence = str(error)
    if "\n" in sentence or not sentence.startswith(str(path)) or len(sentence) > 1000:
        raise AssertionError(f"not one sentence that begins with the file: {sentence[:500]!r}")
    return None


def run(first, count, seconds=None):
    """Counts of outcomes; what should not have come is printed with its seed at once."""
    from .mutations import mutant

    found: collections.Counter[str] = collections.Counter()
    begun, slowest = time.monotonic(), 0.0
    base = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(first, first + count):
            if seconds is not None and time.monotonic() - begun > seconds:
                break
            name, content = mutant(seed)
            path = Path(folder) / "record.txt"
            path.write_bytes(content)
            print(f"seed {seed}", file=sys.stderr, flush=True)
            start = time.monotonic()
            signal.alarm(SECONDS_A_FILE)
            try:
                result = outcome(path, name)
            except Exception:
                result = "fault"
                print(json.dumps({"seed": seed, "fault": traceback.format_exc()[-900:]}))
            signal.alarm(0)
            slowest = max(slowest, time.monotonic() - start)
            found[f"{name} {result}"] += 1
    used = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - base)
    print(json.dumps({"counts": found, "slowest": slowest, "memory": used}))
    return used < MEMORY


if __name__ == "__main__":
    limits = [float(word) for word in sys.argv[3:4]]
    sys.exit(0 if run(int(sys.argv[1]), int(sys.argv[2]), *limits) else 3)
