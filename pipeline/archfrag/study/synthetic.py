"""Synthetic motions of a study: made where they are needed, never stored."""

import hashlib
import json
from collections.abc import Iterator
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Discriminator, Field, Tag

from archfrag.errors import InputError
from archfrag.study.files import canonical_json
from archfrag.study.section import Rising, Section

if TYPE_CHECKING:
    from archfrag.motions.motion import Motion
    from archfrag.motions.synthetic import Plan

FILE = "synthetic"  # in the place of the name of a record file
Magnitude = Annotated[float, Field(ge=3.0, le=8.0)]
Distance = Annotated[float, Field(ge=0.0, le=300.0)]
_SOME = Field(strict=False, min_length=1, max_length=1000)


class Magnitudes(Rising):
    """Magnitudes drawn uniformly."""

    start: Magnitude
    """Smallest."""
    stop: Magnitude
    """Largest."""


class Distances(Rising):
    """Distances drawn uniformly in their logarithm [km]."""

    start: Annotated[float, Field(gt=0.0, le=300.0)]
    """Smallest [km]."""
    stop: Distance
    """Largest [km]."""


def _listed_or_drawn(given: Any) -> str:
    return "drawn" if isinstance(given, dict | Rising) else "listed"


class Synthetic(Section):
    """Motions made by archfrag; each follows from its row of seeds alone."""

    events: Annotated[int, Field(ge=1, le=100_000)]
    """Earthquakes."""
    records_per_event: Annotated[int, Field(ge=1, le=100_000)] = 1
    """Records of each earthquake."""
    magnitude: Annotated[
        Annotated[tuple[Magnitude, ...], _SOME, Tag("listed")]
        | Annotated[Magnitudes, Tag("drawn")],
        Discriminator(_listed_or_drawn),
    ]
    """A list that the earthquakes go through; or start and stop, between which to draw."""
    distance_km: Annotated[
        Annotated[tuple[Distance, ...], _SOME, Tag("listed")] | Annotated[Distances, Tag("drawn")],
        Discriminator(_listed_or_drawn),
    ]
    """To the rupture [km]: a list that the records go through; or start and stop, to draw."""
    vs30: Annotated[float, Field(ge=450.0, le=1000.0)] = 760.0
    """Shear-wave velocity of the upper 30 m at the sites [m/s]."""
    sites: Annotated[int, Field(ge=1)] | None = None
    """Sites that the records go through; one for each record where not given."""
    seed: Annotated[int, Field(ge=0, le=10**9)] = 1
    """What all that is drawn follows from."""
    vertical: bool = False
    """Whether each motion has a vertical component, which moves the arches whatever
    motions.vertical asks of records."""
    pulses: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0
    """Probability that a motion has the velocity pulse of a near fault."""


def plan_of(wanted: Synthetic) -> "Plan":
    """The same for `archfrag.motions.synthetic`."""
    from archfrag.motions.synthetic import Plan

    both = (wanted.magnitude, wanted.distance_km)
    magnitude, distance = (
        each if isinstance(each, tuple) else (each.start, each.stop) for each in both
    )
    given = wanted.model_dump(exclude={"magnitude", "distance_km"})
    drawn = [isinstance(each, Rising) for each in both]
    return Plan(
        magnitude=magnitude, distance=distance, drawn_magnitude=drawn[0],
        drawn_distance=drawn[1], **given,
    )  # fmt: skip


def made_motions(wanted: Synthetic) -> Iterator["Motion"]:
    """The motions of a study, each with its recipe and its digest in its metadata."""
    from archfrag.motions.synthetic import plan_motions

    for recipe in plan_motions(plan_of(wanted)):
        motion = recipe.make()
        made = canonical_json(asdict(recipe))
        facts = {"file": FILE, "file_sha256": _digest(motion), "recipe": made}
        motion.metadata.update(facts)  # type: ignore[attr-defined]
        yield motion


def motion_of(recipe: str, digest: str) -> "Motion":
    """The motion that a recipe gives."""
    from archfrag.motions.synthetic import Options, Recipe, Seeds

    given = json.loads(recipe)
    seeds, options = Seeds(**given.pop("seeds")), Options(**given.pop("options"))
    motion = Recipe(seeds=seeds, options=options, **given).make()
    if _digest(motion) != digest:
        what = "its samples are not those that the study was prepared with"
        again = "`archfrag motions` on the study file makes it anew"
        raise InputError(f"synthetic motion {motion.id!r}: {what}; {again}")
    return motion


def _digest(motion: "Motion") -> str:
    content = hashlib.sha256(repr(motion.dt).encode())
    for samples in (motion.acceleration, motion.vertical):
        content.update(b"" if samples is None else samples.tobytes())
    return content.hexdigest()
