"""What is exported: the curves of several arches and limit states, and how they were made."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from archfrag.errors import FitError, InputError
from archfrag.fragility.fit import Fragility

_NAME = re.compile(r"[A-Za-z0-9_-]{1,75}")
_NOTED = 1e-3  # probability from which a crossing of two curves is worth a caution


@dataclass(frozen=True)
class Made:
    """How an export was made; the same for the same cube and code, so that files are too."""

    study: str
    title: str
    version: str  # of the archfrag that wrote the export
    commit: str  # of the archfrag that wrote the export
    cube_commit: str  # of the archfrag that made the cube
    cube_sha256: str

    @property
    def facts(self) -> dict[str, str]:
        """For formats that have a place for names and values."""
        return {
            "study": self.study,
            "title": self.title,
            "archfrag": self.version,
            "archfrag_commit": self.commit,
            "cube_archfrag_commit": self.cube_commit,
            "cube_sha256": self.cube_sha256,
        }

    @property
    def text(self) -> str:
        """For formats that have a place for text; without characters that XML forbids."""
        title = "".join(c if c.isprintable() else " " for c in self.title).rstrip(".")
        return (
            f"{title}. Study {self.study}, exported by archfrag {self.version} (commit "
            f"{self.commit}) from the cube with SHA-256 {self.cube_sha256} (commit "
            f"{self.cube_commit})."
        )


@dataclass(frozen=True)
class CurveSet:
    """Lognormal curves of several arches, each at the same ordered limit states."""

    # By arch and limit state, from the mildest to the severest, theta in the SI unit of the
    # measure; a message where there is no curve.
    curves: Mapping[str, Mapping[str, Fragility | str]]
    measure: str  # intensity measure, as `archfrag.motions.measures.parse_measure` reads it
    levels: tuple[float, float]  # lowest and highest intensity that was simulated [SI]
    made: Made

    def __post_init__(self) -> None:
        if not self.curves:
            raise InputError("there is no arch to export")
        first = self.limit_states
        if not first:
            raise InputError("there is no limit state to export")
        for name in first:
            if not _NAME.fullmatch(name):
                raise InputError(
                    f"limit state {name!r}: a name has 1 to 75 letters, digits, _ or - only"
                )
        for arch, states in self.curves.items():
            if tuple(states) != first:
                raise InputError(
                    f"arch {arch!r} has the limit states {', '.join(states)}, not "
                    f"{', '.join(first)} as the first arch"
                )
            for mild, severe in pairwise(self._found(arch)):
                if states[mild].theta > states[severe].theta:  # type: ignore[union-attr]
                    raise InputError(
                        f"arch {arch!r}: limit state {severe!r} has a lower median than "
                        f"{mild!r}; limit states go from the mildest to the severest"
                    )

    @property
    def limit_states(self) -> tuple[str, ...]:
        """Names from the mildest to the severest."""
        return tuple(next(iter(self.curves.values())))

    def severest(self, count: int) -> "CurveSet":
        """The same with no more than so many limit states, the severest."""
        kept = self.limit_states[-count:]
        curves = {arch: {k: states[k] for k in kept} for arch, states in self.curves.items()}
        return replace(self, curves=curves)

    @property
    def complete(self) -> dict[str, dict[str, Fragility]]:
        """Arches that have a curve at every limit state."""
        return {
            arch: found
            for arch, states in self.curves.items()
            if len(found := {s: f for s, f in states.items() if isinstance(f, Fragility)})
            == len(states)
        }

    @property
    def left_out(self) -> dict[str, str]:
        """By arch, why it lacks a curve."""
        return {
            arch: "; ".join(
                f"{state}: {found}" for state, found in states.items() if isinstance(found, str)
            )
            for arch, states in self.curves.items()
            if arch not in self.complete
        }

    @property
    def cautions(self) -> list[str]:
        """Where the curve of a severer limit state lies above that of a milder one."""
        return [message for arch in self.curves for message in self._crossings(arch)]

    def require_curves(self, receiver: str) -> dict[str, dict[str, Fragility]]:
        """`complete`, for a format that holds nothing but curves."""
        if not self.complete:
            reasons = "; ".join(f"{arch}: {why}" for arch, why in self.left_out.items())
            raise FitError(f"there is no curve to export for {receiver}: {reasons}")
        return self.complete

    def _found(self, arch: str) -> list[str]:
        return [s for s, f in self.curves[arch].items() if isinstance(f, Fragility)]

    def _crossings(self, arch: str) -> Iterator[str]:
        for mild, severe in pairwise(self._found(arch)):
            one, other = self.curves[arch][mild], self.curves[arch][severe]
            assert isinstance(one, Fragility)
            assert isinstance(other, Fragility)
            ends = [
                each.theta * np.exp(sign * 4.0 * each.beta)
                for each in (one, other)
                for sign in (-1, 1)
            ]
            im = np.geomspace(min(ends), max(ends), 400)
            above = other.probability(im) - one.probability(im)
            if above.max() > _NOTED:
                yield (
                    f"arch {arch!r}: the curve of {severe!r} lies above that of {mild!r} by up "
                    f"to {above.max():.2g}; their difference is no probability there"
                )
