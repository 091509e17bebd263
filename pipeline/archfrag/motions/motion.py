"""One ground motion: made of arrays or of channels, stored in a file, read back."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from archfrag.errors import InputError, RecordError
from archfrag.files import replacing
from archfrag.motions import calibrate
from archfrag.motions.channel import (
    STANDARD_GRAVITY,
    Channel,
    Trace,
    choose_horizontal,
    filled,
    instrument,
    unit_factor,
)
from archfrag.motions.measures import PLAIN, measure, spectral_acceleration

if TYPE_CHECKING:
    from matplotlib.axes import Axes

REVERSED = "-rev"  # ends the id of a motion whose horizontal components are reversed
_FORMAT = "archfrag motions 1"


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
        name = self.id or "motion"
        components = self.components
        try:
            for key, samples in components.items():
                masked = np.ma.is_masked(samples)
                if masked or np.asanyarray(samples).dtype.kind == "c":
                    what = f"{key} has {'masked' if masked else 'complex'} samples"
                    raise RecordError(f"{name}: {what}; all must be real numbers")
            arrays = {
                key: np.array(samples, dtype=np.float64)
                for key, samples in components.items()
                if samples is not None
            }
            step = float(self.dt)
        except (TypeError, ValueError):
            raise RecordError(
                f"{name}: dt and samples of acceleration must be numbers"
            ) from None
        if not 0.0 < step < np.inf:
            raise RecordError(
                f"{name}: time step dt = {step} s must be a positive number"
            )
        for key, samples in arrays.items():
            size = max(2, np.size(self.acceleration))
            if samples.shape != (size,):
                raise RecordError(
                    f"{name}: {key} must be a row of {size}, not {samples.shape}"
                )
            if (bad := np.flatnonzero(~np.isfinite(samples))).size:
                raise RecordError(
                    f"{name}: {key} is not finite, the first time at index {bad[0]}"
                )
        about = {
            "dt": step,
            "metadata": dict(self.metadata or {}),
            "log": tuple(self.log),
        }
        for key, value in (arrays | about).items():
            object.__setattr__(self, key, value)

    def changed(
        self,
        change: Callable[[NDArray[np.float64]], NDArray[np.float64]],
        done: str,
        **fields: Any,
    ) -> Motion:
        """Return the motion with each component changed, and a line about it in the log."""
        changed: dict[str, Any] = {
            key: None if samples is None else change(samples)
            for key, samples in self.components.items()
        }
        return replace(self, **changed, log=(*self.log, done), **fields)

    @property
    def components(self) -> dict[str, NDArray[np.float64] | None]:
        """Acceleration, vertical and transverse by name; None if a component is missing."""
        return {
            key: getattr(self, key)
            for key in ("acceleration", "vertical", "transverse")
        }

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
        return self.changed(
            lambda samples: samples * factor, f"Multiplied by {factor:.9g}."
        )

    def then(self, second: Motion, gap: float = 20.0) -> Motion:
        """Return one motion: this one, `gap` >= 0 [s] for an arch to come to rest, and another.

        Its time step is the smaller one; samples at the other one are interpolated linearly, as in
        a simulation. ``metadata["begins"]`` tells when the second motion begins [s].
        InputError if `gap` is negative.

        Examples
        --------
        >>> import numpy as np, archfrag as af
        >>> first, second = (af.Motion(np.ones(6), dt, id=f"by{dt}") for dt in (0.02, 0.01))
        >>> both = first.then(second, gap=0.1)
        >>> both, both.metadata["begins"]
        (<Motion by0.02+by0.01: PGA 0.102 g, 0.26 s at 0.01 s, horizontal>, 0.21)
        """
        if not 0.0 <= gap < np.inf:
            raise InputError(f"gap = {gap} s must be a time from 0 upwards")
        step = min(self.dt, second.dt)
        both = (self, second)
        waves = dict[str, Any]()
        times = [
            np.arange(int(each.duration / step + 1e-6) + 1) * step for each in both
        ]
        rest = np.zeros(round(gap / step))
        for key in self.components:
            parts = [each.components[key] for each in both]
            if any(part is not None for part in parts):
                one, two = (
                    0.0 * time if part is None else np.interp(time, each.time, part)
                    for time, each, part in zip(times, both, parts)
                )
                waves[key] = np.concatenate([one, rest, two])
        about = {**second.metadata, "begins": (times[0].size + rest.size) * step}
        log = (*second.log, f"Put {gap:g} s after {self.id}.")
        return Motion(
            **waves, dt=step, id=f"{self.id}+{second.id}", metadata=about, log=log
        )

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
        """Return Sa at `periods` [s], 5 % damping, shape (n_period,) [m/s2]."""
        return spectral_acceleration(self, periods)

    def measures(self, *names: str) -> dict[str, float]:
        """Return intensity measures by name, in SI units, such as "PGV" and "Sa(0.5)".

        Without names, all that need no period: PGA [m/s2], PGV, Arias, CAV and CAVstd [m/s], PGD
        and HI [m], D5_95 [s].
        """
        return {name: measure(self, name) for name in names or PLAIN}

    @classmethod
    def from_obspy(
        cls,
        stream: Any,
        unit: str = "m/s2",
        component: str | None = None,
        accept: Sequence[str] = (),
    ) -> Motion:
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
        traces = [
            trace.copy() for trace in ([stream] if hasattr(stream, "stats") else stream)
        ]
        if not traces:
            raise RecordError("the stream has no trace")
        stats = traces[0].stats
        names = [trace.id for trace in traces]
        place = ".".join(filter(None, (stats.network, stats.station))) or "stream"
        if twice := next((name for name in names if names.count(name) > 1), None):
            raise RecordError(
                f"{twice}: has several pieces; join them by `stream.merge()`"
            )
        factor = unit_factor(unit, place)
        words = calibrate.accepted_words(accept, place)
        for trace in traces:
            count = len(trace.data)
            trace.stats._format = "obspy"
            trace.stats.record = channel = Channel(
                str(trace.stats.channel).strip(),
                announced=count,
                held=count,
                unit_in_file=unit,
                accept=words,
                log=[f"Converted to m/s2: unit {unit} as stated, factor {factor:g}."],
            )
            warnings = calibrate.impossible(trace)
            channel.accepted = calibrate.accept_or_refuse(place, words, warnings)
            trace.data = np.asarray(trace.data, dtype=np.float64) * factor
        chosen, verticals = choose_horizontal(traces, place, component)
        return motion_of_trace(chosen, Path(place), chosen.id, verticals)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the acceleration over time [g], in `ax` or in new axes."""
        from archfrag.plots import plot_motion  # start-up: matplotlib

        return plot_motion(self, ax)

    def __repr__(self) -> str:
        parts = [
            key.replace("acceleration", "horizontal")
            for key, samples in self.components.items()
            if samples is not None
        ]
        peak = f"PGA {self.pga / STANDARD_GRAVITY:.3g} g"
        size = f"{self.duration:g} s at {self.dt:g} s"
        return f"<Motion {self.id or '(no id)'}: {peak}, {size}, {' and '.join(parts)}>"

    def _repr_html_(self) -> str:
        from archfrag.plots import html_of

        return html_of(self, (6.4, 2.2))


