"""Names and texts are in the field's terms: words that crept in once are counted, and are none."""

import re
import subprocess
from pathlib import Path

ROOT = Path(__file__).parents[1]
SELF = "tests/test_words.py"
WHERE = ("pipeline", "tests", "docs", "configs", "README.md", "Snakefile")
SUFFIXES = {".py", ".md", ".smk", ".j2", ".yaml", ""}

# What to write, and a pattern of what not to; identifiers are split at underscores and capitals.
TERMS = {
    "setting, method setting": r"ways?|knobs?",
    "mega-voussoirs; full chain; a small number; entire": r"few|whole",
    "diagnostics; energy balance": r"ledgers?|book(ed|s|ing)?|accounts?",
    "workspace, buffer": r"rooms?",
    "fraction; inverse weight": r"shares?",
    "reference speed, scales, reference time": r"falling|pace",
    "energy balance error": r"strays?",
    "residual; remainder": r"the rest",
    "rotation; angular velocity": r"turn(s|ed|ing)?",
    "static equilibrium; reconcile": r"settl(e|es|ed|ing)",
    "accumulation of events; quiescent": r"crowd(s|ed)?|calm",
    "recover; propagate; dispersion, range": r"spread(s|ing)?|carr(y|ies|ied|ying)",
    "ground acceleration": r"(push|shake) [xy]|g[xy]|s[xy]",
    "tensile, compressive": r"pulls?|presse[sd]",
    "reported, states; message": r"told|tells?|says?|said|sentences?",
    "other solver": r"peers?",
    "switch to time stepping": r"hand(s|ed)? overs?",
    "expensive; sampling scatter; zero; corrected; available": r"dear(er|est)?|luck(y|ily)?|"
    r"face value|nought|mend(s|ed)?|at hand",
    "layer, module": r"houses?|floors",
}


def found(text: str) -> list[str]:
    """Words of the left column, each with its line and the term to use."""
    text = re.sub(r"([a-z])([A-Z])", r"\1 \2", text).replace("_", " ").replace("PEER", "")
    return [
        f"line {number}: {match.group(0)} -> {better}"
        for number, line in enumerate(text.splitlines(), 1)
        for better, pattern in TERMS.items()
        for match in re.finditer(rf"(?i)\b(?:{pattern})\b", line)
        if "slurm account" not in line
    ]


def test_words_are_seen_in_names_and_texts():
    words = found("def hand_over(self):\n    '''Says it.'''\n    FewBodies = 1  # by luck")
    assert len(words) == 4
    assert not found("PEER's records; shaped; a fraction of the residual")


def test_only_terms_of_the_field():
    names = subprocess.check_output(["git", "ls-files", *WHERE], cwd=ROOT, text=True).splitlines()
    paths = [ROOT / name for name in names if name != SELF]
    listed = [f"{path}: {word}" for path in paths if path.suffix in SUFFIXES and path.exists()
              for word in found(path.read_text())]  # fmt: skip
    assert len(paths) > 300
    assert not listed, "\n".join(listed)
