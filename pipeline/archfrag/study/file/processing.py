"""Steps that process the records of a study, one after the other."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

from pydantic import AfterValidator, Field, create_model, model_validator

from archfrag.study.file.messages import Section, refuse

if TYPE_CHECKING:
    from archfrag.motions.motion import Motion

Frequency = Annotated[float, Field(gt=0.0, le=1e4)]
Seconds = Annotated[float, Field(ge=0.0, le=3600.0)]
Degrees = Annotated[float, Field(ge=-360.0, le=360.0)]
Tail = Annotated[float, Field(gt=0.0, le=0.5)]


def _list(kind: Any, count: int) -> Any:
    return Annotated[list[kind], Field(min_length=count, max_length=count)]


# Steps by name: what is done, and of each setting its type, its default and its meaning.
STEPS: dict[str, tuple[str, dict[str, tuple[Any, Any, str]]]] = {
    "demean": ("Subtract the mean of the record.", {}),
    "detrend": ("Subtract the straight line that fits best.", {}),
    "taper": ("Bring the ends to zero by half a cosine wave.", {
        "fraction": (Tail, 0.05, "Of the record, at each end."),
        "side": (Literal["both", "left", "right"], "both", "Which ends."),
    }),
    "bandpass": (
        "Butterworth filter; without one corner a low-pass, without the other a high-pass.", {
        "lowest": (Frequency, None, "Lower corner [Hz]."),
        "highest": (Frequency, None, "Upper corner [Hz]."),
        "order": (Annotated[int, Field(ge=1, le=10)], 4, "Order of one pass."),
        "causal": (bool, False, "Forwards only; forwards and backwards, without a shift of "
                   "phase, if not."),
    }),
    "trim": ("Keep the strong part: by the Arias intensity, by a threshold, or by times.", {
        "arias": (_list(Annotated[float, Field(ge=0.0, le=1.0)], 2), None, "Fractions of the "
                  "Arias intensity between which to keep, e.g. [0.001, 0.999]."),
        "threshold_g": (Annotated[float, Field(gt=0.0, le=10.0)], None, "Keep from the first to "
                        "the last time that this acceleration is reached [g]."),
        "times": (_list(Seconds, 2), None, "From and to, counted from the first sample [s]."),
        "margin": (Seconds, 0.0, "Kept before and after what arias or threshold_g find [s]."),
    }),
    "resample": ("Give all records one time step, band-limited.", {
        "dt": (Annotated[float, Field(ge=1e-4, le=0.1)], ..., "Time step [s]."),
    }),
    "baseline": ("Subtract the derivative of a polynomial fitted to the velocity.", {
        "order": (Annotated[int, Field(ge=1, le=5)], 2, "Of the polynomial."),
    }),
    "response": ("Remove the instrument's response by its StationXML (obspy).", {
        "water_level": (Annotated[float, Field(ge=0.0, le=300.0)], 60.0, "How far below its "
                        "largest value the response counts at most [dB]."),
        "band": (_list(Frequency, 4), None, "What to keep: f1, f2, f3, f4 [Hz], cosine tapers "
                 "between the first and the last two."),
    }),
    "rotate": ("Make one motion of two horizontal components, in the plane of the arch.", {
        "azimuth": (Degrees, None, "Of the arch's +x, clockwise from north [degrees]."),
        "angle": (Degrees, None, "From the first component towards the other, where azimuths are "
                  "not known [degrees]."),
    }),
    "choose": ("Use some horizontal components only.", {
        "components": (Annotated[list[str], Field(min_length=1)], ..., "Codes, or their last "
                       "letters."),
    }),
}  # fmt: skip
# Settings of which a step must have one, and pairs that must rise.
_ONE_OF = {"trim": ("arias", "threshold_g", "times"), "rotate": ("azimuth", "angle")}
_LIBRARY = {"bandpass": "scipy", "resample": "scipy", "response": "obspy"}


def _check(name: str, settings: Mapping[str, Any]) -> None:
    """Check that the settings of one step agree."""
    given = [key for key in _ONE_OF.get(name, ()) if settings[key] is not None]
    if name in _ONE_OF and len(given) != 1:
        *first, last = _ONE_OF[name]
        raise refuse(f"must have one of {', '.join(first)} and {last} of {name}, not {len(given)}")
    if name == "trim" and isinstance(pair := settings[given[0]], list) and pair[0] >= pair[1]:
        raise refuse(f"must have {given[0]} increase, not {pair}")
    if name == "bandpass":
        low, high = settings["lowest"], settings["highest"]
        if low is None and high is None:
            example = "{bandpass: {lowest: 0.1, highest: 25}}"
            raise refuse(f"must have lowest, highest or both of bandpass [Hz], such as {example}")
        if low and high and low >= high:
            raise refuse(f"must have highest above lowest = {low:g} Hz")


class Step(Section):
    """One step: its name, and its settings."""

    called: ClassVar[str] = "step"

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
            raise refuse(f"must have one of the keys {', '.join(STEPS)}")
        _check(self.name, self.settings)
        return self

    @property
    def name(self) -> str:
        """Name of the step."""
        return next(iter(self.model_fields_set))

    @property
    def settings(self) -> dict[str, Any]:
        """Settings, with defaults filled in."""
        found: dict[str, Any] = getattr(self, self.name).model_dump()
        return found


def _model(name: str) -> Any:
    """Type of the settings of a step."""
    text, settings = STEPS[name]
    fields: dict[str, Any] = {
        key: (kind | None if default is None else kind, Field(default, description=about))
        for key, (kind, default, about) in settings.items()
    }
    return create_model(name.capitalize(), __base__=Section, __doc__=text, **fields)


def _in_order(steps: list[Step]) -> list[Step]:
    names = [step.name for step in steps]
    for once in ("rotate", "response", "choose"):
        if names.count(once) > 1:
            raise refuse(f"must have {once} once only")
    if "rotate" in names and "choose" in names[names.index("rotate") :]:
        raise refuse("must have choose before rotate")
    return steps


_AnyStep: Any = create_model(
    "Step", __base__=Step, __doc__=Step.__doc__, **{name: (_model(name), None) for name in STEPS}
)  # type: ignore[call-overload]
Steps = Annotated[list[_AnyStep], Field(max_length=50), AfterValidator(_in_order)]


def described(steps: Sequence[Step]) -> list[dict[str, Any]]:
    """Steps as provenance: name, settings, and the version of what does it."""
    return [
        {"step": step.name, "settings": step.settings, "version": _version(step)} for step in steps
    ]


def apply_step(step: Step, motion: "Motion", record: Path, inventory: str | None) -> "Motion":
    """Apply one step to a motion."""
    from archfrag.motions import process

    settings = step.settings
    if step.name == "choose":
        text = f"Components {', '.join(settings['components'])} chosen."
        return motion._replaced(log=(*motion.log, text))
    if step.name == "trim":
        changed = _trimmed(motion, **settings)
    elif step.name == "response":
        changed = process.remove_response(motion, record, inventory, **settings)
    else:
        changed = getattr(process, step.name)(motion, **settings)
    if len(changed.log) == len(motion.log):  # nothing to do
        return changed
    text = ", ".join(f"{key}={value}" for key, value in settings.items() if value is not None)
    note = f"{changed.log[-1]} [{step.name}({text}), {_version(step)}]"
    return changed._replaced(log=(*changed.log[:-1], note))


def _trimmed(
    motion: "Motion", arias: tuple[float, float] | None, threshold_g: float | None,
    times: Sequence[float] | None, margin: float,
) -> "Motion":  # fmt: skip
    from archfrag.motions import process
    from archfrag.motions.motion import STANDARD_GRAVITY

    if arias is not None:
        return process.trim_by_arias(motion, *arias, margin)
    if threshold_g is not None:
        return process.trim_by_threshold(motion, threshold_g * STANDARD_GRAVITY, margin)
    return process.cut(motion, *(times or ()))


def _version(step: Step) -> str:
    from importlib.metadata import version

    from archfrag import __version__

    library = _LIBRARY.get(step.name)
    return f"archfrag {__version__}" + (f", {library} {version(library)}" if library else "")
