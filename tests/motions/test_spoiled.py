"""Spoiled files of every text format, reproducible by their seed: each is read or refused."""

import collections
import re
import time

import numpy as np
import pytest

from archfrag.errors import RecordError
from archfrag.motions.read import read_motions

from .samples import MADE_UP

WORDS = ("NaN", "-Infinity", "1e999", "1D+03", "*" * 9, "1_0", "--1", "9" * 40, "", "\t", "½",
         "1,5", "-", "E", "0", "-5", "401", "99999999", "4.5")  # fmt: skip
NUMBER = re.compile(rb"[-+]?\d*\.?\d+(?:[ED][-+]?\d+)?")
ENDS = (b"\r\n", b"\r", b"\n\n", b"\x0c", b"\0", b"\x1a", b"\t\n", b" \n")
GOOD = [make().encode("latin-1") for makers in MADE_UP.values() for make in makers]


def any_of(things, random):
    return things[random.integers(len(things))]


def inserted(content, random, more):
    place = random.integers(len(content))
    return content[:place] + more + content[place:]


def replaced(content, random):
    """Some numbers, most of the header, become other words."""
    found = list(NUMBER.finditer(content, 0, any_of((4000, len(content)), random)))
    chosen = random.integers(len(found), size=random.integers(1, 6)) if found else ()
    for match in sorted((found[i] for i in chosen), key=lambda match: -match.start()):
        word = any_of(WORDS, random).encode("latin-1").rjust(len(match[0]))
        content = content[: match.start()] + word + content[match.end() :]
    return content


def other_lines(content, random):
    """Lines left out or of another file."""
    lines, others = content.split(b"\n"), any_of(GOOD, random).split(b"\n")
    for _ in range(random.integers(1, 8)):
        place, count = int(random.integers(len(lines))), any_of((1, 20), random)
        lines[place : place + count] = [any_of((b"", any_of(others, random)), random)]
    return b"\n".join(lines)


MUTATIONS = (
    lambda content, random: content[: random.integers(len(content) + 1)],
    lambda content, random: inserted(content, random, random.bytes(random.integers(1, 300))),
    replaced,
    lambda content, random: content.replace(b"\n", any_of(ENDS, random)),
    other_lines,
    lambda content, random: inserted(
        content, random, any_of((b" ", b"1", b"9\t", b"E", b"="), random) * 50_000
    ),
    lambda content, random: content + any_of(GOOD, random),
)


@pytest.mark.slow
def test_each_is_read_or_refused_in_one_line_in_time(tmp_path):
    found, path = collections.Counter(), tmp_path / "record.txt"
    for seed in range(20260000, 20260250):
        random = np.random.default_rng(seed)
        content = any_of(GOOD, random)
        for _ in range(random.integers(1, 4)):
            content = any_of(MUTATIONS, random)(content, random) or b"\n"
        path.write_bytes(content)
        begun, message = time.process_time(), f"{path}"
        try:
            read_motions(path, accept="samples,pga,time_step,header")
            found["motion"] += 1
        except RecordError as error:
            found["refusal"] += 1
            message = str(error)
        assert message.startswith(str(path)), seed
        assert "\n" not in message, seed
        assert time.process_time() - begun < 10.0, seed
    # Some of the files can still be read, most cannot.
    assert min(found["motion"], found["refusal"]) > 250 / 20
