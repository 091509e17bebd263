"""Names in code are the field's terms. Texts are plain English, and no test counts their words."""

import ast
import re
from pathlib import Path

import pytest

PACKAGES = Path(__file__).parents[2] / "pipeline"

# The term to write, and the words that once stood for it.
TERMS = {
    "collapsed, survived, unfinished, failed": "fell stood fallen",
    "requested, iteration, design": "wanted rounds strand strands",
    "horizontal, vertical, transverse": "across upward",
    "impulse": "kick kicks",
    "compare": "beside",
    "contact, joint mode, relative velocity": "touch bears parting",
    "warnings, errors, waivers": "doubt doubts faults",
    "diagnostics, energy balance": "note notes ledger account",
    "exporters, test case, method level": "receivers scene scenes ladder rung rungs",
    "non-monotone": "island islands resurrections",
    "effective number": "worth",
    "interrupt, with fallback": "serve anyhow patiently",
    "method setting": "knob knobs",
}
# Words that parts of the code still use; each goes from here with its last use.
STILL_USED = {"scene", "scenes"}


def words_to_replace(source: str) -> dict[str, str]:
    """Return each name that a module defines and that holds a word of `TERMS`, with the term."""
    nodes = list(ast.walk(ast.parse(source)))
    names = {
        node.name for node in nodes if isinstance(node, ast.FunctionDef | ast.ClassDef)
    }
    names |= {node.arg for node in nodes if isinstance(node, ast.arg)}
    names |= {
        n.id for n in nodes if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)
    }
    better = {word: term for term, words in TERMS.items() for word in words.split()}
    return {
        name: better[word]
        for name in names
        for word in re.sub(r"([a-z])([A-Z])", r"\1_\2", name).lower().split("_")
        if word in better and word not in STILL_USED
    }


def test_a_wrong_name_is_noticed_and_a_text_is_not():
    source = (
        "def turn_knob(ledger_row):\n"
        "    '''Turn the knob; the rest tells the way.'''\n"
        "    BigLedger = 1"
    )
    assert set(words_to_replace(source)) == {"turn_knob", "ledger_row", "BigLedger"}


@pytest.mark.parametrize("package", ["archfrag", "archbench"])
def test_names_are_terms_of_the_field(package):
    paths = sorted((PACKAGES / package).rglob("*.py"))
    listed = {
        str(path): words
        for path in paths
        if (words := words_to_replace(path.read_text()))
    }
    assert paths
    assert not listed
