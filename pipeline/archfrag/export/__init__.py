"""Curves and runs of a study in the formats of other programs.

NRML 0.5 for OpenQuake, a damage database for pelicun, a DFR3 set for IN-CORE, and CSV or Parquet
tables. Units are those that the receiver expects and are named in each file. Here is what all
formats have in common: the curves of several arches and limit states, and how they were made.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

from archfrag.errors import FitError
from archfrag.fragility.curve import Fragility


@dataclass(frozen=True)
class Made:
    """How an export was made; the same for the same cube and code, so that files are too."""

    study: str
    title: str
    archfrag: str  # version that wrote the export
    archfrag_commit: str  # and its commit
    cube_archfrag_commit: str  # of the archfrag that made the cube
    cube_sha256: str

    @property
    def text(self) -> str:
        """For formats that have a place for text; without characters that XML forbids."""
        title = "".join(c if c.isprintable() else " " for c in self.title).rstrip(".")
        return (
            f"{title}. Study {self.study}, exported by archfrag {self.archfrag} (commit "
            f"{self.archfrag_commit}) from the cube with SHA-256 {self.cube_sha256} (commit "
            f"{self.cube_archfrag_commit})."
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
    classes: Mapping[str, int] = field(default_factory=dict)  # of those, number of arches

    def described(self, name: str) -> str:
        """What a curve is of."""
        if name not in self.classes:
            return f"Masonry arch {name}"
        return (
            f"Class {name} of {self.classes[name]} masonry arches, each as likely as another; "
            "median and dispersion are those of ln capacity over the class"
        )

    @property
    def limit_states(self) -> tuple[str, ...]:
        """Names from the mildest to the severest."""
        return tuple(next(iter(self.curves.values())))

    @property
    def complete(self) -> dict[str, dict[str, Fragility]]:
        """Arches that have a curve at every limit state."""
        known = {
            arch: {state: fit for state, fit in states.items() if isinstance(fit, Fragility)}
            for arch, states in self.curves.items()
        }
        return {arch: fits for arch, fits in known.items() if len(fits) == len(self.limit_states)}

    @property
    def left_out(self) -> dict[str, str]:
        """By arch, why it lacks a curve of collapse, or else of a limit state."""
        why: dict[str, str] = {}
        for arch, states in self.curves.items():
            reasons = {name: found for name, found in states.items() if isinstance(found, str)}
            if reasons:
                each = "; ".join(f"{name}: {found}" for name, found in reasons.items())
                why[arch] = reasons.get(self.limit_states[-1], each)
        return why

    def require_curves(self, receiver: str) -> dict[str, dict[str, Fragility]]:
        """`complete`, for a format that holds nothing but curves."""
        if not self.complete:
            reasons = "; ".join(f"{arch}: {why}" for arch, why in self.left_out.items())
            raise FitError(f"there is no curve to export for {receiver}: {reasons}")
        return self.complete
