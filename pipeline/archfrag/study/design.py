"""Designs of a study: which runs are made by which method, and when there are enough of them."""

from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from archfrag.errors import InputError
from archfrag.study.section import PathText, Section, refuse


def _known_method(name: str) -> str:
    from archfrag.simulation.checks import method_names

    if name not in method_names():
        raise refuse(f"must be one of {', '.join(method_names())}")
    return name


class Method(Section):
    """How the equations of motion are integrated."""

    name: Annotated[str, AfterValidator(_known_method)] = "auto"
    """Method; auto lets archfrag choose."""
    dt: Annotated[float, Field(ge=1e-6, le=0.1)] | None = None
    """Step of methods with a fixed step [s]; the method's default where not given."""
    rtol: Annotated[float, Field(ge=1e-12, lt=1.0)] | None = None
    """Relative error allowed by methods with step control; the method's default if not given."""
    follow: Annotated[float, Field(ge=0.0, le=3600.0)] = 20.0
    """How long a chain still moving at the end of a record is followed [s]."""
    loss_limit: Annotated[float, Field(ge=0.02, le=10.0)] = 0.5
    """Gap at both corners of a joint, over its length, beyond which contact is lost for good."""
    settings: dict[str, float] = Field(default_factory=dict)
    """Own parameters of the method that differ from their defaults, by name."""

    @model_validator(mode="after")
    def _own_settings(self) -> "Method":
        from archfrag.simulation.checks import check_method, check_settings, check_taken

        try:
            method = check_method(self.name)
            check_taken(method, dt=self.dt, rtol=self.rtol)
            check_settings(method, self.settings)
        except InputError as error:
            raise refuse(str(error)) from error
        return self


def parameter_texts() -> dict[str, str]:
    """What the registry states of each key of `Method` that some method takes."""
    from archfrag.methods.registry import resolve
    from archfrag.simulation.checks import method_names

    takers: dict[str, list[str]] = {}
    meaning: dict[str, str] = {}
    for name in method_names():
        info = resolve(name)
        for parameter in info.parameters if info else ():
            key, own = parameter.name, f" ({parameter.default:g} if not given)"
            if key in Method.model_fields:
                needed = Method.model_fields[key].default is None
                takers.setdefault(key, []).append(name + own if needed else name)
                meaning.setdefault(key, f"{parameter.meaning} [{parameter.unit}]")
    return {
        key: f"{text[:1].upper()}{text[1:]}; used by {', '.join(takers[key])}."
        for key, text in meaning.items()
    }


# A third of the cost of the default on the shipped study; the kernels are the same.
COARSE = Method(rtol=0.1)


class Precision(Section):
    """Rounds of runs are made until the median is known this well."""

    theta: Annotated[float, Field(ge=0.005, le=1.0)] = 0.05
    """How far the interval of ln(median) may reach to either side: 0.05 is 5 %."""
    confidence: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.9
    """Of the interval, two-sided."""
    runs: Annotated[int, Field(ge=10, le=10**6)] = 500
    """Most runs of an arch; where they do not suffice the report states so."""


class _Design(Section):
    seed: Annotated[int, Field(ge=0, le=10**9)] = 1
    """What the random choices of the design follow from."""


class Stripes(Section):
    """Every record at every level."""

    kind: Literal["stripes"] = "stripes"


class Ida(_Design):
    """The levels bisected for each record: a border between standing and collapse."""

    kind: Literal["ida"]
    checks: Annotated[int, Field(ge=0, le=10**6)] | None = None
    """Cells near the borders chosen at random for each arch, to see how often a run contradicts
    the capacity of its record; as many as records searched where not given."""
    precision: Precision | None = None
    """Records are added until this is reached; all are used where not given."""


class TwoStage(Ida):
    """As ida by a coarse method, then runs of the study's own method where it decides."""

    kind: Literal["two_stage"]  # type: ignore[assignment]
    coarse: Method = COARSE
    """Method of the first stage; follow and loss_limit are always those of the study."""
    fine: Annotated[float, Field(gt=0.0, le=1.0)] = 1.0
    """Fraction of the records whose capacity is decided by the study's own method. The others
    enter by their coarse capacities, corrected by what is found on these."""


class Scattered(_Design):
    """Each run a motion of its own, at a level of its own."""

    kind: Literal["scattered"]
    runs: Annotated[int, Field(ge=10, le=10**6)] = 150
    """Runs of an arch; at most as many as there are records."""
    pilot: Annotated[int, Field(ge=5, le=10**6)] = 40
    """First runs, over the full range of the study's levels."""
    round: Annotated[int, Field(ge=1, le=10**6)] = 20
    """Runs between two estimates of where the next ones are best made."""
    targets: Annotated[
        tuple[Annotated[float, Field(gt=0.0, lt=1.0)], ...], Field(strict=False, min_length=1)
    ] = (0.15, 0.85)
    """Probabilities of collapse at whose levels runs are made after the pilot."""
    precision: Precision | None = None
    """In the place of `runs`: rounds go on until this is reached."""

    @model_validator(mode="after")
    def _agree(self) -> "Scattered":
        if self.pilot > self.runs:
            raise refuse(f"must have a pilot of at most runs = {self.runs}, not {self.pilot}")
        return self


class Cloud(Section):
    """Every record once, as it is or by one factor."""

    kind: Literal["cloud"]
    factor: Annotated[float, Field(gt=0.0, le=1000.0)] = 1.0
    """On every record."""


Design = Annotated[Stripes | Ida | TwoStage | Scattered | Cloud, Field(discriminator="kind")]
GRIDS = ("stripes", "ida", "two_stage")


class LimitStates(Section):
    """Damage short of collapse, from the same runs.

    Motion, the first impact, loss of contact at a joint and collapse need no number.
    """

    rotation: Annotated[float, Field(gt=0.0, le=1.0)] = 0.5
    """Peak rotation over the static limit: the rotation at which the mechanism of onset is in
    unstable equilibrium."""
    residual: Annotated[float, Field(gt=0.0, le=1.0)] = 0.01
    """Residual displacement over the mean length of the joints."""


class ReportKeys(Section):
    """What comes first in the report."""

    at: Annotated[float, Field(gt=0.0, le=1e6)] | None = None
    """Level at which the probability of collapse is asked for, in the study's unit."""
    confidence: Annotated[float, Field(ge=0.5, lt=1.0)] = 0.9
    """Of all bands and intervals, two-sided."""


class Hazard(Section):
    """A hazard curve, for the rate of collapse."""

    hazard: PathText
    """CSV of intensity and annual rate or probability, or a file of OpenQuake; relative to the
    study file."""
    unit: str | None = None
    """Of its intensities where the file does not state it."""
    years: Annotated[float, Field(gt=0.0, le=1e4)] = 50.0
    """Time for which a probability is stated."""
    site: Annotated[tuple[float, float], Field(strict=False)] | None = None
    """Longitude and latitude, where the file has several sites [degrees]."""
