"""What a study asks to be done to its records, one step after the other."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from archfrag.study.section import Section, refuse

if TYPE_CHECKING:
    from archfrag.motions.motion import Motion

Frequency = Annotated[float, Field(gt=0.0, le=1e4)]
Seconds = Annotated[float, Field(ge=0.0, le=3600.0)]
Fraction = Annotated[float, Field(ge=0.0, le=1.0)]
Degrees = Annotated[float, Field(ge=-360.0, le=360.0)]


class Demean(Section):
    """Subtract the mean of the record."""


class Detrend(Section):
    """Subtract the straight line that fits best."""


class Taper(Section):
    """Bring the ends to zero by half a cosine wave."""

    fraction: Annotated[float, Field(gt=0.0, le=0.5)] = 0.05
    """Of the record, at each end."""
    side: Literal["both", "left", "right"] = "both"
    """Which ends."""


class Bandpass(Section):
    """Butterworth filter; without the one corner a low-pass, without the other a high-pass."""

    lowest: Frequency | None = None
    """Lower corner [Hz]."""
    highest: Frequency | None = None
    """Upper corner [Hz]."""
    order: Annotated[int, Field(ge=1, le=10)] = 4
    """Order of one pass."""
    causal: bool = False
    """Forwards only; forwards and backwards, without a shift of phase, if not."""

    @model_validator(mode="after")
    def _have_a_corner(self) -> Self:
        if self.lowest is None and self.highest is None:
            example = "{bandpass: {lowest: 0.1, highest: 25}}"
            raise refuse(f"must have lowest, highest or both of bandpass [Hz], such as {example}")
        if self.lowest and self.highest and self.lowest >= self.highest:
            raise refuse(f"must have highest above lowest = {self.lowest:g} Hz")
        return self


class Trim(Section):
    """Keep the strong part: by the Arias intensity, by a threshold, or by times."""

    arias: Annotated[tuple[Fraction, Fraction], Field(strict=False)] | None = None
    """Fractions of the Arias intensity between which to keep, e.g. [0.001, 0.999]."""
    threshold_g: Annotated[float, Field(gt=0.0, le=10.0)] | None = None
    """Keep from the first to the last time that this acceleration is reached [g]."""
    times: Annotated[tuple[Seconds, Seconds], Field(strict=False)] | None = None
    """From and to, counted from the first sample [s]."""
    margin: Seconds = 0.0
    """Kept before and after what arias or threshold_g find [s]."""

    @model_validator(mode="after")
    def _one_rule(self) -> Self:
        given = [k for k in ("arias", "threshold_g", "times") if getattr(self, k) is not None]
        if len(given) != 1:
            raise refuse(f"must have one of arias, threshold_g and times, not {len(given)}")
        for pair in (self.arias, self.times):
            if pair is not None and pair[0] >= pair[1]:
                raise refuse(f"must have {given[0]} increase, not {list(pair)}")
        return self


class Resample(Section):
    """Give all records one time step, band-limited."""

    dt: Annotated[float, Field(ge=1e-4, le=0.1)]
    """Time step [s]."""


class Baseline(Section):
    """Subtract the derivative of a polynomial fitted to the velocity."""

    order: Annotated[int, Field(ge=1, le=5)] = 2
    """Of the polynomial."""


class Response(Section):
    """Remove the instrument's response by its StationXML (obspy)."""

    water_level: Annotated[float, Field(ge=0.0, le=300.0)] = 60.0
    """How far below its largest value the response counts at most [dB]."""
    band: Annotated[
        tuple[Frequency, Frequency, Frequency, Frequency], Field(strict=False)
    ] | None = None  # fmt: skip
    """What to keep: f1, f2, f3, f4 [Hz], cosine tapers between the first and the last two."""


class Rotate(Section):
    """Rotate both horizontal components into the plane of the arch: one motion of two."""

    azimuth: Degrees | None = None
    """Of the arch's +x, clockwise from north [degrees]."""
    angle: Degrees | None = None
    """From the first component towards the other, where azimuths are not known [degrees]."""

    @model_validator(mode="after")
    def _one_direction(self) -> Self:
        if (self.azimuth is None) == (self.angle is None):
            raise refuse("must have one of azimuth and angle")
        return self


