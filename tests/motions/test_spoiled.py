"""Spoiled files of every text format, reproducible by their seed: each is read or refused."""

import collections
import re
import resource
import time

import numpy as np
import pytest

from archfrag.errors import RecordError
from archfrag.motions.read import read_motions

from .samples import MADE_UP

_WORDS = ("NaN", "-Infinity", "1e999", "1D+03", "*" * 9, "1_0", "--1", "9" * 40, "", "\t", "½",
          "1,5", "-", "E", "0", "-5", "401", "99999999", "4.5")  # fmt: skip
_NUMBER = re.compile(rb"[-+]?\d*\.?\d+(?:[ED][-+]?\d+)?")
_ENDS = (b"\r\n", b"\r", b"\r\r\n", b"\n\n", b"\x0c", b"\0", b"\x1a", b"\t\n", b" \n")
_FILLING = (b" ", b"1", b"1 ", b"-.000001", b"9\t", b"E", b"a", b"(", b"=")
GOOD = [make().encode("latin-1") for makers in MADE_UP.values() for make in makers]


def any_of(things, random):
    return things[random.integers(len(things))]


def inserted(content, random, more):
    place = random.integers(len(content))
    return content[:place] + more + content[place:]


def replaced(content, random):
    """Some numbers, most of the header, become other words."""
    found = list(_NUMBER.finditer(content, 0, any_of((4000, len(content)), random)))
    chosen = random.integers(len(found), size=random.integers(1, 6)) if found else ()
    for match in sorted((found[i] for i in chosen), key=lambda match: -match.start()):
        word = any_of(_WORDS, random).encode("latin-1").rjust(len(match[0]))
        content = content[: match.start()] + word + content[match.end() :]
    return content


def other_lines(content, random):
    """Lines left out, doubled, of another file, or with other ends."""
    lines, others = content.split(b"\n"), any_of(GOOD, random).split(b"\n")
    for _ in range(random.integers(1, 8)):
        place, count = int(random.integers(len(lines))), int(random.integers(30))
        more = (b"", lines[place] + b"\n" + lines[place], any_of(others, random),
                lines[place] + any_of(_ENDS, random))  # fmt: skip
        lines[place : place + (1 if count else 20)] = [any_of(more, random)]
    return b"\n".join(lines)


MUTATIONS = (
    lambda content, random: content[: random.integers(len(content) + 1)],
    lambda content, random: inserted(content, random, random.bytes(random.integers(1, 300))),
    replaced,
    lambda content, random: content.replace(b"\n", any_of(_ENDS, random)),
    lambda content, random: re.sub(rb" +", b"\t", content),
    other_lines,
    lambda content, random: inserted(
        content, random, any_of(_FILLING, random) * int(random.integers(1000, 100_000))
    ),
    lambda content, random: content + any_of(GOOD, random),
)


@pytest.mark.slow
def test_each_is_read_or_refused_in_one_line_in_time(tmp_path):
    found, path = collections.Counter(), tmp_path / "record.txt"
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
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
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 2**20  # [kB]
