"""Synthetic ground motions, and suites of them: each from its magnitude, distance and seeds."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from archfrag.errors import InputError
from archfrag.files import make_folder, replacing, sha256_of
from archfrag.motions.index import COLUMNS, write_index
from archfrag.motions.synthetic.amplitude import VS30
from archfrag.motions.synthetic.motion import Recipe, make_motion

__all__ = ["VS30", "Plan", "Recipe", "make_motion", "make_suite", "plan_motions",
           "shipped_recipes"]  # fmt: skip

# Magnitude and the distances [km] of the shipped suite: three earthquakes of each magnitude, the
# first with the first and the fourth distance, and so on; each motion at a site of its own.
SUITE = {
    5.5: (5.0, 10.0, 15.0, 20.0, 30.0, 40.0),
    6.0: (5.0, 10.0, 20.0, 30.0, 40.0, 60.0),
    6.5: (5.0, 10.0, 20.0, 30.0, 50.0, 70.0),
    7.0: (5.0, 10.0, 20.0, 40.0, 60.0, 100.0),
    7.5: (10.0, 15.0, 20.0, 40.0, 60.0, 100.0),
}
EVENTS, FIRST_SEED = 3, 20250101  # of each magnitude; of the first motion
FOLDER, COMPONENT = "synthetic", "HN1"
TERMS = "made by archfrag; BSD-3-Clause as archfrag itself"
# Seeds of a suite are its own seed times this, plus consecutive numbers: other suites, others.
SPACING = 10**6
_DRAWN = 2**62  # where seeds of drawn magnitudes and distances lie, apart from those of motions


@dataclass(frozen=True)
class Plan:
    """A suite that is asked for."""

    events: int
    records_per_event: int
    magnitude: Sequence[float]  # taken in turn by the events, or two ends of what is drawn
    distance: Sequence[float]  # [km], by the records; drawn uniformly in logarithm
    drawn_magnitude: bool = False
    drawn_distance: bool = False
    seed: int = 1  # 0 to 10^9
    sites: int | None = None  # record n is at site n modulo this, or at one of its own
    vs30: float = VS30  # [m/s]
    vertical: bool = False
    pulses: float = 0.0  # probability of each record to have a pulse


def plan_motions(plan: Plan) -> list[Recipe]:
    """Recipes of a suite, event by event; InputError if there are more records than seeds."""
    count = plan.events * plan.records_per_event
    if count > SPACING:
        raise InputError(f"{count} motions are more than {SPACING}, the seeds of one suite")
    first = plan.seed * SPACING
    generator = np.random.Generator(np.random.PCG64(_DRAWN + plan.seed))
    magnitudes = np.resize(plan.magnitude, plan.events)
    if plan.drawn_magnitude:
        low, high = plan.magnitude
        magnitudes = generator.uniform(low, high, plan.events).round(6)
    distances = np.resize(plan.distance, count)
    if plan.drawn_distance:
        low, high = np.log(np.maximum(plan.distance, 1e-3)).tolist()
        distances = np.exp(generator.uniform(low, high, count).round(6)).round(2)
    pulses = generator.uniform(size=count) < plan.pulses
    recipes = []
    for number, (distance, pulse) in enumerate(zip(distances.tolist(), pulses.tolist())):
        event, record = divmod(number, plan.records_per_event)
        site = number if plan.sites is None else number % plan.sites
        recipes.append(Recipe(
            float(magnitudes[event]), distance, first + number, first + event, first + site,
            vs30=plan.vs30, vertical=plan.vertical, pulse=pulse, id=f"e{event + 1}-r{record + 1}",
        ))  # fmt: skip
    return recipes


def shipped_recipes() -> list[Recipe]:
    """Recipes of the shipped motions; no motion was chosen by its result."""
    recipes: list[Recipe] = []
    for group, (magnitude, distances) in enumerate(SUITE.items()):
        for place, distance in enumerate(distances):
            seed = FIRST_SEED + len(recipes)
            event = FIRST_SEED + group * EVENTS + place % EVENTS
            name = f"syn-m{round(10 * magnitude):02d}-r{round(distance):03d}"
            recipes.append(Recipe(magnitude, distance, seed, event, id=name))
    return recipes


def make_suite(out_dir: str | Path, recipes: Sequence[Recipe] | None = None) -> list[Path]:
    """Write motions, or those that are shipped: ``synthetic/*.mseed`` in m/s2 and ``index.csv``.

    Returns the record files in the order of the index; OutputError if one cannot be written.
    """
    from obspy import Stream, Trace, UTCDateTime

    folder, rows = Path(out_dir), []
    make_folder(folder / FOLDER)
    recipes = shipped_recipes() if recipes is None else recipes
    pulses = any(recipe.pulse for recipe in recipes)
    for number, recipe in enumerate(recipes, start=1):
        motion = make_motion(recipe)
        path, stream = folder / FOLDER / f"{recipe.id}.mseed", Stream()
        header = {"network": "XX", "station": f"S{number % 10000:04d}", "delta": motion.dt,
                  "starttime": UTCDateTime(2000, 1, 1)}  # fmt: skip
        for channel, samples in ((COMPONENT, motion.acceleration), ("HNZ", motion.vertical)):
            if samples is not None:
                stream.append(Trace(samples.astype(np.float32), {**header, "channel": channel}))
        with replacing(path, lasting=False) as part:
            stream.write(str(part), "MSEED", encoding="FLOAT32", reclen=4096, byteorder=">")
        known = {key: value for key, value in motion.metadata.items() if key in COLUMNS}
        rows.append(known | {
            "id": recipe.id, "file": f"{FOLDER}/{path.name}", "sha256": sha256_of(path),
            "component": COMPONENT, "dt_s": motion.dt, "unit": "m/s2", "terms": TERMS,
        } | ({"pulse": recipe.pulse} if pulses else {}))  # fmt: skip
    write_index(folder, rows)
    return [folder / row["file"] for row in rows]