def motion_of_trace(
    trace: Trace,
    path: Path,
    name: str,
    verticals: Iterable[Trace] = (),
    listed: Mapping[str, Any] | None = None,
) -> Motion:
    """Return the motion of a trace in m/s2, with the vertical of its instrument if that is there.

    `listed` are the facts of an index, which come before those of the header. RecordError if the
    samples are implausible, or the vertical does not fit.
    """
    stats = trace.stats
    channel = trace.stats.record
    implausible = calibrate.implausible(trace)
    accepted = channel.accepted + calibrate.accept_or_refuse(
        path, channel.accept, implausible
    )
    metadata: dict[str, Any] = {
        "file": path.name,
        "format": stats._format,
        "unit_in_file": channel.unit_in_file,
        "event": "",
        "date": "",
        "station": stats.station,
        **channel.facts,
        "component": channel.code,
        "vertical_component": "",
    }
    if stats.network or stats.station:
        metadata |= {"trace": trace.id, "vertical_trace": ""}
    if stats.starttime.timestamp != 0.0:
        metadata["start_time"] = str(stats.starttime)
    metadata |= filled(listed or {})
    remarks = {
        "errors": channel.errors,
        "cautions": channel.cautions,
        "accepted": accepted,
    }
    metadata |= {key: list(lines) for key, lines in remarks.items() if lines}
    kind = " ".join(filter(None, (stats._format, channel.level)))
    log = (f"Read from {path.name} ({kind}).", *channel.log, *accepted)
    motion = Motion(trace.data, float(stats.delta), None, name, metadata, log)
    for vertical in verticals:
        if instrument(vertical) == instrument(trace):
            other = motion_of_trace(vertical, path, name, listed=listed)
            try:
                return with_component(motion, other, "vertical")
            except RecordError as error:
                raise RecordError(f"{path}: {error}") from None
    return motion


