"""The site: Sphinx with MyST pages whose cells run while it is built.

``python -m sphinx -W --keep-going -n docs build/site`` builds it. Nothing is loaded from a
network, neither while it is built nor when it is read.
"""

import hashlib
import os
import shutil
import sys
import time
from importlib.metadata import distributions
from pathlib import Path

from jupyter_cache import get_cache

HERE = Path(__file__).parent


def content() -> str:
    """Digest of what the cells of all pages use: code, data and installed packages."""
    digest = hashlib.sha256(sys.version.encode())
    for name in sorted(f"{each.name} {each.version}" for each in distributions()):
        digest.update(name.encode())
    for top in ("pipeline", "docs", "configs", "records"):
        for path in sorted((HERE.parent / top).rglob("*")):
            page = top == "docs" and path.suffix in (".md", ".css")
            made = path.suffix == ".pyc" or ".egg-info" in str(path)
            if path.is_file() and not page and not made:
                digest.update(str(path.relative_to(HERE.parent)).encode() + path.read_bytes())
    return digest.hexdigest()[:16]


# Pages whose cells have run are kept for as long as nothing that they use changes.
DAY = 86_400.0  # [s]
KEPT = HERE.parent / "build" / "pages" / content()
(KEPT / "site").mkdir(parents=True, exist_ok=True)
os.utime(KEPT)
for other in KEPT.parent.glob("*"):
    if time.time() - other.stat().st_mtime > DAY:  # no other build uses it
        shutil.rmtree(other, ignore_errors=True)
get_cache(KEPT).list_cache_records()  # makes its database before two processes do
sys.path.insert(0, str(HERE / "extensions"))
# Cells call `archfrag` as a person would; it stands beside the interpreter that builds.
os.environ["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
os.environ["ARCHFRAG_DOCS"] = str(HERE)
os.environ["ARCHFRAG_KEPT"] = str(KEPT)
os.environ["PYTHONPATH"] = os.pathsep.join(
    filter(None, [str(HERE / "extensions"), os.environ.get("PYTHONPATH")])
)
os.environ.setdefault("PYDEVD_DISABLE_FILE_VALIDATION", "1")

project = "archfrag"
author = "The archfrag developers"
html_title = "archfrag"

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "numpydoc",
    "sphinx_click",
    "cells",
    "gallery",
    "mathml",
    "study_keys",
]
exclude_patterns = ["build", "**/results/**", "**/data/**", "howto/study"]

myst_enable_extensions = ["amsmath", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
myst_links_external_new_tab = False
nb_execution_mode = "cache"
nb_execution_cache_path = str(KEPT)
nb_execution_show_tb = True  # with -W a cell that fails is an error
nb_execution_timeout = 600  # of one cell, on a loaded machine with kernels to compile
nb_execution_in_temp = True
nb_output_stderr = "remove"  # progress

autodoc_typehints = "none"
autodoc_member_order = "bysource"
numpydoc_show_class_members = False

html_theme = "furo"
html_static_path = ["_static"]
html_extra_path = [str(KEPT / "site")]  # files that cells made and pages link
html_css_files = ["site.css"]
html_math_renderer = "mathml"
html_show_sphinx = False
html_show_copyright = False
html_copy_source = False
html_theme_options = {"navigation_with_keys": False}
html_baseurl = ""
