"""One ground motion, the units it may be given in, and motions in a file."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from archfrag.errors import InputError, RecordError
from archfrag.files import replacing

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_FORMAT = "archfrag motions 1"
STANDARD_GRAVITY = 9.80665  # [m/s2]
METRES_PER_SECOND_SQUARED = {
    "m/s2": 1.0, "cm/s2": 1e-2, "gal": 1e-2, "mm/s2": 1e-3, "g": STANDARD_GRAVITY,
}  # fmt: skip


def unit_factor(unit: str, place: str) -> float:
    """Return the factor from a unit of acceleration to m/s2."""
    if unit not in METRES_PER_SECOND_SQUARED:
        allowed = f"allowed are {', '.join(METRES_PER_SECOND_SQUARED)}"
        raise RecordError(f"{place}: unknown unit {unit!r} of acceleration; {allowed}")
    return METRES_PER_SECOND_SQUARED[unit]


@dataclass(frozen=True, eq=False, repr=False)
class Motion:
    """Ground acceleration in one horizontal direction, with the vertical if there is one.

    Parameters
    ----------
    acceleration : array_like, shape (n_sample,) [m/s2]
        Horizontal acceleration of the ground, positive towards +x, linear between samples.
    dt : float [s]
        Time between samples.
    vertical : array_like, shape (n_sample,) [m/s2], optional
        Vertical acceleration of the ground, positive upwards.
    id : str
        Name of the record, used in tables and messages.
    metadata : mapping
        What is known of the record: event, station, magnitude, file.
    log : tuple of str
        A line for each thing done to the samples since they left the file.
    transverse : array_like, shape (n_sample,) [m/s2], optional
        The other horizontal component, perpendicular to the first: measured, never simulated.

    Raises
    ------
    RecordError
        If `dt` or samples are not such numbers.

    Examples
    --------
    >>> import numpy as np, archfrag as af
    >>> motion = af.Motion(np.sin(np.arange(100) / 10.0), dt=0.01, id="sine")
    >>> motion
    <Motion sine: PGA 0.102 g, 0.99 s at 0.01 s, horizontal>
    >>> (2 * motion).log, round((2 * motion).pga, 3), motion.spectrum([0.1, 0.5]).round(3).tolist()
    (('Multiplied by 2.',), 2.0, [1.107, 3.457])
    """

    acceleration: NDArray[np.float64]
    dt: float
    vertical: NDArray[np.float64] | None = None
    id: str = ""
    metadata: Mapping[str, Any] = field(default_factory=dict)
    log: tuple[str, ...] = ()
    transverse: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        name, given = self.id or "motion", self.components
        for key, samples in given.items():
            kinds = {
                "complex": np.iscomplexobj(np.asanyarray(samples)),
                "masked": np.ma.is_masked(samples),
            }
            if kind := next((kind for kind, found in kinds.items() if found), None):
                raise RecordError(f"{name}: {key} has {kind} samples; all must be real numbers")
        try:
            arrays = {key: np.array(samples, dtype=np.float64)
                      for key, samples in given.items() if samples is not None}  # fmt: skip
            step = float(self.dt)
        except (TypeError, ValueError):
            raise RecordError(f"{name}: dt and samples of acceleration must be numbers") from None
        if not 0.0 < step < np.inf:
            raise RecordError(f"{name}: time step dt = {step} s must be a positive number")
        for key, samples in arrays.items():
            size = max(2, np.size(self.acceleration))
            if samples.shape != (size,):
                raise RecordError(f"{name}: {key} must be a row of {size}, not {samples.shape}")
            if (bad := np.flatnonzero(~np.isfinite(samples))).size:
                raise RecordError(f"{name}: {key} is not finite, the first time at index {bad[0]}")
        about = {"dt": step, "metadata": dict(self.metadata or {}), "log": tuple(self.log)}
        for key, value in (arrays | about).items():
            object.__setattr__(self, key, value)

    def _replaced(self, **changes: Any) -> Motion:
        """Return this motion with other fields."""
        return replace(self, **changes)

    def _changed(
        self, change: Callable[[NDArray[np.float64]], NDArray[np.float64]], done: str
    ) -> Motion:
        """Do the same to each component, and add a line about it to the log."""
        changed = {key: None if samples is None else change(samples)
                   for key, samples in self.components.items()}  # fmt: skip
        return self._replaced(**changed, log=(*self.log, done))

    @property
    def components(self) -> dict[str, NDArray[np.float64] | None]:
        """Acceleration, vertical and transverse by name; None for one that is missing."""
        return {key: getattr(self, key) for key in ("acceleration", "vertical", "transverse")}

    @property
    def duration(self) -> float:
        """Time from the first sample to the last [s]."""
        return (self.acceleration.size - 1) * self.dt

    @property
    def time(self) -> NDArray[np.float64]:
        """Time of each sample from the first, shape (n_sample,) [s]."""
        return np.arange(self.acceleration.size, dtype=np.float64) * np.float64(self.dt)

    def scaled(self, factor: float) -> Motion:
        """Return the motion with all components multiplied by `factor`, a finite number."""
        if not np.isfinite(factor):
            name = self.id or "motion"
            raise InputError(f"{name}: scale factor {factor} must be a finite number")
        return self._changed(lambda samples: samples * factor, f"Multiplied by {factor:.9g}.")

    def __mul__(self, factor: float) -> Motion:
        if not isinstance(factor, float | int | np.number):
            return NotImplemented
        return self.scaled(float(factor))

    __rmul__ = __mul__

    @property
    def pga(self) -> float:
        """Peak of the horizontal acceleration [m/s2]."""
        return float(np.abs(self.acceleration).max())

    def spectrum(self, periods: ArrayLike) -> NDArray[np.float64]:
        """Pseudo-spectral acceleration at some periods [s], 5 % damping, (n_period,) [m/s2]."""
        from archfrag.motions.measures import spectral_acceleration

        return spectral_acceleration(self, periods)

    def measures(self, *names: str) -> dict[str, float]:
        """Intensity measures by name, in SI units.

        Those asked for, such as "PGV", "Sa(0.5)" and "AvgSA(0.2,1)"; without names all that need
        no period: PGA [m/s2], PGV, Arias, CAV and CAVstd [m/s], PGD and HI [m], D5_95 [s].
        """
        from archfrag.motions.measures import PLAIN, measure

        return {name: measure(self, name) for name in names or PLAIN}

    @classmethod
    def from_obspy(
        cls, stream: Any, unit: str = "m/s2", component: str | None = None,
        accept: Sequence[str] = (),
    ) -> Motion:  # fmt: skip
        """Take one horizontal component of an obspy Stream, and the vertical if it has one.

        Parameters
        ----------
        stream : obspy.Stream or obspy.Trace
            Of one record, each channel in one piece. It stays as it is.
        unit : str
            Of its samples: m/s2, cm/s2, gal, mm/s2 or g. They are never counts.
        component, accept
            As of `archfrag.read_motion`.
        """
        from archfrag.motions.read import motion_of_stream

        return motion_of_stream(stream, unit, component, accept)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the acceleration over time [g], in `ax` or in new axes."""
        from archfrag.plots import plot_motion

        return plot_motion(self, ax)

    def __repr__(self) -> str:
        parts = [key.replace("acceleration", "horizontal")
                 for key, samples in self.components.items() if samples is not None]  # fmt: skip
        peak = f"PGA {self.pga / STANDARD_GRAVITY:.3g} g"
        size = f"{self.duration:g} s at {self.dt:g} s"
        return f"<Motion {self.id or '(no id)'}: {peak}, {size}, {' and '.join(parts)}>"

    def _repr_html_(self) -> str:
        from archfrag.plots import html_of

        return html_of(self, (6.4, 2.2))


