"""Spoiled files of every text format: a motion or one sentence, in little time and memory."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from .fuzz import MEMORY, SECONDS_A_FILE

ROOT = Path(__file__).parents[2]
FILES = 500
SEED = 20_260_000


@pytest.mark.slow
def test_spoiled_files():
    command = [sys.executable, "-m", "tests.motions.fuzz", str(SEED), str(FILES)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300)
    last = done.stderr.splitlines()[-1:]
    assert done.returncode == 0, f"ended with {done.returncode} at {last}: {done.stdout[-3000:]}"
    *faults, summary = map(json.loads, done.stdout.splitlines())
    assert faults == []
    counts = summary["counts"]
    assert sum(counts.values()) == FILES
    assert summary["memory"] < MEMORY
    assert summary["slowest"] < SECONDS_A_FILE
    # Some of the files can still be read, most cannot.
    for kind in ("motion", "sentence"):
        assert sum(n for key, n in counts.items() if key.endswith(kind)) > FILES / 20