def with_component(motion: Motion, other: Motion, kind: str) -> Motion:
    """Return a motion with its "vertical" or "transverse", cut to the time that both have.

    RecordError if they do not belong together or have no time in common.
    """
    one = motion.metadata
    two = other.metadata
    code = other.metadata.get("component", "")
    file = two.get("file") or other.id
    one_file = one.get("file") == two.get("file")
    if kind == "vertical":
        keys = ("component", "trace") if one_file else ("component", "trace", "file")
        labels = {f"vertical_{key}": two.get(key, "") for key in keys}
    else:
        facts = filled(
            {key: two.get(key) for key in ("component", "azimuth", "trace", "file")}
        )
        labels = {f"{key}_transverse": fact for key, fact in facts.items()}
        labels["id_transverse"] = other.id
    name = f"{motion.id} and {file} ({code})"
    for key in () if one_file else ("event", "date", "station"):
        first_is, second_is = (str(about.get(key) or "") for about in (one, two))
        if first_is and second_is and first_is.casefold() != second_is.casefold():
            differ = f"{key} is {first_is!r} and {second_is!r}"
            raise RecordError(f"{name} do not belong together: {differ}")
    if not np.isclose(motion.dt, other.dt, rtol=1e-6, atol=0.0):
        raise RecordError(
            f"{name}: time steps {motion.dt:g} s and {other.dt:g} s must be equal"
        )
    late = (seconds(two.get("start_time")) - seconds(one.get("start_time"))) / motion.dt
    later = 0 if np.isnan(late) else round(late)
    first = max(0, later)
    other_first = max(0, -later)
    count = min(motion.acceleration.size - first, other.acceleration.size - other_first)
    if count < 2:
        raise RecordError(f"{name} have no time in common")
    word = "Vertical" if kind == "vertical" else "Other horizontal"
    steps = (
        step if step in two.get("accepted", ()) else f"{word} {code}: {step}"
        for step in (other.log[1:] if one_file else other.log)
    )
    log = (*motion.log, *steps)
    if count < max(motion.acceleration.size, other.acceleration.size):
        log = (*log, f"Cut to the {count} samples in common with {file} ({code}).")
    kept = motion.changed(lambda samples: samples[first : first + count], "")
    part: dict[str, Any] = {kind: other.acceleration[other_first : other_first + count]}
    for key in ("errors", "cautions", "accepted"):
        if both := [*one.get(key, ()), *two.get(key, ())]:
            labels[key] = list(dict.fromkeys(both))
    return replace(kept, **part, metadata={**one, **labels}, log=log)


def seconds(time: Any) -> float:
    """Return the seconds of a time of UTC in ISO's form; nan if it is not known."""
    try:
        moment = datetime.fromisoformat(str(time))
    except ValueError:
        return float("nan")
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()


def store(path: Path, motion: Motion) -> None:
    """Write a motion to a numpy archive, complete or not at all; equal motions, equal bytes."""
    names = ("id", "dt", "log", "metadata")
    try:
        facts = json.dumps(
            {name: getattr(motion, name) for name in names}, sort_keys=True
        )
    except (TypeError, ValueError) as error:
        text = f"{motion.id}: metadata cannot be stored as JSON ({error})"
        raise InputError(text) from None
    table = json.dumps({"format": _FORMAT, "motions": [facts]}).encode()
    arrays = {"horizontal_0": motion.acceleration}
    if motion.vertical is not None:
        arrays["vertical_0"] = motion.vertical
    arrays["table"] = np.frombuffer(table, dtype=np.uint8)
    with replacing(path, lasting=False) as part, open(part, "wb") as file:
        np.savez(file, allow_pickle=False, **arrays)  # type: ignore[arg-type]


def load_stored(path: Path) -> Motion:
    """Read the motion that `store` wrote; InputError if the file is something else."""
    try:
        with np.load(path, allow_pickle=False) as archive:
            header = json.loads(archive["table"].tobytes().decode())
            if header["format"] != _FORMAT:
                raise ValueError(f"format {header['format']!r}")
            (facts,) = map(json.loads, header["motions"])
            return Motion(
                archive["horizontal_0"], vertical=archive.get("vertical_0"), **facts
            )
    except (OSError, ValueError, KeyError, TypeError, zipfile.BadZipFile) as error:
        what = "not a motion stored by archfrag, or damaged"
        raise InputError(f"{path}: {what} ({error})") from None


def record_start(motion: Motion) -> float:
    """Return when a record begins in its motion, later than 0 behind a first shock [s]."""
    return float(motion.metadata.get("begins", 0.0))
