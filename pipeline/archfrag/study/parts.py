"""Part files: the results of one chunk, written whole or not at all."""

import json
import zipfile

import numpy as np
from numpy.typing import NDArray

from archfrag.study.digests import canonical_json
from archfrag.study.files import replacing
from archfrag.study.outcome import COLUMNS
from archfrag.study.plan import Plan


def _header(plan: Plan, chunk: int) -> dict[str, object]:
    rows = plan.rows(chunk)
    return {"study": plan.study, "plan": plan.identity, "chunk": chunk, "first": rows.start,
            "runs": len(rows)}  # fmt: skip


def write_part(plan: Plan, chunk: int, table: dict[str, NDArray]) -> None:
    """Write the part of a chunk; the same results give the same bytes.

    Raises
    ------
    OutputError
        If it cannot be written; no half of it is left.
    """
    header = np.frombuffer(canonical_json(_header(plan, chunk)).encode(), dtype=np.uint8)
    path = plan.part(chunk)
    # Not made lasting: what a power cut tears, `read_part` takes for missing.
    with replacing(path, lasting=False) as temporary, open(temporary, "wb") as file:
        np.savez(file, header=header, **table)  # type: ignore[arg-type]


def read_part(plan: Plan, chunk: int) -> dict[str, NDArray] | None:
    """Results of a chunk; None if there is no part, or one that is damaged or another plan's."""
    n = len(plan.rows(chunk))
    try:
        with np.load(plan.part(chunk), allow_pickle=False) as archive:
            if json.loads(archive["header"].tobytes()) != _header(plan, chunk):
                return None
            table = {c.name: archive[c.name] for c in COLUMNS}
            table |= {name: archive[name] for name in ("model", "model_time")}
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
    fits = all(table[c.name].shape == (n,) and table[c.name].dtype == c.dtype for c in COLUMNS)
    fits = fits and table["model_time"].shape == (n, table["model"].size)
    return table if fits else None


def forget_other_plans(plan: Plan) -> None:
    """Remove parts, wall times and plans that are not of this plan but of older ones."""
    for folder in (plan.part(0).parent, plan.timing(0).parent):
        for path in folder.glob("*-*.*"):
            if path.stem.split("-")[-1] != plan.identity[:12]:
                path.unlink(missing_ok=True)