def save_motions(path: str | Path, motions: Sequence[Motion]) -> None:
    """Write motions to one numpy archive, complete or not at all; equal motions, equal bytes."""
    names = ("id", "dt", "log", "metadata")
    try:
        table = [json.dumps({name: getattr(motion, name) for name in names}, sort_keys=True)
                 for motion in motions]  # fmt: skip
    except (TypeError, ValueError) as error:
        ids = ", ".join(motion.id for motion in motions)
        raise InputError(f"{ids}: metadata cannot be stored as JSON ({error})") from None
    arrays: dict[str, NDArray] = {}
    for number, motion in enumerate(motions):
        arrays[f"horizontal_{number}"] = motion.acceleration
        if motion.vertical is not None:
            arrays[f"vertical_{number}"] = motion.vertical
    text = json.dumps({"format": _FORMAT, "motions": table})
    arrays["table"] = np.frombuffer(text.encode(), dtype=np.uint8)
    with replacing(Path(path), lasting=False) as part, open(part, "wb") as file:
        np.savez(file, allow_pickle=False, **arrays)  # type: ignore[arg-type]


def load_motions(path: str | Path) -> list[Motion]:
    """Read the motions that `save_motions` wrote; InputError if the file is something else."""
    try:
        with np.load(path, allow_pickle=False) as archive:
            header = json.loads(archive["table"].tobytes().decode())
            if header["format"] != _FORMAT:
                raise ValueError(f"format {header['format']!r}")
            return [
                Motion(archive[f"horizontal_{number}"], vertical=archive.get(f"vertical_{number}"),
                       **json.loads(entry))
                for number, entry in enumerate(header["motions"])
            ]  # fmt: skip
    except (OSError, ValueError, KeyError, TypeError, zipfile.BadZipFile) as error:
        what = "not a file of motions written by archfrag, or damaged"
        raise InputError(f"{path}: {what} ({error})") from None