class Choose(Section):
    """Use some horizontal components only."""

    components: Annotated[tuple[str, ...], Field(strict=False, min_length=1)]
    """Codes, or their last letters."""


class Step(Section):
    """One step: its name, and its settings."""

    called: ClassVar[str] = "step"

    demean: Demean = None  # type: ignore[assignment]
    detrend: Detrend = None  # type: ignore[assignment]
    taper: Taper = None  # type: ignore[assignment]
    bandpass: Bandpass = None  # type: ignore[assignment]
    trim: Trim = None  # type: ignore[assignment]
    resample: Resample = None  # type: ignore[assignment]
    baseline: Baseline = None  # type: ignore[assignment]
    response: Response = None  # type: ignore[assignment]
    rotate: Rotate = None  # type: ignore[assignment]
    choose: Choose = None  # type: ignore[assignment]

    @model_validator(mode="before")
    @classmethod
    def _named(cls, given: Any) -> Any:
        named = {given: {}} if isinstance(given, str) else given
        if not isinstance(named, dict):
            return named
        return {name: {} if settings is None else settings for name, settings in named.items()}

    @model_validator(mode="after")
    def _one_step(self) -> Self:
        if len(self.model_fields_set) != 1:
            raise refuse(f"must have one of the keys {', '.join(type(self).model_fields)}")
        return self

    @property
    def name(self) -> str:
        """What is done."""
        return next(iter(self.model_fields_set))

    @property
    def settings(self) -> dict[str, Any]:
        """With what, all defaults filled in."""
        return getattr(self, self.name).model_dump(mode="json")


def _in_order(steps: tuple[Step, ...]) -> tuple[Step, ...]:
    names = [step.name for step in steps]
    for once in ("rotate", "response", "choose"):
        if names.count(once) > 1:
            raise refuse(f"must have {once} once only")
    if "rotate" in names and "choose" in names[names.index("rotate") :]:
        raise refuse("must have choose before rotate")
    return steps


Steps = Annotated[tuple[Step, ...], Field(strict=False, max_length=50), AfterValidator(_in_order)]


def described(steps: Sequence[Step]) -> list[dict[str, Any]]:
    """Steps as provenance: name, settings, and the version of what does it."""
    return [
        {"step": step.name, "settings": step.settings, "version": _version(step)} for step in steps
    ]


def apply_step(step: Step, motion: "Motion", record: Path, inventory: str | None) -> "Motion":
    """Do one step to a motion."""
    from archfrag.motions import process

    settings = getattr(step, step.name).model_dump()
    if step.name == "trim":
        changed = _trimmed(motion, **settings)
    elif step.name == "rotate":
        from archfrag.motions.rotate import rotate

        changed = rotate(motion, **settings)
    elif step.name == "response":
        from archfrag.motions.response import remove_response

        changed = remove_response(motion, record, inventory, **settings)
    else:
        changed = getattr(process, step.name)(motion, **settings)
    if len(changed.log) == len(motion.log):  # nothing to do
        return changed
    text = ", ".join(f"{key}={value}" for key, value in settings.items() if value is not None)
    note = f"{changed.log[-1]} [{step.name}({text}), {_version(step)}]"
    return changed._replaced(log=(*changed.log[:-1], note))


def _trimmed(
    motion: "Motion", arias: tuple[float, float] | None, threshold_g: float | None,
    times: tuple[float, float] | None, margin: float,
) -> "Motion":  # fmt: skip
    from archfrag.motions import process
    from archfrag.motions.units import STANDARD_GRAVITY

    if arias is not None:
        return process.trim_by_arias(motion, *arias, margin)
    if threshold_g is not None:
        return process.trim_by_threshold(motion, threshold_g * STANDARD_GRAVITY, margin)
    assert times is not None
    return process.cut(motion, *times)


def _version(step: Step) -> str:
    from importlib.metadata import version

    from archfrag import __version__

    library = {"bandpass": "scipy", "resample": "scipy", "response": "obspy"}.get(step.name)
    return f"archfrag {__version__}" + (f", {library} {version(library)}" if library else "")
