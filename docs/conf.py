"""The site: Sphinx with MyST pages whose cells run while it is built.

``python -m sphinx -W --keep-going -n docs build/site`` builds it. Nothing is loaded from a
network, neither while it is built nor when it is read.
"""

import os
import shutil
import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "extensions"))
# Cells call `archfrag` as a person would; it stands beside the interpreter that builds.
os.environ["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
os.environ["ARCHFRAG_DOCS"] = str(HERE)
os.environ["PYTHONPATH"] = str(HERE / "extensions")
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
    "mathml",
    "study_keys",
]
exclude_patterns = ["build", "**/results/**", "**/data/**", "howto/study"]

myst_enable_extensions = ["amsmath", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
myst_links_external_new_tab = False
nb_execution_mode = "force"
nb_execution_show_tb = True  # with -W a cell that fails is an error
nb_execution_timeout = 600  # of one cell, on a loaded machine with kernels to compile
nb_execution_in_temp = True
nb_output_stderr = "remove"  # progress

autodoc_typehints = "none"
autodoc_member_order = "bysource"
numpydoc_show_class_members = False

html_theme = "furo"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_math_renderer = "mathml"
html_show_sphinx = False
html_show_copyright = False
html_copy_source = False
html_theme_options = {"navigation_with_keys": False}
html_baseurl = ""


def setup(app):
    """Cells put files that pages link into the built site; one study serves several pages."""
    study = Path(app.doctreedir) / "finished-study"
    shutil.rmtree(study, ignore_errors=True)
    os.environ.update(ARCHFRAG_SITE=str(app.outdir), ARCHFRAG_FINISHED=str(study))
