"""Designs of a study: which runs are made, and when there are enough of them."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from archfrag.study.method import Method
from archfrag.study.section import Section, refuse

# A third of the cost of the default on the shipped study; the kernels are the same.
COARSE = Method(rtol=0.1)


class Precision(Section):
    """Rounds of runs are made until the median is known this well."""

    theta: Annotated[float, Field(ge=0.005, le=1.0)] = 0.05
    """How far the interval of ln(median) may reach to either side: 0.05 is 5 %."""
    confidence: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.9
    """Of the interval, two-sided."""
    runs: Annotated[int, Field(ge=10, le=10**6)] = 500
    """Most runs of an arch; where they do not suffice the report says so."""


class _Design(Section):
    seed: Annotated[int, Field(ge=0, le=10**9)] = 1
    """What the random choices of the design follow from."""


class Stripes(Section):
    """Every record at every level."""

    kind: Literal["stripes"] = "stripes"


class Ida(_Design):
    """The levels bisected for each record: the lowest at which it causes collapse."""

    kind: Literal["ida"]
    checks: Annotated[int, Field(ge=0, le=10**6)] | None = None
    """Cells of the grid chosen at random for each arch, to see how often a run contradicts the
    capacity of its record; a third of the number of records searched where not given."""
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
    """First runs, over the whole range of the study's levels."""
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
