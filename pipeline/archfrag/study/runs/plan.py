"""What the runs of a study follow from, the identity of each, and those requested at once."""

import hashlib
import json
from dataclasses import asdict, dataclass, fields
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from archfrag.errors import InputError
from archfrag.fragility.counts import Verdict
from archfrag.kernel_cache import kernel_hash
from archfrag.study.file.members import check_buildable, needs_records
from archfrag.study.file.records import PreparedRecord, load_prepared
from archfrag.study.file.schema import Study
from archfrag.study.files import PACKAGE, canonical_json, digest_of, write_text
from archfrag.study.runs.design import NO_CASES, Cases, Design, Grid, Requests, Verdicts
from archfrag.study.runs.designs import design_of

# Code beside the kernels that decides what a run is and what its row holds.
DECIDING = ("methods/**/*.py", "simulat*/**/*.py", "simulat*.py", "study/runs/outcome.py")
KEY = 16  # bytes


@dataclass(frozen=True)
class Plan:
    """All that decides what the runs of a study are, and nothing that does not."""

    study: str
    folder: str  # of work
    arches: tuple[dict[str, Any], ...]  # as their models dump them
    meets: tuple[int, ...]  # (n_arch,): the one record that an arch meets, -1 if all
    records: tuple[PreparedRecord, ...]
    levels: tuple[float, ...]  # (n_level,): in the SI unit of the measure
    power: float  # a level grows with the factor to the power 1 / `power`
    measure: str
    method: dict[str, Any]
    design: dict[str, Any]
    chains: tuple[str, ...]  # (n_arch,): digests of all that the kernels know of each arch
    identity: str  # hash of the kernels and of the code that calls them

    @property
    def parts(self) -> Path:
        """Folder of the parts: one for each state of the kernels, whose runs no other can use."""
        return Path(self.folder) / "parts" / self.identity[:12]

    @cached_property
    def path(self) -> Path:
        """Where the plan is stored for workers."""
        return self.parts / f"plan-{self.digest[:12]}.json"

    @cached_property
    def digest(self) -> str:
        """Of all of it but the folder: the same plan makes the same cube."""
        return digest_of({**self._dump(), "folder": ""})

    def digests(self) -> dict[str, str]:
        """Digest of each part of the plan, by the name that a message gives it."""
        plain = self._dump() | {"archfrag": self.identity, "arches": [self.arches, self.chains]}
        hidden = ("folder", "identity", "chains")
        return {k: digest_of(v) for k, v in plain.items() if k not in hidden}

    def _dump(self) -> dict[str, Any]:
        plain = {each.name: getattr(self, each.name) for each in fields(self)}
        return plain | {"records": [asdict(record) for record in self.records]}

    def save(self) -> None:
        """Store the plan for workers."""
        write_text(self.path, canonical_json(self._dump()) + "\n")

    @classmethod
    def load(cls, path: Path) -> "Plan":
        """Inverse of `save`."""
        stored = json.loads(path.read_text(encoding="utf-8"))
        stored["records"] = [PreparedRecord(**entry) for entry in stored["records"]]
        given: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in stored.items()
        }
        return cls(**given)

    def factors(self, cases: Cases) -> NDArray[np.float64]:
        """Factors that bring the records of runs to their levels, (n,)."""
        return self._unscaled[cases["record"]] * cases["level"] ** self.power

    @cached_property
    def _unscaled(self) -> NDArray[np.float64]:
        return np.array([record.factor for record in self.records])

    def keys(self, cases: Cases) -> NDArray[np.void]:
        """Identity of each run: of kernels, method, arch, motion and factor, (n,) of 16 bytes."""
        given, count = f"{self.identity}/{digest_of(self.method)}", len(self.records)
        pair = cases["arch"] * np.int64(count) + cases["record"]
        stems = {}
        for each in np.unique(pair).tolist():
            own = f"{self.chains[each // count]}/{self.records[each % count].samples}"
            stems[each] = hashlib.blake2b(f"{given}/{own}/".encode(), digest_size=KEY)
        found = []
        for each, factor in zip(pair.tolist(), self.factors(cases).astype("<f8")):
            state = stems[each].copy()
            state.update(factor.tobytes())
            found.append(state.digest())
        return np.frombuffer(b"".join(found), f"V{KEY}")

    @cached_property
    def asks(self) -> Design:
        """The design."""
        return design_of(self.design)

    def iterations(self, batch: int = 0, batches: int = 1) -> "Iterations":
        """What the design requests, of all of it or of one of several batches."""
        if not 0 <= batch < batches:
            raise InputError(f"--batch {batch}: must be from 0 to {batches - 1}")
        from archfrag.fragility.quoted import shared_events

        requests, measures = {}, self._measures()
        events = np.array([record.event for record in self.records])
        for arch, record in enumerate(self.meets):
            records = np.arange(len(self.records)) if record < 0 else np.array([record])
            # What an adaptive design requests follows from all runs of an arch.
            share = arch if self.asks.adaptive else arch * len(self.records) + records
            records = records[np.broadcast_to(share % batches == batch, records.shape)]
            if records.size:
                requests[arch] = self.asks.requests(Grid(
                    arch, records, np.array(self.levels), self._unscaled[records], self.power,
                    measures[records], shared_events(events[records]),
                ))  # fmt: skip
        return Iterations(requests)

    def _measures(self) -> NDArray[np.float64]:
        """ln of the records' other measures where the study's own is 1, (n_record, n_measure)."""
        from archfrag.motions.measures import scaling_exponent

        names = [name for name in self.records[0].measures if name != self.measure]
        values = np.array([[r.measures[name] for name in names] for r in self.records])
        values = values.reshape(len(self.records), len(names))
        exponents = np.array([scaling_exponent(name) for name in names], dtype=float)
        with np.errstate(divide="ignore"):
            logs = np.log(values) + exponents * np.log(self._unscaled)[:, None]
        return logs[:, np.isfinite(logs).all(axis=0)]


