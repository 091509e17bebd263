"""What is asked of the results of a study: limit states, a level to answer at, a hazard."""

from typing import Annotated

from pydantic import Field

from archfrag.study.section import PathText, Section


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
    """What the report says first."""

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
    """Of its intensities where the file does not say."""
    years: Annotated[float, Field(gt=0.0, le=1e4)] = 50.0
    """Time for which a probability is stated."""
    site: Annotated[tuple[float, float], Field(strict=False)] | None = None
    """Longitude and latitude, where the file has several sites [degrees]."""
