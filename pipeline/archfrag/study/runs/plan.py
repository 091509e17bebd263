"""What the runs of a study follow from, the identity of each, and what a batch requests."""

import hashlib
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from archfrag.errors import InputError
from archfrag.kernel_cache import kernel_hash
from archfrag.study.file.members import Members, check_buildable, needs_records
from archfrag.study.file.records import PreparedRecord, load_prepared
from archfrag.study.file.schema import Study
from archfrag.study.files import digest_of, digest_of_code
from archfrag.study.runs.design import Cases, Grid, Requests

# Code beside the kernels that decides what a run is, and what its row holds.
DECIDING = (
    "methods/**/*.py", "simulat*/**/*.py", "simulat*.py",
    "study/runs/outcome.py", "study/runs/variables.csv",
)  # fmt: skip
KEY = 16  # bytes


@dataclass(frozen=True)
class Plan:
    """All that decides what the runs of a study are."""

    study: Study
    arches: Members
    records: tuple[PreparedRecord, ...]

    @cached_property
    def identity(self) -> str:
        """Digest of the kernels and of the code that calls them."""
        return digest_of([kernel_hash(), digest_of_code(*DECIDING)])

    @property
    def parts(self) -> Path:
        """Folder of the parts: one for each state of the kernels, whose runs no other can use."""
        return self.study.work / "parts" / self.identity[:12]

    @cached_property
    def method(self) -> dict[str, Any]:
        """The method and its options, as plain values."""
        return self.study.method.model_dump()

    @cached_property
    def levels(self) -> NDArray[np.float64]:
        """Levels of the study, (n_level,) [SI]."""
        return np.array(self.study.intensity.si)

    @cached_property
    def power(self) -> float:
        """A level grows with the factor to the power 1 / `power`."""
        from archfrag.motions.measures import scaling_exponent

        return 1.0 / scaling_exponent(self.study.intensity.measure)

    @cached_property
    def digests(self) -> dict[str, str]:
        """Digest of each part of the plan, by the name that a message gives it."""
        study = self.study
        parts = {
            "archfrag": self.identity,
            "study": study.id,
            "arches": [[m.entry.parameters, m.chain, m.record] for m in self.arches],
            "records": [asdict(record) for record in self.records],
            "levels": study.intensity.si,
            "measure": study.intensity.measure,
            "method": self.method,
            "design": study.design.model_dump(mode="json"),
        }
        return {name: digest_of(part) for name, part in parts.items()}

    @cached_property
    def _unscaled(self) -> NDArray[np.float64]:
        return np.array([record.factor for record in self.records])

    def factors(self, cases: Cases) -> NDArray[np.float64]:
        """Factors that bring the records of runs to their levels, (n,)."""
        return self._unscaled[cases["record"]] * cases["level"] ** self.power

    def keys(self, cases: Cases) -> NDArray[np.void]:
        """Identity of each run: of kernels, method, arch, motion and factor, (n,) of 16 bytes."""
        given, count = f"{self.identity}/{digest_of(self.method)}", len(self.records)
        pair = cases["arch"] * np.int64(count) + cases["record"]
        stems = {}
        for each in np.unique(pair).tolist():
            own = f"{self.arches[each // count].chain}/{self.records[each % count].samples}"
            stems[each] = hashlib.blake2b(f"{given}/{own}/".encode(), digest_size=KEY)
        keys = []
        for each, factor in zip(pair.tolist(), self.factors(cases).astype("<f8")):
            state = stems[each].copy()
            state.update(factor.tobytes())
            keys.append(state.digest())
        return np.frombuffer(b"".join(keys), f"V{KEY}")

    def requests(self, batch: int = 0, batches: int = 1) -> dict[int, Requests]:
        """What the design asks for, by arch, of all of it or of one of several batches."""
        if not 0 <= batch < batches:
            raise InputError(f"--batch {batch}: must be from 0 to {batches - 1}")
        from archfrag.fragility.quoted import shared_events

        design = self.study.design
        events = np.array([record.event for record in self.records])
        requests, measures = {}, self._measures()
        for arch, member in enumerate(self.arches):
            every = member.record is None
            records = np.arange(len(self.records)) if every else np.array([member.record])
            # What an adaptive design requests follows from all runs of an arch.
            share = arch if design.adaptive else arch * len(self.records) + records
            records = records[np.broadcast_to(share % batches == batch, records.shape)]
            if records.size:
                requests[arch] = design.requests(Grid(
                    arch, records, self.levels, self._unscaled[records], self.power,
                    measures[records], shared_events(events[records]),
                ))  # fmt: skip
        return requests

    def _measures(self) -> NDArray[np.float64]:
        """ln of the records' other measures where the study's own is 1, (n_record, n_measure)."""
        from archfrag.motions.measures import scaling_exponent

        own = self.study.intensity.measure
        names = [name for name in self.records[0].measures if name != own]
        values = np.array([[r.measures[name] for name in names] for r in self.records])
        exponents = np.array([scaling_exponent(name) for name in names], dtype=float)
        with np.errstate(divide="ignore"):
            logs = np.log(values) + exponents * np.log(self._unscaled)[:, None]
        return logs[:, np.isfinite(logs).all(axis=0)]


def make_plan(study: Study) -> Plan:
    """Plan of a study whose motions are prepared."""
    records = load_prepared(study)
    arches = study.members(len(records))
    if needs_records(study.arches):
        check_buildable(arches)  # of which the study's file shows those of one record
    return Plan(study, arches, tuple(records))
