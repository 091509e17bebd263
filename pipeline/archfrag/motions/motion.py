"""One ground motion: what the ground does to the springings of an arch."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from archfrag.errors import InputError, RecordError


@dataclass(frozen=True, eq=False)
class Motion:
    """Ground acceleration in one horizontal direction, with the vertical where there is one.

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
        What is known of the record: event, station, magnitude, file; JSON types only where the
        motion is to be stored.
    log : tuple of str
        A line for each thing done to the samples since they left the file.
    across : array_like, shape (n_sample,) [m/s2], optional
        The other horizontal component, perpendicular to the first: measured, never simulated.

    Raises
    ------
    RecordError
        If a sample is not finite, the samples are not one row of at least two, `dt` is not
        positive, or another component has another length.

    Examples
    --------
    >>> import numpy as np, archfrag as af
    >>> motion = af.Motion(np.sin(np.arange(100) / 10.0), dt=0.01, id="sine")
    >>> float(round(motion.duration, 2)), motion.scaled(2.0).log
    (0.99, ('Multiplied by 2.',))
    """

    acceleration: NDArray[np.float64]
    dt: float
    vertical: NDArray[np.float64] | None = None
    id: str = ""
    metadata: Mapping[str, Any] = field(default_factory=dict)
    log: tuple[str, ...] = ()
    across: NDArray[np.float64] | None = None

    def __init__(
        self,
        acceleration: ArrayLike,
        dt: float,
        vertical: ArrayLike | None = None,
        id: str = "",
        metadata: Mapping[str, Any] | None = None,
        log: tuple[str, ...] = (),
        across: ArrayLike | None = None,
    ) -> None:
        given = (acceleration, vertical, across)
        try:
            copies = [None if a is None else np.array(a, dtype=np.float64) for a in given]
        except (TypeError, ValueError):
            raise RecordError(f"{id or 'motion'}: acceleration must be a row of numbers") from None
        self._take(copies[0], dt, copies[1], id, metadata, log, copies[2])

    def _take(
        self, acceleration: Any, dt: float, vertical: Any = None, id: str = "",
        metadata: Mapping[str, Any] | None = None, log: tuple[str, ...] = (), across: Any = None,
    ) -> None:  # fmt: skip
        """Set all fields; components are taken as they are, without a copy."""
        name, size = id or "motion", np.size(acceleration)
        try:
            step = float(dt)
        except (TypeError, ValueError):
            step = np.nan
        if not (np.isfinite(step) and step > 0.0):
            needed = "must be a positive number of seconds"
            raise RecordError(f"{name}: time step dt = {dt} s {needed}")
        words = ("acceleration", "vertical", "other horizontal component")
        for word, samples in zip(words, (acceleration, vertical, across)):
            if samples is not None:
                _check_samples(samples, name, word, size)
        fields = (acceleration, step, vertical, id, dict(metadata or {}), tuple(log), across)
        for key, value in zip(self.__dataclass_fields__, fields, strict=True):
            object.__setattr__(self, key, value)

    def _replaced(self, **changes: Any) -> "Motion":
        """This motion with other fields; unlike `dataclasses.replace` it copies no samples.

        Arrays must be of float64 and are not to be changed afterwards.
        """
        return Motion._owning(
            **({key: getattr(self, key) for key in self.__dataclass_fields__} | changes)
        )

    @classmethod
    def _owning(cls, *fields: Any, **named: Any) -> "Motion":
        """A motion of arrays that nobody changes afterwards: no copy is made of them."""
        motion = object.__new__(cls)
        motion._take(*fields, **named)
        return motion

    def _changed(
        self, change: Callable[[NDArray[np.float64]], NDArray[np.float64]], done: str
    ) -> "Motion":
        """This motion with the same done to each component, and a line about it in the log."""
        changed = {
            key: samples if samples is None else change(samples)
            for key, samples in self.components.items()
        }
        return self._replaced(**changed, log=(*self.log, done))

    @property
    def components(self) -> dict[str, NDArray[np.float64] | None]:
        """Acceleration, vertical and across by name; None where there is none."""
        return {key: getattr(self, key) for key in ("acceleration", "vertical", "across")}

    @property
    def duration(self) -> float:
        """Time from the first sample to the last [s]."""
        return (self.acceleration.size - 1) * self.dt

    @property
    def time(self) -> NDArray[np.float64]:
        """Time of each sample from the first, shape (n_sample,) [s]."""
        return np.arange(self.acceleration.size, dtype=np.float64) * np.float64(self.dt)

    def scaled(self, factor: float) -> "Motion":
        """Return the motion with all components multiplied by `factor`.

        Raises
        ------
        InputError
            If the factor is not a finite number.
        """
        if not np.isfinite(factor):
            name = self.id or "motion"
            raise InputError(f"{name}: scale factor {factor} must be a finite number")
        return self._changed(lambda samples: samples * factor, f"Multiplied by {factor:.9g}.")


def _check_samples(samples: NDArray[np.float64], name: str, component: str, size: int) -> None:
    bad = np.flatnonzero(~np.isfinite(samples)) if samples.ndim == 1 else np.empty(0, int)
    first = f"{bad[0]} ({samples[bad[0]]})" if bad.size else ""
    for wrong, what in (
        (samples.ndim != 1, f"has shape {samples.shape}; one row of samples is needed"),
        (samples.size < 2, f"has {samples.size} sample(s); at least 2 are needed"),
        (bad.size, f"has {bad.size} sample(s) that are not finite, the first at index {first}"),
        (samples.size != size, f"has {samples.size} samples and the horizontal {size}; both must "
                               "have the same number"),
    ):  # fmt: skip
        if wrong:
            raise RecordError(f"{name}: {component} {what}")