def make_plan(study: Study) -> Plan:
    """Plan of a study whose motions are prepared."""
    from archfrag.motions.measures import scaling_exponent

    records = load_prepared(study)
    arches = study.members(len(records))
    if needs_records(study.arches):
        check_buildable(arches)  # of which the study's file shows those of one record
    return Plan(
        study=study.id,
        folder=str(study.work),
        arches=tuple(entry.parameters for entry in arches.entries),
        meets=tuple(-1 if each.record is None else each.record for each in arches),
        records=tuple(records),
        levels=study.intensity.si,
        power=1.0 / scaling_exponent(study.intensity.measure),
        measure=study.intensity.measure,
        method=study.method.model_dump(),
        design=study.design.model_dump(mode="json"),
        chains=tuple(member.chain for member in arches),
        identity=digest_of([kernel_hash(), _deciding()]),
    )


@cache
def _deciding() -> str:
    """Digest of the code of `DECIDING`."""
    digest = hashlib.sha256()
    for path in sorted({path for pattern in DECIDING for path in PACKAGE.glob(pattern)}):
        digest.update(str(path.relative_to(PACKAGE)).encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


class Iterations:
    """The runs that a design requests for all arches at once, iteration by iteration."""

    def __init__(self, requests: dict[int, Requests]) -> None:
        self.notes: dict[int, dict[str, Any]] = {}  # by arch: what its design returned
        self.count = 0  # iterations answered
        self.requested: Cases = NO_CASES  # at last none
        self._asked: list[tuple[int, Requests, Cases]] = []
        for arch, each in requests.items():
            self._ask(arch, each, None)
        self._gather()

    def _ask(self, arch: int, requests: Requests, verdicts: Verdicts | None) -> None:
        try:
            cases = next(requests) if verdicts is None else requests.send(verdicts)
            while not len(cases):
                cases = requests.send(np.empty(0, np.int8))
            self._asked.append((arch, requests, cases))
        except StopIteration as over:
            self.notes[arch] = over.value

    def _gather(self) -> None:
        self.requested = np.concatenate([NO_CASES, *(cases for _, _, cases in self._asked)])

    def answer(self, verdicts: Verdicts) -> None:
        """Take the verdicts of all runs of the iteration, in the order of `requested`."""
        made = (verdicts >= 0) & (verdicts < Verdict.NOT_SIMULATED)
        if len(verdicts) != len(self.requested) or not made.all():
            raise ValueError("each run of an iteration must have been made")
        asked, self._asked = self._asked, []
        ends = np.cumsum([len(cases) for _, _, cases in asked])
        for (arch, requests, _), own in zip(asked, np.split(verdicts, ends[:-1])):
            self._ask(arch, requests, own)
        self.count += 1
        self._gather()
