"""What the runs of a study follow from, and what each of them is."""

import ast
import hashlib
import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, fields
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from archfrag.errors import InputError
from archfrag.fragility.quoted import shared_events
from archfrag.kernel_cache import kernel_hash
from archfrag.study.config import Study
from archfrag.study.design import Cloud, Design, Ida, Scattered
from archfrag.study.files import PACKAGE, canonical_json, digest_of, write_text
from archfrag.study.grids import Grid, ida, stripes
from archfrag.study.members import check_buildable, members, needs_records
from archfrag.study.records import PreparedRecord, load_prepared
from archfrag.study.rounds import Cases, Rounds, Strand, cloud, scattered

# Code beside the kernels that decides what a run is and what its row holds.
DECIDING = (
    "methods/auto.py", "methods/event_driven/front.py", "methods/registry.py",
    "methods/time_stepping/front.py", "simulation/checks.py", "simulation/many.py",
    "study/outcome.py",
)  # fmt: skip
KEY = 16  # bytes


def _mixed(bits: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """A permutation of 64 bits in which each bit depends on all others.

    The last step of the generator splitmix64 (Steele, Lea, Flood, Fast splittable pseudorandom
    number generators, OOPSLA 2014, variant 13 of D. Stafford).
    """
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        bits = (bits ^ (bits >> np.uint64(shift))) * np.uint64(factor)
    return bits ^ (bits >> np.uint64(31))


@dataclass(frozen=True)
class Plan:
    """All that decides what the runs of a study are, and nothing that does not."""

    study: str
    folder: str  # of work
    arches: tuple[dict[str, Any], ...]  # as their models dump them
    meets: tuple[int, ...]  # (n_arch,): the one record that an arch meets, -1 if all
    records: tuple[PreparedRecord, ...]
    levels: tuple[float, ...]  # (n_level,): in the SI unit of the measure
    power: float  # A level grows with the factor to the power 1 / `power`
    measure: str
    # By stage: the study's, and the coarse one of a design in two stages.
    methods: tuple[dict[str, Any], ...]
    design: dict[str, Any]
    chains: tuple[str, ...]  # (n_arch,): digests of all that the kernels know of each arch
    identity: str  # hash of the kernels and of the code that calls them
    _digests: dict[Any, bytes] = field(default_factory=dict, init=False, compare=False, repr=False)

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
        plain = {each.name: getattr(self, each.name) for each in fields(self) if each.init}
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
        return self._at_one[cases["record"]] * cases["level"] ** self.power

    @cached_property
    def _at_one(self) -> NDArray[np.float64]:
        return np.array([record.factor for record in self.records])

    def keys(self, cases: Cases, factors: NDArray[np.float64]) -> NDArray[np.void]:
        """Identity of each run: of kernels, arch, motion, factor and method, (n,) of 16 bytes.

        Of the runs that have all but the factor in common no two have the same key: `_mixed` is
        a permutation. Any others have it by the chance of a hash of 128 bits.
        """
        size = len(self.arches), len(self.records)
        kinds = (cases["stage"] * np.int64(size[0]) + cases["arch"]) * size[1] + cases["record"]
        found, which = np.unique(kinds, return_inverse=True)
        stems = np.zeros((len(found), 2), "<u8")
        for row, kind in enumerate(found.tolist()):
            before, record = divmod(kind, size[1])
            stage, arch = divmod(before, size[0])
            state = hashlib.blake2b(self._stem(stage, arch, record), digest_size=KEY)
            stems[row] = np.frombuffer(state.digest(), "<u8")
        bits = np.ascontiguousarray(factors, "<f8").view("<u8")
        mixed = _mixed(bits)[:, None] * np.array([1, 3], np.uint64)
        return _mixed(stems[which] ^ mixed).astype("<u8").view(f"V{KEY}").reshape(-1)

    def _stem(self, stage: int, arch: int, record: int) -> bytes:
        """What runs of an arch under a record by a method have in common."""
        known = self._digests
        if (stage, arch) not in known:
            parts = (self.identity, digest_of(self.methods[stage]), self.chains[arch])
            known[stage, arch] = "/".join((*parts, "")).encode()
        return known[stage, arch] + self.records[record].samples.encode()

    def rounds(self, batch: int = 0, batches: int = 1) -> Rounds:
        """What the design asks for, of all of it or of one of several batches."""
        if not 0 <= batch < batches:
            raise InputError(f"--batch {batch}: must be from 0 to {batches - 1}")
        return Rounds(dict(self._strands(batch, batches)))

    def _strands(self, batch: int, batches: int) -> Iterator[tuple[int, Strand]]:
        design = TypeAdapter[Design](Design).validate_python(self.design)
        levels, measures = np.array(self.levels), self._measures()
        for arch, record in enumerate(self.meets):
            records = np.arange(len(self.records)) if record < 0 else np.array([record])
            if design.kind == "stripes":
                own = records[(arch * len(self.records) + records) % batches == batch]
                if own.size:
                    yield arch, stripes(Grid(arch, own, levels, measures[own]))
            # What these ask for follows from all runs of an arch.
            elif arch % batches != batch:
                continue
            elif isinstance(design, Ida):
                groups = shared_events([self.records[i].event for i in records])
                grid = Grid(arch, records, levels, measures[records], groups)
                yield arch, ida(grid, design)
            elif isinstance(design, Scattered):
                yield arch, scattered(arch, records, levels, design)
            elif isinstance(design, Cloud):
                own_levels = (design.factor / self._at_one[records]) ** (1.0 / self.power)
                yield arch, cloud(arch, records, own_levels)

    def _measures(self) -> NDArray[np.float64]:
        """ln of the records' other measures where the study's own is 1, (n_record, n_measure)."""
        from archfrag.motions.measures import scaling_exponent

        names = [name for name in self.records[0].measures if name != self.measure]
        values = np.array([[r.measures[name] for name in names] for r in self.records])
        values = values.reshape(len(self.records), len(names))
        exponents = np.array([scaling_exponent(name) for name in names], dtype=float)
        with np.errstate(divide="ignore"):
            logs = np.log(values) + exponents * np.log(self._at_one)[:, None]
        return logs[:, np.isfinite(logs).all(axis=0)]


def make_plan(study: Study) -> Plan:
    """Plan of a study whose motions are prepared."""
    from archfrag.motions.measures import scaling_exponent

    design, records = study.design, load_prepared(study)
    arches = members(study, len(records))
    if needs_records(study.arches):
        check_buildable(arches)  # of which the study's file shows those of one record
    methods = [study.method.model_dump()]
    if design.kind == "two_stage":
        coarse = design.coarse
        same = {"follow": study.method.follow, "loss_limit": study.method.loss_limit}
        methods.append(coarse.model_copy(update=same).model_dump())
    return Plan(
        study=study.id,
        folder=str(study.work),
        arches=tuple(entry.model_dump() for entry in arches.entries),
        meets=tuple(-1 if each.record is None else each.record for each in arches),
        records=tuple(records),
        levels=study.intensity.si,
        power=1.0 / scaling_exponent(study.intensity.measure),
        measure=study.intensity.measure,
        methods=tuple(methods),
        design=design.model_dump(mode="json"),
        chains=tuple(member.chain for member in arches),
        identity=digest_of([kernel_hash(), _deciding()]),
    )


@cache
def _deciding() -> str:
    """Digest of the code of `DECIDING`, without its comments and docstrings."""
    digest = hashlib.sha256()
    for name in DECIDING:
        tree = ast.parse((PACKAGE / name).read_bytes())
        for node in ast.walk(tree):
            if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
                node.value.value = ""
        digest.update(f"{name} {ast.dump(tree)}".encode())
    return digest.hexdigest()
