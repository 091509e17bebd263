"""The run table of a study: arch x record x level in a fixed order, cut into chunks."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from archfrag import __version__
from archfrag.errors import InputError
from archfrag.kernel_cache import kernel_hash
from archfrag.study.config import Study
from archfrag.study.digests import canonical_json, digest_of, source_hash
from archfrag.study.files import write_text
from archfrag.study.records import PreparedRecord, load_prepared

if TYPE_CHECKING:
    import pandas as pd

# Source, beside the kernels, that an edit of which may change results.
DECIDING = (
    "arch", "mechanics", "methods", "simulate.py", "simulation", "study/arches.py",
    "study/case.py", "study/outcome.py", "study/worker.py",
)  # fmt: skip
# Enough parts for an even share among workers, few enough for a file system; runs enough in each
# that four go side by side to near its end.
PARTS_WANTED, SMALLEST_CHUNK, LARGEST_CHUNK = 500, 32, 200


@dataclass(frozen=True)
class Plan:
    """All that decides what the runs of a study are, and nothing that does not.

    Run ``(a * n_record + r) * n_level + l`` is arch a, record r, level l.
    """

    study: str
    folder: str  # of work
    arches: tuple[dict[str, Any], ...]
    records: tuple[PreparedRecord, ...]
    levels: tuple[float, ...]  # (n_level,) in the SI unit of the measure
    method: dict[str, Any]
    chunk: int
    identity: str  # hash of all that decides the results and how they are cut into parts

    @property
    def n_run(self) -> int:
        """Number of runs."""
        return len(self.arches) * len(self.records) * len(self.levels)

    @property
    def n_chunk(self) -> int:
        """Number of chunks, and so of parts."""
        return -(-self.n_run // self.chunk)

    def rows(self, chunk: int) -> range:
        """Runs of a chunk."""
        return range(chunk * self.chunk, min((chunk + 1) * self.chunk, self.n_run))

    def case(self, run: int) -> tuple[int, int, int]:
        """Arch, record and level of a run, counted from 0."""
        rest, level = divmod(run, len(self.levels))
        arch, record = divmod(rest, len(self.records))
        return arch, record, level

    def part(self, chunk: int) -> Path:
        """Part file of a chunk."""
        return Path(self.folder) / "parts" / f"{chunk:06d}-{self.identity[:12]}.npz"

    def timing(self, chunk: int) -> Path:
        """File with the wall times of a chunk."""
        return Path(self.folder) / "timings" / f"{chunk:06d}-{self.identity[:12]}.csv"

    @property
    def path(self) -> Path:
        """Where the plan is stored for workers."""
        return Path(self.folder) / "parts" / f"plan-{self.identity[:12]}.json"

    def save(self) -> None:
        """Store the plan for workers.

        Raises
        ------
        OutputError
        """
        write_text(self.path, canonical_json(asdict(self)) + "\n")

    @classmethod
    def load(cls, path: Path) -> "Plan":
        """Inverse of `save`."""
        stored = json.loads(path.read_text(encoding="utf-8"))
        records = tuple(
            PreparedRecord(**(entry | {"factors": tuple(entry["factors"])}))
            for entry in stored.pop("records")
        )
        arches, levels = tuple(stored.pop("arches")), tuple(stored.pop("levels"))
        return cls(arches=arches, records=records, levels=levels, **stored)


def make_plan(study: Study) -> Plan:
    """Plan of a study whose motions are prepared.

    Raises
    ------
    InputError
        If they are not.
    """
    records = load_prepared(study)
    arches = [entry.model_dump() for entry in study.arches]
    levels = study.intensity.si
    n_run = len(arches) * len(records) * len(levels)
    wanted = -(-n_run // PARTS_WANTED)
    chunk = study.execution.chunk or min(max(wanted, SMALLEST_CHUNK), LARGEST_CHUNK)
    decides = {
        "archfrag": __version__,
        "kernels": kernel_hash(),
        "source": source_hash(*DECIDING),
        "arches": arches,
        "records": [[r.id, r.prepared, *r.factors] for r in records],
        "measure": study.intensity.measure,
        "levels": levels,
        "method": study.method.model_dump(),
        "chunk": chunk,
    }
    return Plan(
        study=study.id,
        folder=str(study.work),
        arches=tuple(arches),
        records=tuple(records),
        levels=levels,
        method=study.method.model_dump(),
        chunk=chunk,
        identity=digest_of(decides),
    )


def run_table(plan: Plan, chunks: Sequence[int] | None = None) -> "pd.DataFrame":
    """Runs of a plan, or of some of its chunks, one row each.

    Returns
    -------
    DataFrame
        Columns run, chunk, arch, record, level [SI], factor [1], duration [s].
    """
    import pandas as pd

    runs = [
        run for chunk in (range(plan.n_chunk) if chunks is None else chunks)
        for run in plan.rows(chunk)
    ]  # fmt: skip
    cases = [plan.case(run) for run in runs]
    return pd.DataFrame(
        {
            "run": runs,
            "chunk": [run // plan.chunk for run in runs],
            "arch": [plan.arches[a]["id"] for a, _, _ in cases],
            "record": [plan.records[r].id for _, r, _ in cases],
            "level": [plan.levels[i] for _, _, i in cases],
            "factor": [plan.records[r].factors[i] for _, r, i in cases],
            "duration": [plan.records[r].duration for _, r, _ in cases],
        }
    )


def chunks_of_batch(plan: Plan, batch: int, batches: int) -> range:
    """Chunks of one of several batches; neighbouring chunks go to different batches.

    Raises
    ------
    InputError
        If there is no such batch.
    """
    if not 0 <= batch < batches:
        raise InputError(f"--batch {batch}: must be from 0 to {batches - 1}")
    return range(batch, plan.n_chunk, batches)
