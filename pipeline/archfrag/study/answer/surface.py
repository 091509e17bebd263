"""P(collapse | movement of a springing, intensity), from arches that differ in this movement."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.special import ndtr

from archfrag.errors import FitError, InputError
from archfrag.fragility.curve import Curve, FloatArray, log_intensity
from archfrag.simulation.springings import springing_path
from archfrag.study.answer.curves import Fitted
from archfrag.study.answer.fits import in_unit
from archfrag.study.file.arches import ArchEntry, Springings
from archfrag.study.file.members import Member
from archfrag.study.file.schema import StudyKeys

_NONE = Springings.model_validate({})


@dataclass(frozen=True, repr=False, eq=False)
class Surface:
    """Probability of collapse against the movement of a springing and an intensity.

    At the movement of an arch it is the curve of this arch, with its band. Between two arches ln
    theta and beta are linear in the movement. Nothing is fitted across arches, and the surface
    need not rise with the movement.
    """

    movement: str  #: spread, settlement or rotation
    movements: FloatArray  #: (n,), rising
    curves: tuple[Curve, ...]  #: of the arches, in the unit of the study
    #: Movements at which the arch falls without an earthquake, negative and positive, as far as
    #: arches have moved there; +-inf if it does not fall.
    border: tuple[float, ...]

    @property
    def label(self) -> str:
        """Movement with its unit."""
        return f"{self.movement} [{'degrees' if self.movement == 'rotation' else 'm'}]"

    def at(self, movement: ArrayLike, im: ArrayLike) -> FloatArray:
        """Return the probability at pairs of values; nan outside the movements of the arches."""
        fits = [(np.log(each.theta), each.beta) for each in self.curves]
        log_theta, beta = (
            np.interp(np.asarray(movement), self.movements, each, np.nan, np.nan)
            for each in zip(*fits)
        )
        return np.asarray(ndtr((log_intensity(im) - log_theta) / beta))

    def contours(self, probabilities: Sequence[float]) -> pd.DataFrame:
        """Return the intensities with some probabilities, (n_arch, n), by the arches' movement.

        ``contours([0.05, 0.5, 0.95]).plot()`` draws them.
        """
        rows = [each.quantile(probabilities) for each in self.curves]
        index = pd.Index(self.movements, name=self.label)
        return pd.DataFrame(rows, index, list(probabilities))

    def to_dataframe(self, im: ArrayLike | None = None) -> pd.DataFrame:
        """Tabulate the curve of each arch with its band; `im`, (n,), are the study's levels."""
        tables = [each.to_dataframe(im) for each in self.curves]
        movement = np.repeat(self.movements, len(tables[0]))
        table = pd.concat(tables, ignore_index=True)
        table.insert(0, self.label, movement)
        return table


def surface_of(study: StudyKeys, fitted: Fitted, name: str | None = None) -> Surface:
    """Return the surface of a class of arches, or of all arches of a study.

    InputError unless the arches differ in one movement of one springing only, FitError if one of
    them has no curve.
    """
    members = [each for each in study.members if name in (None, each.arch_class)]
    for key in ("spread", "settlement", "rotation"):
        at = np.array(
            [getattr(each.entry.springings or _NONE, key) for each in members]
        )
        if np.unique(at).size == at.size > 1 and _only(members, key):
            break
    else:
        raise InputError(
            f"surface: the arches of {name or 'the study'} must differ in one movement of one "
            "springing (spread, settlement or rotation) and in nothing else, each in another value"
        )
    order = np.argsort(at)
    curves = [in_unit(fitted.arches[members[i].id], study.intensity) for i in order]
    for curve in curves:
        if not curve.fitted:
            raise FitError(f"surface: {curve.name} has no curve: {curve.reason}")
    signs = np.unique(np.sign(at[at != 0.0]))
    border = [falls_at(members[0].entry, key, sign) for sign in signs.tolist()]
    return Surface(key, at[order], tuple(curves), tuple(border))


def _only(members: Sequence[Member], movement: str) -> bool:
    """Tell whether arches differ in a movement of one springing and in nothing else."""
    kinds = set()
    for each in members:
        still = (each.entry.springings or _NONE).model_copy(update={movement: 0.0})
        plain = {"id": "arch", "vary": None, "springings": still}
        kinds.add((repr(each.entry.model_copy(update=plain)), each.shock, still.moves))
    return len(kinds) == 1 and not kinds.pop()[-1]


def surfaces_of(study: StudyKeys, fitted: Fitted) -> dict[str, Surface]:
    """Return the surface of each class of arches that has one, by its name."""
    found = dict[str, Surface]()
    for name in () if "table_sha256" in fitted.cube.attrs else fitted.classes:
        with suppress(InputError, FitError):
            found[name] = surface_of(study, fitted, name)
    return found


@lru_cache(maxsize=16)
def falls_at(entry: ArchEntry, movement: str, sign: float) -> float:
    """Return the movement at which an arch falls without an earthquake, before it has its ties.

    Where the springings of `entry` have moved does not count. `sign` is 1 or -1, the direction;
    the result is +-inf if it does not fall.
    """
    arch = entry.model_copy(update={"springings": None, "ties": None}).build()
    most = sign * (45.0 if movement == "rotation" else arch.extent.max())
    base = (entry.springings or _NONE).springing
    path = springing_path(arch, springing=base, **{movement: most})
    return float(path.limit * most)
