"""Files spoiled at random from small good ones, reproducible by their seed."""

import functools
import re

import numpy as np

from .samples import MADE_UP

_WORDS = ("NaN", "inf", "-Infinity", "1e999", "1D+03", "1.5d-2", "*" * 9, "1_0", "0x1F", "--1",
          "9" * 40, "", "\t", "½", "1,5", "TRUE", "-", ".", "E", "+-1")  # fmt: skip
_COUNTS = ("0", "1", "-5", "399", "401", "2147483648", "99999999", "9" * 30, "1e9", "4.5", "NaN")
_NUMBER = re.compile(rb"[-+]?\d*\.?\d+(?:[ED][-+]?\d+)?")
_INTEGER = re.compile(rb"(?<![\d.])\d{1,6}(?![\d.])")
_ENDS = (b"\r\n", b"\r", b"\r\r\n", b"\n\n", b"\x0c", b"\0", b"\x1a", b"\t\n", b" \n")


@functools.cache
def originals():
    """Names and contents of the good files."""
    return [
        (name, make().encode("latin-1")) for name, makers in MADE_UP.items() for make in makers
    ]


def _cut(content, random):
    return content[: random.integers(len(content) + 1)]


def _flip(content, random):
    changed = bytearray(content)
    for place in random.integers(len(changed), size=random.integers(1, 40)):
        changed[place] ^= 1 << int(random.integers(8))
    return bytes(changed)


def _bytes(content, random):
    place = random.integers(len(content))
    return content[:place] + random.bytes(random.integers(1, 300)) + content[place:]


def _replaced(pattern, words, content, random, first=None):
    found = list(pattern.finditer(content, 0, first or len(content)))
    if not found:
        return content
    for match in sorted(
        (found[i] for i in random.integers(len(found), size=random.integers(1, 6))),
        key=lambda match: -match.start(),
    ):
        word = words[random.integers(len(words))].encode("latin-1")
        if random.random() < 0.5:
            word = word.rjust(len(match[0]))[: len(match[0])]
        content = content[: match.start()] + word + content[match.end() :]
    return content


def _number(content, random):
    return _replaced(_NUMBER, _WORDS, content, random)


def _count(content, random):
    return _replaced(_INTEGER, _COUNTS, content, random, first=4000)


def _ends(content, random):
    lines = content.split(b"\n")
    ends = [_ENDS[i] if random.random() < 0.3 else b"\n"
            for i in random.integers(len(_ENDS), size=len(lines))]  # fmt: skip
    return b"".join(line + end for line, end in zip(lines, ends))


def _blanks(content, random):
    share = random.random()
    return b"".join(
        b"\t" if word.isspace() and b"\n" not in word and random.random() < share else word
        for word in re.split(rb"(\s+)", content)
    )


def _fortran(content, random):
    return re.sub(
        rb"(\d\.\d+)(?![\dE])", rb"\1D+00" if random.random() < 0.5 else rb"\1D0", content
    )


def _lines(content, random):
    """Lines left out, doubled, moved or of another file."""
    lines = content.split(b"\n")
    _, other = originals()[random.integers(len(originals()))]
    others = other.split(b"\n")
    for _ in range(random.integers(1, 8)):
        place = int(random.integers(len(lines)))
        kind = random.integers(4)
        if kind == 0 and len(lines) > 1:
            del lines[place : place + int(random.integers(1, 30))]
            lines = lines or [b""]
        elif kind == 1:
            lines.insert(place, lines[place])
        elif kind == 2:
            lines.insert(place, lines.pop(int(random.integers(len(lines)))))
        else:
            lines.insert(place, others[random.integers(len(others))])
    return b"\n".join(lines)


def _long(content, random):
    """Rows without end: all blanks, digits or samples."""
    filling = (b" ", b"1", b"1 ", b"-.000001", b"9\t", b"E", b"a", b"(", b"=")
    place = random.integers(len(content))
    row = filling[random.integers(len(filling))] * int(random.integers(1000, 100_000))
    return content[:place] + row + content[place:]


def _joined(content, random):
    _, other = originals()[random.integers(len(originals()))]
    return content + other if random.random() < 0.5 else content * int(random.integers(2, 5))


MUTATIONS = (
    _cut,
    _flip,
    _bytes,
    _number,
    _count,
    _ends,
    _blanks,
    _fortran,
    _lines,
    _long,
    _joined,
)


def mutant(seed):
    """Name of the format that a file comes from, and its spoiled content."""
    random = np.random.default_rng(seed)
    name, content = originals()[random.integers(len(originals()))]
    for _ in range(random.integers(1, 4)):
        change = MUTATIONS[random.integers(len(MUTATIONS))]
        content = change(content, random) or b"\n"
    return name, content
