"""Blocks of a study file: intensity, method, limit states, report, risk and execution."""

from itertools import pairwise
from typing import Annotated, Any, Self

from pydantic import AfterValidator, Discriminator, Field, Tag, model_validator

from archfrag.arch import STANDARD_GRAVITY
from archfrag.errors import InputError
from archfrag.study.file.messages import PathText, Section, refuse, refuse_key

# Units that a level may be given in, by the SI unit of its measure, with the factor to SI.
LEVEL_UNITS: dict[str, dict[str, float]] = {
    "m/s2": {"g": STANDARD_GRAVITY, "m/s2": 1.0, "cm/s2": 0.01, "gal": 0.01},
    "m/s": {"m/s": 1.0, "cm/s": 0.01},
    "m": {"m": 1.0, "cm": 0.01},
}
PERIODS = (0.01, 20.0)  # of a spectral measure [s]
MOST_LEVELS = 1000
Level = Annotated[float, Field(gt=0.0, le=1e6)]


def _increasing(levels: list[float]) -> list[float]:
    for before, level in pairwise(levels):
        if level <= before:
            raise refuse(f"must increase, but {level:g} follows {before:g}")
    return levels


class LevelRange(Section):
    """Equally spaced levels."""

    start: Level
    """First level."""
    stop: Level
    """Last level."""
    count: Annotated[int, Field(ge=2, le=MOST_LEVELS)]
    """Number of levels, both ends included."""

    @model_validator(mode="after")
    def _increases(self) -> Self:
        if self.stop <= self.start:
            raise refuse(f"must have stop above start = {self.start:g}, not {self.stop:g}")
        _increasing(self.values())
        return self

    def values(self) -> list[float]:
        """The levels, to twelve digits: what a person would have typed."""
        step = (self.stop - self.start) / (self.count - 1)
        return [float(f"{self.start + i * step:.12g}") for i in range(self.count)]


LevelList = Annotated[
    list[Level], Field(min_length=1, max_length=MOST_LEVELS), AfterValidator(_increasing)
]


def _list_or_range(given: Any) -> str:
    return "range" if isinstance(given, dict | LevelRange) else "list"


class Intensity(Section):
    """The levels to which the motions are scaled."""

    measure: str
    """PGA, PGV, PGD, Arias, CAV, HI, or, with periods from 0.01 to 20 s, Sa(T) or AvgSA(T1,T2);
    RotD50() or RotD100() of PGA, PGV or Sa(T)."""
    unit: str
    """Unit of the levels: g, m/s2, cm/s2 or gal for accelerations, m/s or cm/s for velocities, m
    or cm for lengths."""
    levels: Annotated[
        Annotated[LevelList, Tag("list")] | Annotated[LevelRange, Tag("range")],
        Discriminator(_list_or_range),
    ]
    """Increasing list, or start, stop and count."""

    @model_validator(mode="after")
    def _agree(self) -> Self:
        from archfrag.motions.measures import measure_unit, parse_measure, scaling_exponent

        try:
            periods = parse_measure(self.measure).periods
        except InputError as error:
            raise refuse_key("measure", f"= {self.measure}: {error}") from None
        low, high = PERIODS
        if not all(low <= period <= high for period in periods):
            text = f"= {self.measure} must have periods from {low:g} to {high:g} s"
            raise refuse_key("measure", text)
        if not scaling_exponent(self.measure):
            raise refuse_key("measure", f"= {self.measure}: no motion can be scaled to it")
        allowed = LEVEL_UNITS.get(measure_unit(self.measure), {})
        if self.unit not in allowed:
            text = f"must be one of {', '.join(allowed)}, the units of {self.measure}"
            raise refuse_key("unit", f"= {self.unit} {text}")
        return self

    @property
    def given(self) -> tuple[float, ...]:
        """Levels in the user's unit."""
        return tuple(self.levels.values() if isinstance(self.levels, LevelRange) else self.levels)

    @property
    def si(self) -> tuple[float, ...]:
        """Levels in the SI unit of the measure."""
        return tuple(level * self.factor for level in self.given)

    @property
    def factor(self) -> float:
        """SI unit of the measure in multiples of the unit of the levels."""
        from archfrag.motions.measures import measure_unit

        return LEVEL_UNITS[measure_unit(self.measure)][self.unit]


