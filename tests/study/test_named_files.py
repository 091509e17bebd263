"""Files that a study names are read as what they are: kinds by content, nothing is waited for."""

import os

import pytest

from archfrag.errors import InputError
from archfrag.study.validate import logo_url
from tests.study.small import TEXT, command, small_study

PNG = b"\x89PNG\r\n\x1a\n rest"
JPEG = b"\xff\xd8\xff\xe0 rest"
ROOT = b'<svg xmlns="http://www.w3.org/2000/svg"><path d="M0 0h1"/></svg>'
SVG = b'\xef\xbb\xbf<?xml version="1.0"?>\n<!-- made by hand -->\n' + ROOT


@pytest.mark.parametrize(
    ("name", "content", "kind"),
    [
        ("logo.PNG", PNG, "png"),
        ("a.JPG", JPEG, "jpeg"),
        ("b.Svg", SVG, "svg+xml"),
        ("no suffix", PNG, "png"),
        ("wrong.png", JPEG, "jpeg"),
        ("plain.svg", ROOT, "svg+xml"),
    ],
)
def test_a_picture_is_known_by_its_content(tmp_path, name, content, kind):
    (tmp_path / name).write_bytes(content)
    assert logo_url(str(tmp_path / name)).startswith(f"data:image/{kind};base64,")


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("empty.svg", b""),
        ("a.svg", b"not svg"),
        ("b.svg", b"<html/>"),
        ("c.png", b"GIF89a"),
        ("d.svg", b"<svg>"),
        ("e.svg", b"<svg/>"),
        ("pw.png", b"root:x:0:0:root:/root:/bin/sh"),
        ("cut.png", PNG[:6]),
    ],
)
def test_what_is_no_picture_is_refused_whatever_its_name(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(
        InputError, match=r"report.logo: .* no picture; it must be PNG, JPEG or S"
    ):
        logo_url(str(tmp_path / name))


# Keys that name a file, in the text of the small study.
BLOCK = "profile: block, width: 0.4, height: 2.0, friction: .inf"
FILES = 'files: ["records/*.AT2"]'
KEYS = {
    "logo": TEXT + "report: {logo: X}\n",
    "hazard": TEXT + "risk: {hazard: X}\n",
    "drawing": TEXT.replace(BLOCK, "drawing: X, friction: 0.6"),
    "table": TEXT.replace(BLOCK, "table: X"),
    "index": TEXT.replace(FILES, "index: X"),
    "files": TEXT.replace(FILES, "files: [X]"),
    "inventory": TEXT.replace(
        FILES, "files: [{path: records/wave0.AT2, inventory: X}]"
    ),
}


@pytest.mark.posix
@pytest.mark.parametrize("key", KEYS)
def test_a_pipe_a_device_and_what_is_too_large_are_refused_at_once(tmp_path, key):
    path = small_study(tmp_path, KEYS[key])
    place = tmp_path / "X"
    os.mkfifo(tmp_path / "pipe")
    with open(tmp_path / "huge", "wb") as file:
        file.truncate(3_000_000_000)  # takes no space on the disk
    for target, why in (
        ("/dev/zero", "it is not a regular file"),
        (tmp_path / "pipe", "it is not a regular file"),
        (tmp_path / "huge", "has 3000000000 bytes"),
    ):
        place.symlink_to(target)
        found = command("validate", path)
        assert (found.exit_code, why in found.stderr) == (2, True), found.stderr
        assert "X" in found.stderr
        place.unlink()


@pytest.mark.posix
def test_info_does_not_wait_for_a_pipe(tmp_path):
    os.mkfifo(tmp_path / "cube.nc")
    found = command("info", tmp_path / "cube.nc")
    assert (found.exit_code, "is missing, damaged or no cube" in found.stderr) == (
        2,
        True,
    )
