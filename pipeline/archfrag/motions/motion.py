"""One ground motion: made of arrays or of channels, stored in a file, read back."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike

from archfrag.errors import InputError, RecordError
from archfrag.files import Named, replacing
from archfrag.motions import calibrate
from archfrag.motions.channel import (
    STANDARD_GRAVITY,
    Channel,
    Facts,
    Samples,
    choose_horizontal,
    filled,
    unit_factor,
)
from archfrag.motions.measures import PLAIN, measure, peak_of, spectral_acceleration

if TYPE_CHECKING:
    from matplotlib.axes import Axes

REVERSED = "-rev"  # ends the id of a motion whose horizontal components are reversed


_COMPONENTS = ("acceleration", "vertical", "transverse")


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
        What is known of the record: event, station, magnitude, file. As an attribute it is a
        mapping of what is known, and ``motion.facts`` has the same as attributes.
    log : tuple of str
        A line for each thing done to the samples since they left the file.
    transverse : array_like, shape (n_sample,) [m/s2], optional
        The other horizontal component, perpendicular to the first: measured, never simulated.
    record_start : float [s]
        When the record starts: later than 0 if a first shock precedes it.

    Raises
    ------
    RecordError
        If `dt` is not above 0, or samples are not finite real numbers, equally many.

    Examples
    --------
    >>> import numpy as np, archfrag as af
    >>> motion = af.Motion(np.sin(np.arange(100) / 10.0), dt=0.01, id="sine")
    >>> motion
    <Motion sine: PGA 0.102 g, 0.99 s at 0.01 s, horizontal>
    >>> (2 * motion).log, round((2 * motion).pga, 3), motion.spectrum([0.1, 0.5]).round(3).tolist()
    (('Multiplied by 2.',), 2.0, [1.107, 3.457])
    """

    acceleration: Samples
    dt: float
    vertical: Samples | None = None
    id: str = ""
    metadata: Mapping[str, Any] = Facts()
    log: tuple[str, ...] = ()
    transverse: Samples | None = None
    record_start: float = 0.0

    def __post_init__(self) -> None:
        name = self.id or "motion"
        fields: Named = {"log": tuple(self.log)}
        try:
            fields["dt"] = step = float(self.dt)
            for key, samples in self.components.items():
                if np.ma.is_masked(samples) or np.iscomplexobj(samples):
                    raise RecordError(
                        f"{name}: {key} has {'complex' if np.iscomplexobj(samples) else 'masked'} "
                        "samples; all must be real numbers"
                    )
                fields[key] = np.array(samples, float)
        except (TypeError, ValueError):
            raise RecordError(
                f"{name}: dt and samples of acceleration must be numbers"
            ) from None
        if not 0.0 < step < np.inf:
            raise RecordError(
                f"{name}: time step dt = {step} s must be a positive number"
            )
        size = max(2, np.size(self.acceleration))
        for key in self.components:
            if fields[key].shape != (size,):
                raise RecordError(
                    f"{name}: {key} must be a row of {size}, not {fields[key].shape}"
                )
            bad = np.flatnonzero(~np.isfinite(fields[key]))
            if bad.size:
                raise RecordError(
                    f"{name}: {key} is not finite, the first time at index {bad[0]}"
                )
        if not isinstance(self.metadata, Facts):
            fields["metadata"] = Facts.of(self.metadata or {})
        for key, value in fields.items():
            object.__setattr__(self, key, value)

    @property
    def facts(self) -> Facts:
        """What is known of the record, as attributes."""
        return cast(Facts, self.metadata)

    def stating(self, **facts) -> Motion:
        """Return the motion with these facts replaced."""
        return replace(self, metadata=replace(self.facts, **facts))

    def changed(
        self, change: Callable[[Samples], Samples], done: str, **fields
    ) -> Motion:
        """Return the motion with each component changed, and a line about it in the log."""
        fields |= {key: change(samples) for key, samples in self.components.items()}
        return replace(self, log=(*self.log, done), **fields)

    @property
    def components(self) -> dict[str, Samples]:
        """Samples of each component that there is, by its name in ``_COMPONENTS``."""
        every = {name: getattr(self, name) for name in _COMPONENTS}
        return {name: wave for name, wave in every.items() if wave is not None}

    @property
    def duration(self) -> float:
        """Time from the first sample to the last [s]."""
        return (self.acceleration.size - 1) * self.dt

    @property
    def time(self) -> Samples:
        """Time of each sample from the first, shape (n_sample,) [s]."""
        return np.arange(self.acceleration.size, dtype=float) * self.dt

    def scaled(self, factor: float) -> Motion:
        """Return the motion with all components multiplied by `factor`, a finite number."""
        if not np.isfinite(factor):
            name = self.id or "motion"
            raise InputError(f"{name}: scale factor {factor} must be a finite number")
        return self.changed(
            lambda samples: samples * factor, f"Multiplied by {factor:.9g}."
        )

    def then(self, second: Motion, gap: float = 20.0) -> Motion:
        """Return one motion: this one, a rest of `gap` [s], and then `second`.

        In the gap an arch may come to rest. The time step is the smaller of both; the motion with
        the larger step is interpolated linearly, as in a simulation. ``record_start`` is when
        `second` starts [s]. InputError unless `gap` is a finite number from 0 upwards.

        Examples
        --------
        >>> import numpy as np, archfrag as af
        >>> first, second = (af.Motion(np.ones(6), dt, id=f"by{dt}") for dt in (0.02, 0.01))
        >>> both = first.then(second, gap=0.1)
        >>> both, both.record_start
        (<Motion by0.02+by0.01: PGA 0.102 g, 0.26 s at 0.01 s, horizontal>, 0.21)
        """
        if not 0.0 <= gap < np.inf:
            raise InputError(f"gap = {gap} s must be a time from 0 upwards")
        step = min(self.dt, second.dt)
        ends = [int(each.duration / step + 1e-6) + 1 for each in (self, second)]
        rest = np.zeros(round(gap / step))
        waves: Named = {}
        for key in self.components | second.components:
            one, two = (
                np.interp(
                    step * np.arange(end),
                    each.time,
                    each.components.get(key, 0.0 * each.time),
                )
                for end, each in zip(ends, (self, second))
            )
            waves[key] = np.concatenate([one, rest, two])
        return replace(
            second,
            **waves,
            dt=step,
            id=f"{self.id}+{second.id}",
            log=(*second.log, f"Put {gap:g} s after {self.id}."),
            record_start=(ends[0] + rest.size) * step,
        )

    def __mul__(self, factor: float) -> Motion:
        if not isinstance(factor, float | int | np.number):
            return NotImplemented
        return self.scaled(float(factor))

    __rmul__ = __mul__

    @property
    def pga(self) -> float:
        """Peak of the horizontal acceleration [m/s2]."""
        return peak_of(self.acceleration)

    def spectrum(self, periods: ArrayLike) -> Samples:
        """Return Sa at `periods` [s], 5 % damping, shape (n_period,) [m/s2]."""
        return spectral_acceleration(self, periods)

    def measures(self, *names: str) -> dict[str, float]:
        """Return intensity measures by name, in SI units, such as "PGV" and "Sa(0.5)".

        Without names they are all that need no period: PGA [m/s2], PGV, Arias, CAV and CAVstd
        [m/s], PGD and HI [m], D5_95 [s].
        """
        return {name: measure(self, name) for name in names or PLAIN}

    @classmethod
    def from_obspy(
        cls,
        stream,
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
        given = [stream] if hasattr(stream, "stats") else stream
        traces = [trace.copy() for trace in given]
        if not traces:
            raise RecordError("the stream has no trace")
        stats = traces[0].stats
        names = [trace.id for trace in traces]
        place = ".".join(filter(None, (stats.network, stats.station))) or "stream"
        for name in names:
            if names.count(name) > 1:
                raise RecordError(
                    f"{name}: has several pieces; join them by `stream.merge()`"
                )
        factor = unit_factor(unit, place)
        words = calibrate.accepted_words(accept, place)
        channels = []
        for trace in traces:
            count = len(trace.data)
            trace.stats._format = "obspy"
            channel = Channel(
                str(trace.stats.channel).strip(),
                trace=trace,
                announced=count,
                held=count,
                unit_in_file=unit,
                accept=words,
                log=[f"Converted to m/s2: unit {unit} as stated, factor {factor:g}."],
            )
            warnings = calibrate.impossible(channel)
            channel.accepted = calibrate.accept_or_refuse(place, words, warnings)
            trace.data = trace.data.astype(float) * factor
            channels.append(channel)
        chosen, verticals = choose_horizontal(channels, place, component)
        return motion_of_channel(chosen, Path(place), chosen.trace.id, verticals)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the acceleration over time [g], in `ax` or in new axes."""
        from archfrag.plots import plot_motion  # start-up: matplotlib

        return plot_motion(self, ax)

    def __repr__(self) -> str:
        parts = " and ".join(self.components).replace("acceleration", "horizontal")
        return (
            f"<Motion {self.id or '(no id)'}: PGA {self.pga / STANDARD_GRAVITY:.3g} g, "
            f"{self.duration:g} s at {self.dt:g} s, {parts}>"
        )

    def _repr_html_(self) -> str:
        from archfrag.plots import html_of

        return html_of(self, (6.4, 2.2))


def motion_of_channel(
    channel: Channel,
    path: Path,
    name: str,
    verticals: Iterable[Channel] = (),
    listed: Mapping[str, Any] | None = None,
) -> Motion:
    """Return the motion of a channel in m/s2, with the vertical of its instrument if there is one.

    `name` is the id of the motion, and `verticals` are the vertical channels of the file. `listed`
    are the facts of an index, which come before those of the header. RecordError if the samples
    are implausible and this is not accepted, or if the vertical does not fit.
    """
    trace = channel.trace
    stats = trace.stats
    implausible = calibrate.implausible(channel)
    accepted = channel.accepted + calibrate.accept_or_refuse(
        path, channel.accept, implausible
    )
    stated = {key: getattr(channel, key, None) for key in Facts.__dataclass_fields__}
    facts = {
        "station": stats.station,
        **filled(stated),
        "file": path.name,
        "format": stats._format,
        "component": channel.code,
        "accepted": accepted,
        "trace": trace.id if stats.network or stats.station else "",
        "start_time": str(stats.starttime) if stats.starttime.timestamp else "",
    }
    kind = " ".join(filter(None, (stats._format, channel.level)))
    log = (f"Read from {path.name} ({kind}).", *channel.log, *accepted)
    own = {**Facts.of(facts), **Facts.of(listed or {})}
    motion = Motion(trace.data, stats.delta, None, name, own, log)
    for vertical in verticals:
        if vertical.instrument == channel.instrument:
            other = motion_of_channel(vertical, path, name, listed=listed)
            try:
                return with_component(motion, other, "vertical")
            except RecordError as error:
                raise RecordError(f"{path}: {error}") from None
    return motion


def with_component(motion: Motion, other: Motion, kind: str) -> Motion:
    """Return a motion with `other` as a further component, cut to the time that both have.

    `kind` is "vertical" or "transverse". RecordError if the two do not belong together, have
    unequal time steps or no time in common.
    """
    one = motion.facts
    two = other.facts
    file = two.file or other.id
    one_file = one.file == two.file
    name = f"{motion.id} and {file} ({two.component})"
    for key in () if one_file else ("event", "date", "station"):
        both = [getattr(facts, key) for facts in (one, two)]
        if all(both) and both[0].casefold() != both[1].casefold():
            raise RecordError(
                f"{name} do not belong together: {key} is {both[0]!r} and {both[1]!r}"
            )
    if not np.isclose(motion.dt, other.dt, rtol=1e-6, atol=0.0):
        raise RecordError(
            f"{name}: time steps {motion.dt:g} s and {other.dt:g} s must be equal"
        )
    late = (seconds(two.start_time) - seconds(one.start_time)) / motion.dt
    later = 0 if np.isnan(late) else round(late)
    first = max(0, later)
    other_first = max(0, -later)
    sizes = motion.acceleration.size, other.acceleration.size
    count = min(sizes[0] - first, sizes[1] - other_first)
    if count < 2:
        raise RecordError(f"{name} have no time in common")
    word = "Vertical" if kind == "vertical" else "Other horizontal"
    log = [
        step if step in two.accepted else f"{word} {two.component}: {step}"
        for step in (other.log[1:] if one_file else other.log)
    ]
    if count < max(sizes):
        log.append(
            f"Cut to the {count} samples in common with {file} ({two.component})."
        )
    kept = motion.changed(lambda samples: samples[first : first + count], "")
    part: Named = {kind: other.acceleration[other_first : other_first + count]}
    labels: Named = {f"of_{kind}": two}
    for key in ("errors", "cautions", "accepted"):
        labels[key] = list(dict.fromkeys(getattr(one, key) + getattr(two, key)))
    return replace(kept.stating(**labels), **part, log=(*motion.log, *log))


def seconds(time: str) -> float:
    """Return the seconds since 1970 of a UTC time in ISO's form; nan for another text."""
    try:
        moment = datetime.fromisoformat(time)
    except ValueError:
        return float("nan")
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()


def store(path: Path, motion: Motion) -> None:
    """Write the horizontal and the vertical acceleration to a numpy archive.

    It is written completely or not at all. Equal motions give equal bytes.
    """
    arrays: Named = {"acceleration": motion.acceleration}
    if motion.vertical is not None:
        arrays["vertical"] = motion.vertical
    with replacing(path, lasting=False) as part, open(part, "wb") as file:
        np.savez(file, **arrays)


def load_stored(path: Path, **known) -> Motion:
    """Return the motion that `store` wrote; InputError if the file is damaged.

    `known` are the other arguments of `Motion`, `dt` among them.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            return Motion(**archive, **known)
    except (OSError, ValueError, TypeError, zipfile.BadZipFile) as error:
        raise InputError(
            f"{path}: not a motion stored by archfrag, or damaged ({error})"
        ) from None