class Method(Section):
    """How the equations of motion are integrated."""

    name: str = "auto"
    """Method; with auto archfrag chooses one."""
    dt: Annotated[float, Field(ge=1e-6, le=0.1)] | None = None
    """Fixed time step [s]; if not given, steps follow rtol."""
    rtol: Annotated[float, Field(ge=1e-12, lt=1.0)] | None = None
    """Allowed relative error, unless dt is given; the method's default if not given."""
    follow: Annotated[float, Field(ge=0.0, le=3600.0)] = 20.0
    """Longest time to simulate after a record while the arch still moves [s]."""
    loss_limit: Annotated[float, Field(ge=0.02, le=10.0)] = 0.5
    """Gap at both corners of a joint, over its length, beyond which contact is lost for good."""
    settings: dict[str, float] = Field(default_factory=dict)
    """Parameters of this method that differ from their defaults, by name."""

    @model_validator(mode="after")
    def _known_with_its_settings(self) -> Self:
        from archfrag.simulation import checks

        names = checks.method_names()
        if self.name not in names:
            raise refuse_key("name", f"= {self.name} must be one of {', '.join(names)}")
        try:
            method = checks.check_method(self.name)
            checks.check_taken(method, dt=self.dt, rtol=self.rtol)
            checks.check_settings(method, self.settings)
        except InputError as error:
            raise refuse(str(error)) from error
        return self


class LimitStates(Section):
    """Damage before collapse, from the same runs.

    Motion, the first impact, loss of contact at a joint and collapse need no number.
    """

    rotation: Annotated[float, Field(gt=0.0, le=1.0)] = 0.5
    """Peak rotation over the static limit: the rotation at which the mechanism of onset is in
    unstable equilibrium."""
    residual: Annotated[float, Field(gt=0.0, le=1.0)] = 0.01
    """Residual displacement over the mean length of the joints."""


class ReportKeys(Section):
    """The first numbers of the report."""

    at: Annotated[float, Field(gt=0.0, le=1e6)] | None = None
    """Level whose probability of collapse the report gives first, in the study's unit."""
    confidence: Annotated[float, Field(ge=0.5, lt=1.0)] = 0.9
    """Confidence of all bands and intervals, two-sided."""


class RiskKeys(Section):
    """A hazard curve, for the rate of collapse."""

    hazard: PathText
    """CSV of intensity and annual rate or probability, or a file of OpenQuake; relative to the
    study file."""
    unit: str | None = None
    """Unit of its intensities if the file does not state it."""
    years: Annotated[float, Field(gt=0.0, le=1e4)] = 50.0
    """Period for the probability of collapse [years]."""
    site: Annotated[list[float], Field(min_length=2, max_length=2)] | None = None
    """Longitude and latitude, if the file has several sites [degrees]."""


class Execution(Section):
    """Where and in what portions the study runs; never changes a result."""

    workers: Annotated[int, Field(ge=1)] | None = None
    """Number of one-thread processes; as many as cores by default. A batch makes its first five
    seconds of runs without them."""
    scheduler: str | None = None
    """Address of a running dask scheduler, to use instead of own workers. It executes any code
    sent to it under your account: use tls:// with the certificates of dask's configuration, or
    a private network."""
    chunk: Annotated[int, Field(ge=1)] | None = None
    """Runs in one part file; depends on the number of runs if not given."""
    batches: Annotated[int, Field(ge=1, le=999)] = 1
    """Number of Snakemake jobs among which the runs are divided."""
