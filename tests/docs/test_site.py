"""The site is built as a reader gets it: no warning, no dead link, no request to anywhere."""

import json
import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urldefrag, urlparse

import pytest

ROOT = Path(__file__).parents[2]
LOADED = {
    "script": "src",
    "link": "href",
    "img": "src",
    "iframe": "src",
    "source": "src",
    "video": "src",
    "object": "data",
    "embed": "src",
    "use": "href",
    "image": "href",
}

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("site")]


def test_readme_is_one_page_whose_links_lead_somewhere():
    text = (ROOT / "README.md").read_text("utf-8")
    links = [link for link in re.findall(r"\]\(([^)#]+)", text) if "://" not in link]
    assert len(links) > 8
    assert [link for link in links if not (ROOT / link).exists()] == []
    assert len(re.sub("```.*?```", "", text, flags=re.S).split()) < 480


def test_pages_can_be_read_as_source():
    """On a forge no cell runs: links have words, pages begin with prose, visible code fits."""
    others = ("evidence", "practice", "validation")
    for path in (ROOT / "docs").rglob("*.md"):
        name = path.relative_to(ROOT / "docs").as_posix()
        text = path.read_text("utf-8")
        if name.startswith(others) or name in ("changelog.md", "contributing.md"):
            continue
        assert re.findall(r"\[\]\(\S+", text) == [], name
        first = re.split(r"^# .*\n", text, maxsplit=1, flags=re.M)[1].strip()
        assert re.match(r"[\w$`][^`{|]", first), f"{name}: {first[:60]}"
        for block in re.findall(r"^```(.*?)^```", text, re.M | re.S):
            if "remove-" not in block and not block.startswith("{glossary}"):
                assert [line for line in block.splitlines() if len(line) > 88] == [], (
                    name
                )


class Page(HTMLParser):
    """Anchors, links and what is loaded of one page."""

    def __init__(self, path):
        super().__init__()
        self.anchors = {""}
        self.links = []
        self.loaded = []
        self.tags = set()
        self.feed(path.read_text("utf-8"))

    def handle_starttag(self, tag, attributes):
        found = dict(attributes)
        self.tags.add(tag)
        self.anchors |= {found[key] for key in ("id", "name") if found.get(key)}
        if tag == "a" and found.get("href"):
            self.links.append(found["href"])
        value = found.get(LOADED.get(tag, ""))
        if value and not (
            tag == "link" and found.get("rel") in ("canonical", "alternate")
        ):
            self.loaded.append(value)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    out = tmp_path_factory.mktemp("site")
    command = [
        sys.executable,
        "-m",
        "sphinx",
        "-j",
        "2",
        "-E",
        "-q",
        "-W",
        "--keep-going",
        "-n",
    ]
    # Jupyter chooses ports before it binds them: on a busy machine another process may be first.
    for _ in range(2):
        done = subprocess.run(
            [*command, "-d", str(out / "trees"), str(ROOT / "docs"), str(out / "html")],
            capture_output=True,
            text=True,
            cwd=out,
            env={**os.environ, "NO_COLOR": "1"},
        )
        if "Address already in use" not in done.stderr:
            break
    assert done.returncode == 0, done.stderr[-6000:]
    return out / "html"


@pytest.fixture(scope="module")
def pages(site):
    return {
        path.relative_to(site).as_posix(): Page(path)
        for path in site.rglob("*.html")
        if "_static" not in path.parts
    }


def test_every_link_between_pages_leads_to_its_place(site, pages):
    assert "math" in pages["method/index.html"].tags
    assert "study-vary" in pages["study_file.html"].anchors
    assert "made/tutorial-report.html" in pages
    broken = []
    for name, page in pages.items():
        for link in page.links:
            target, anchor = urldefrag(link)
            if urlparse(link).scheme or link.startswith("//"):
                continue
            path = (site / name).parent / unquote(target) if target else site / name
            place = os.path.relpath(path, site)
            known = pages[place].anchors if place in pages else {"", unquote(anchor)}
            if not path.exists() or unquote(anchor) not in known:
                broken.append(f"{name}: {link}")
    assert broken == []


def test_nothing_is_loaded_from_a_network(site, pages):
    asked = [
        f"{name}: {value}"
        for name, page in pages.items()
        for value in page.loaded
        if urlparse(value).scheme not in ("", "data") or value.startswith("//")
    ]
    for path in site.rglob("*.css"):
        text = path.read_text("utf-8").replace("'", "").replace('"', "")
        asked += [
            f"{path.name}: {mark}"
            for mark in ("url(http", "url(//", "@import")
            if mark in text
        ]
    assert asked == []


def test_every_figure_has_a_colour_for_dark_pages(site, pages):
    figures = [
        figure
        for name in pages
        if not name.startswith("made/")
        for figure in re.findall(
            r'<figure class="drawn.*?</figure>',
            (site / name).read_text("utf-8"),
            re.DOTALL,
        )
    ]
    assert len(figures) > 50
    drawn = [re.sub(r"light-dark\([^)]*\)|&#\w+;", "", figure) for figure in figures]
    bare = re.compile(
        r"""[:"'] ?(?:#(?:[0-9a-f]{6}|[0-9a-f]{3})\b|white\b|black\b)""", re.I
    )
    assert [found[0] for figure in drawn if (found := bare.findall(figure))] == []
    assert not any("<img" in (site / name).read_text("utf-8") for name in pages)


def test_gallery_shows_nine_pages_with_figures_and_notebooks_that_stand_alone(
    site, pages
):
    text = (site / "gallery" / "index.html").read_text("utf-8")
    cards = re.findall(r'<a class="card" href="([^"]+)">(.*?)</a>', text, re.DOTALL)
    assert len({name for name, _ in cards}) == 9
    assert all("<svg" in inside and "?" in inside for _, inside in cards)
    for name, _ in cards:
        (link,) = [
            each for each in pages[f"gallery/{name}"].links if each.endswith(".ipynb")
        ]
        notebook = json.loads((site / "gallery" / link).read_text("utf-8"))
        cells = ["".join(cell["source"]) for cell in notebook["cells"]]
        assert "import archfrag as af" in "".join(cells)
        of_site = re.compile(r"ARCHFRAG_DOCS|import (look|showing)|\.md\)")
        assert [each for each in cells if of_site.search(each)] == []
        outputs = [one for cell in notebook["cells"] for one in cell.get("outputs", [])]
        assert any(
            {"image/png", "text/html"} & set(one.get("data", ())) for one in outputs
        )
