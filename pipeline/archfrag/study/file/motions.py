"""Motions of a study file: record files, and steps that process them in order."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BeforeValidator, Field, create_model

from archfrag.arch import STANDARD_GRAVITY
from archfrag.errors import InputError
from archfrag.motions.calibrate import Acceptable
from archfrag.study.file import PathText, Section, refuse

if TYPE_CHECKING:
    from archfrag.motions.motion import Motion

Frequency = Annotated[float, Field(gt=0.0, le=1e4)]
Seconds = Annotated[float, Field(ge=0.0, le=3600.0)]
Degrees = Annotated[float, Field(ge=-360.0, le=360.0)]
Fraction = Annotated[float, Field(ge=0.0, le=1.0)]
TWO, FOUR = Field(min_length=2, max_length=2), Field(min_length=4, max_length=4)
# Steps by name: what is done, and of each setting its type, its default and its meaning.
STEPS: dict[str, tuple[str, dict[str, tuple[Any, Any, str]]]] = {
    "demean": ("Subtract the mean of the record.", {}),
    "detrend": ("Subtract the straight line that fits best.", {}),
    "taper": ("Bring the ends to zero by half a cosine wave.", {
        "fraction": (Annotated[float, Field(gt=0.0, le=0.5)], 0.05, "Of the record, at each end."),
        "side": (Literal["both", "left", "right"], "both", "Which ends."),
    }),
    "bandpass": ("Butterworth filter; a low-pass or a high-pass if one corner is left out.", {
        "lowest": (Frequency, None, "Lower corner [Hz]."),
        "highest": (Frequency, None, "Upper corner [Hz]."),
        "order": (Annotated[int, Field(ge=1, le=10)], 4, "Order of one pass."),
        "causal": (bool, False, "Forwards only; if not, also backwards, without a phase shift."),
    }),
    "trim": ("Keep the strong part: by the Arias intensity, by a threshold, or by times.", {
        "arias": (Annotated[list[Fraction], TWO], None,
                  "Fractions of the Arias intensity between which to keep, e.g. [0.001, 0.999]."),
        "threshold_g": (Annotated[float, Field(gt=0.0, le=10.0)], None,
                        "Keep from the first to the last time with this acceleration [g]."),
        "times": (Annotated[list[Seconds], TWO], None, "From and to, from the first sample [s]."),
        "margin": (Seconds, 0.0, "Kept before and after what arias or threshold_g find [s]."),
    }),
    "resample": ("Give all records one time step, band-limited.", {
        "dt": (Annotated[float, Field(ge=1e-4, le=0.1)], ..., "Time step [s]."),
    }),
    "baseline": ("Subtract the derivative of a polynomial fitted to the velocity.", {
        "order": (Annotated[int, Field(ge=1, le=5)], 2, "Of the polynomial."),
    }),
    "response": ("Remove the instrument's response by its StationXML (obspy).", {
        "water_level": (Annotated[float, Field(ge=0.0, le=300.0)], 60.0,
                        "How far below its largest value the response counts at most [dB]."),
        "band": (Annotated[list[Frequency], FOUR], None,
                 "f1, f2, f3, f4 [Hz] to keep: cosine tapers between the first and last two."),
    }),
    "rotate": ("Make one motion of two horizontal components, in the plane of the arch.", {
        "azimuth": (Degrees, None, "Of the arch's +x, clockwise from north [degrees]."),
        "angle": (Degrees, None,
                  "From the first component to the other, if azimuths are not known [degrees]."),
    }),
    "choose": ("Use some horizontal components only.", {
        "components": (Annotated[list[str], Field(min_length=1)], ...,
                       "Codes, or their last letters."),
    }),
}  # fmt: skip


def _mapping(given: Any) -> Any:
    named = {given: {}} if isinstance(given, str) else given
    if not isinstance(named, dict):
        return named
    if len(named) != 1:
        raise refuse(f"must have one of the keys {', '.join(STEPS)}")
    return {name: {} if settings is None else settings for name, settings in named.items()}


def _settings(name: str) -> Any:
    text, settings = STEPS[name]
    fields: dict[str, Any] = {
        key: (kind | None if default is None else kind, Field(default, description=about))
        for key, (kind, default, about) in settings.items()
    }
    return create_model(name.capitalize(), __base__=Section, __doc__=text, **fields)


_blocks: dict[str, Any] = {name: (_settings(name), None) for name in STEPS}
_Step: Any = Annotated[
    create_model("Step", __base__=Section, __doc__="One step: its name, and its settings.",
                 **_blocks),
    BeforeValidator(_mapping),
]  # fmt: skip


class FileSet(Section):
    """Records by path or pattern."""

    path: PathText
    """A file, or a pattern with * and ? in any case, relative to the study file."""
    unit: str | None = None
    """Unit of the samples if the file does not state it; never guessed."""
    inventory: PathText | None = None
    """StationXML with the response, for records in counts."""
    columns: str | None = None
    """Columns of plain text: time=1,acceleration=2 or acceleration=1,dt=0.01; dt=0.01 alone reads
    all numbers, row after row; also vertical=COLUMN and skip=LINES."""
    accept: Annotated[
        list[Acceptable],
        BeforeValidator(lambda given: given.split() if isinstance(given, str) else given),
    ] = Field(default_factory=list)
    """Let pass: pga (1e-5 to 5 g), time_step (1e-4 to 0.1 s), samples (other than announced),
    header (its peak is off by a tenth)."""


class Motions(Section):
    """The ground motions of the study."""

    index: PathText | None = None
    """Index (CSV) of shipped records, relative to the study file."""
    select: Annotated[list[str], Field(min_length=1)] | None = None
    """Ids of the records to use, in this order; all if not given."""
    files: list[
        Annotated[FileSet, BeforeValidator(lambda g: {"path": g} if isinstance(g, str) else g)]
    ] = Field(default_factory=list)
    """Record files or patterns; each a path, or a mapping with path, unit, columns and so on."""
    vertical: bool = False
    """Whether vertical components move the arches too, from the same file or from a matching file
    next to it, scaled as the horizontal one. Every record must then have one."""
    both_senses: bool = False
    """Whether each record is also used with its horizontal components reversed, as ID-rev, so
    that its sense does not decide. Both belong to one earthquake; the vertical stays as it is."""
    processing: Annotated[list[_Step], Field(max_length=50)] = Field(default_factory=list)
    """Steps applied to each record before it is measured and scaled, in this order."""

    @property
    def steps(self) -> list[tuple[str, dict[str, Any]]]:
        """Name and settings of each step of processing, with defaults filled in."""
        return [(name, getattr(step, name).model_dump())
                for step in self.processing for name in step.model_fields_set]  # fmt: skip


def apply_step(
    name: str, settings: dict[str, Any], motion: "Motion", record: Path, inventory: str | None
) -> "Motion":
    """Apply one step to a motion; InputError if it does not suit it."""
    from archfrag.motions import process

    if name == "choose":  # done where records are read
        return motion
    if name == "response":
        return process.remove_response(motion, record, inventory, **settings)
    if name != "trim":
        changed: Motion = getattr(process, name)(motion, **settings)
        return changed
    arias, threshold, times, margin = settings.values()
    if [arias, threshold, times].count(None) != 2:
        raise InputError("one of arias, threshold_g and times is needed")
    if arias is not None:
        return process.trim_by_arias(motion, arias[0], arias[1], margin)
    if threshold is not None:
        return process.trim_by_threshold(motion, threshold * STANDARD_GRAVITY, margin)
    return process.cut(motion, *times)
