"""One ground motion: what the ground does to the springings of an arch."""

from collections.abc import Mapping
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
        copies = [
            None if samples is None else np.array(_numbers(samples, id, word), dtype=np.float64)
            for samples, word in ((acceleration, "acceleration"), (vertical, "vertical"),
                                  (across, "other horizontal component"))
        ]  # fmt: skip
        self._take(dt, id, dict(metadata or {}), tuple(log), *copies)

    def _take(
        self, dt: float, id: str, metadata: Mapping[str, Any], log: tuple[str, ...],
        *components: NDArray[np.float64] | None,
    ) -> None:  # fmt: skip
        """Set all fields; components are taken as they are, without a copy."""
        name = id or "motion"
        acceleration, vertical, across = components
        set_field = object.__setattr__
        set_field(self, "id", id)
        set_field(self, "dt", _positive_step(dt, name))
        for key, word, samples in (
            ("acceleration", "acceleration", acceleration),
            ("vertical", "vertical", vertical),
            ("across", "other horizontal component", across),
        ):
            if samples is not None:
                _check_samples(samples, name, word)
                if acceleration is not None and samples.size != acceleration.size:
                    raise RecordError(
                        f"{name}: the {word} has {samples.size} samples and the horizontal "
                        f"{acceleration.size}; both must have the same number"
                    )
            set_field(self, key, samples)
        set_field(self, "metadata", metadata)
        set_field(self, "log", log)

    def _replaced(self, **changes: Any) -> "Motion":
        """This motion with other fields; unlike `dataclasses.replace` it copies no samples.

        Arrays must be of float64 and are not to be changed afterwards.
        """
        given = {key: getattr(self, key) for key in self.__dataclass_fields__} | changes
        return Motion._owning(**given)

    @classmethod
    def _owning(
        cls,
        acceleration: NDArray[np.float64],
        dt: float,
        vertical: NDArray[np.float64] | None = None,
        id: str = "",
        metadata: Mapping[str, Any] | None = None,
        log: tuple[str, ...] = (),
        across: NDArray[np.float64] | None = None,
    ) -> "Motion":
        """A motion of arrays that nobody changes afterwards: no copy is made of them."""
        motion = object.__new__(cls)
        motion._take(dt, id, dict(metadata or {}), tuple(log), acceleration, vertical, across)
        return motion

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
            raise InputError(
                f"{self.id or 'motion'}: scale factor {factor} must be a finite number"
            )
        return self._replaced(
            acceleration=self.acceleration * factor,
            vertical=None if self.vertical is None else self.vertical * factor,
            across=None if self.across is None else self.across * factor,
            log=(*self.log, f"Multiplied by {factor:.9g}."),
        )


def _positive_step(dt: float, name: str) -> float:
    try:
        step = float(dt)
    except (TypeError, ValueError):
        step = float("nan")
    if not (np.isfinite(step) and step > 0.0):
        raise RecordError(f"{name}: time step dt = {dt} s must be a positive number of seconds")
    return step


def _numbers(values: ArrayLike, id: str, component: str) -> NDArray[np.float64]:
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise RecordError(f"{id or 'motion'}: {component} must be a row of numbers") from None


def _check_samples(samples: NDArray[np.float64], name: str, component: str) -> None:
    if samples.ndim != 1:
        raise RecordError(
            f"{name}: {component} has shape {samples.shape}; one row of samples is needed"
        )
    if samples.size < 2:
        raise RecordError(
            f"{name}: {component} has {samples.size} sample(s); at least 2 are needed"
        )
    if np.isfinite(samples.min()) and np.isfinite(samples.max()):
        return
    bad = np.flatnonzero(~np.isfinite(samples))
    raise RecordError(
        f"{name}: {component} has {bad.size} sample(s) that are not finite, the first at "
        f"index {bad[0]} ({samples[bad[0]]})"
    )
