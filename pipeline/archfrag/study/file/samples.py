"""Arches drawn for an entry with `vary`: keys by a design of points, joints one by one."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from archfrag.errors import InputError
from archfrag.study.file.arches import ArchEntry
from archfrag.study.file.messages import first_message
from archfrag.study.file.vary import JointScatter

FloatArray = NDArray[np.float64]
LONGEST_ID = 70  # of an entry whose arches get its id with a number behind it
_DIGITS = 4


def draw(
    entry: ArchEntry, count: int, stream: tuple[int, ...] = ()
) -> list[tuple[ArchEntry, dict[str, float]]]:
    """Draw arches for an entry with `vary`: each arch, and the values of its keys that were drawn.

    Keys are drawn by the scheme of `vary` (`archfrag.arch.uncertain.sample`). What differs from
    joint to joint is drawn by plain random numbers, which are the same for the n-th sample of a
    seed whatever the number of samples: no design of a few points is even in as many coordinates
    as there are joints, and an arch averages over its joints. `stream` distinguishes the numbers
    of an entry from those of others. InputError if a value is beyond what its key allows.
    """
    from archfrag.arch.uncertain import sample

    vary = entry.vary
    assert vary is not None
    if len(entry.id) > LONGEST_ID:
        raise InputError(f"id must have at most {LONGEST_ID} characters where arches are drawn")
    marginals = {key: distribution.marginal() for key, distribution in vary.of.items()}
    seed = (vary.seed, *stream)
    values = sample(marginals, count, scheme=vary.scheme, seed=seed, correlation=vary.correlation)
    digits = max(_DIGITS, len(str(count)))
    plain = entry.model_dump(exclude_none=True, exclude={"vary"})
    n_joint = 0 if vary.joints is None else _n_joint(entry)
    drawn = []
    for i in range(count):
        given, shown = plain | {"id": f"{entry.id}-{i + 1:0{digits}d}"}, {}
        for key, distribution in vary.of.items():
            value = float(values[key][i])
            given[key] = _times(plain[key], value) if distribution.relative else value
            many = isinstance(given[key], list)
            shown[f"{key}_factor" if many else key] = value if many else given[key]
        if entry.joints and entry.embrace and "embrace" in vary.of:
            # Joints in degrees keep their parts of an angle of embrace that varies.
            ratio = given["embrace"] / entry.embrace
            given["joints"] = [*(joint * ratio for joint in entry.joints[:-1]), given["embrace"]]
        if vary.joints is not None:
            # Zeros behind a seed are the same seed to numpy: 1 separates joints from keys.
            generator = np.random.default_rng([*seed, i, 1])
            given |= _scatter(given, n_joint, vary.joints, generator)
        try:
            drawn.append((ArchEntry.model_validate(given), shown))
        except ValidationError as error:
            which = f"sample {i + 1} ({listed(shown)})"
            raise InputError(f"{which}: {first_message(error, given)}") from None
    return drawn


def listed(values: dict[str, float]) -> str:
    """What was drawn for an arch, in words."""
    return ", ".join(f"{name} = {value:.6g}" for name, value in values.items()) or "joints"


def _times(own: Any, factor: float) -> Any:
    if isinstance(own, list):
        return [_times(value, factor) for value in own]
    return float(f"{own * factor:.10g}")


def _scatter(
    given: dict[str, Any], n_joint: int, joints: JointScatter, generator: np.random.Generator
) -> dict[str, Any]:
    """Keys of an arch whose joints differ from each other."""
    from archfrag.arch.uncertain import to_digits

    drawn: dict[str, FloatArray] = {}
    # All are drawn, so that one key more leaves the others' numbers as they are.
    for name in JointScatter.model_fields:
        points = np.clip(generator.random(n_joint), 2.0**-32, 1.0 - 2.0**-32)
        distribution = getattr(joints, name)
        if distribution is not None:
            drawn[name] = to_digits(distribution.marginal().quantile(points))
    update: dict[str, Any] = {}
    if "friction" in drawn:
        product = np.broadcast_to(np.asarray(given["friction"], dtype=float), n_joint)
        update["friction"] = to_digits(product * drawn["friction"]).tolist()
    for side in ("intrados", "extrados"):
        if f"recess_{side}" in drawn:
            recess = update.get("recess", given.get("recess", {}))
            update["recess"] = recess | {side: drawn[f"recess_{side}"].tolist()}
    if "position" in drawn:
        update["joints"] = _shifted(given, drawn["position"])
    return update


def _shifted(given: dict[str, Any], shift: FloatArray) -> list[float]:
    """Positions of joints that are shifted by parts of a voussoir's length, the springings not."""
    end = float(given.get("embrace", 1.0))
    step = end / given["voussoirs"]
    equal = [*(step * j for j in range(given["voussoirs"])), end]
    place = np.asarray(given.get("joints", equal))
    inner = place[1:-1] + step * shift[1:-1]
    return [float(place[0]), *(float(f"{value:.12g}") for value in inner), float(place[-1])]


def _n_joint(entry: ArchEntry) -> int:
    if entry.voussoirs is not None:
        return entry.voussoirs + 1
    if entry.intrados is not None:
        return len(entry.intrados) - bool(entry.free_end)
    return 1 if entry.profile == "block" else entry.build().n_joint
