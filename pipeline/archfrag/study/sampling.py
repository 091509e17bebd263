"""The arches that are drawn for an entry whose parameters are not known exactly."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from archfrag.errors import InputError
from archfrag.study.arches import Chain, FromJoints, Polygons, Recess, Ring
from archfrag.study.section import first_message
from archfrag.study.vary import JointScatter

FloatArray = NDArray[np.float64]
LONGEST_ID = 70  # of an entry whose arches get its id with a number behind it
_DIGITS = 4


def draw(
    entry: Chain, count: int, stream: tuple[int, ...] = ()
) -> list[tuple[Chain, dict[str, float]]]:
    """Arches drawn for an entry with `vary`, and the values of its keys that were drawn.

    Keys are drawn by the scheme of `vary` (`archfrag.arch.uncertain.sample`). What differs from
    joint to joint is drawn by plain random numbers, the same for the n-th sample of a seed
    whatever their number: it has as many coordinates as joints, in which no design of some
    points is even, and an arch averages over its joints.
    """
    from archfrag.arch.uncertain import sample

    vary = entry.vary
    assert vary is not None
    if len(entry.id) > LONGEST_ID:
        raise InputError(f"id must have at most {LONGEST_ID} characters where arches are drawn")
    values = sample(
        {key: distribution.marginal() for key, distribution in vary.of.items()},
        count,
        scheme=vary.scheme,
        seed=(vary.seed, *stream),
        correlation=vary.correlation,
    )
    digits = max(_DIGITS, len(str(count)))
    drawn = []
    for i in range(count):
        update: dict[str, Any] = {"id": f"{entry.id}-{i + 1:0{digits}d}", "vary": None}
        shown = {}
        for key, distribution in vary.of.items():
            value = float(values[key][i])
            own = getattr(entry, key)
            update[key] = _times(own, value) if distribution.relative else value
            many = isinstance(update[key], tuple)
            shown[f"{key}_factor" if many else key] = value if many else update[key]
        _stretch_joints(entry, update)
        concrete = entry.model_copy(update=update)
        if vary.joints is not None:
            # Zeros behind a seed are the same seed to numpy: 1 separates joints from keys.
            generator = np.random.default_rng([vary.seed, *stream, i, 1])
            concrete = concrete.model_copy(update=_scatter(concrete, vary.joints, generator))
        _check_bounds(concrete, i + 1, shown)
        drawn.append((concrete, shown))
    return drawn


def _check_bounds(entry: Chain, number: int, values: dict[str, float]) -> None:
    """See that what was drawn is within what a study file may give."""
    given = entry.model_dump()
    try:
        type(entry).model_validate(given)
    except ValidationError as error:
        raise InputError(
            f"sample {number} ({listed(values)}): {first_message(error, given)}"
        ) from None


def listed(values: dict[str, float]) -> str:
    """What was drawn for an arch, in words."""
    return ", ".join(f"{name} = {value:.6g}" for name, value in values.items()) or "joints"


def _times(own: Any, factor: float) -> Any:
    if isinstance(own, tuple):
        return tuple(float(f"{value * factor:.10g}") for value in own)
    return float(f"{own * factor:.10g}")


def _stretch_joints(entry: Chain, update: dict[str, Any]) -> None:
    """Joints that are given in degrees keep their parts of an angle of embrace that varies."""
    joints = getattr(entry, "joints", None)
    if joints and "embrace" in update:
        ratio = update["embrace"] / getattr(entry, "embrace")  # noqa: B009
        update["joints"] = (*(joint * ratio for joint in joints[:-1]), update["embrace"])


def _scatter(entry: Chain, joints: JointScatter, generator: np.random.Generator) -> dict[str, Any]:
    """Keys of an arch whose joints differ from each other."""
    from archfrag.arch.uncertain import to_digits

    n_joint = _joints(entry)
    drawn: dict[str, FloatArray] = {}
    # All are drawn, so that one key more leaves the others' numbers as they are.
    for name in JointScatter.model_fields:
        points = np.clip(generator.random(n_joint), 2.0**-32, 1.0 - 2.0**-32)
        distribution = getattr(joints, name)
        if distribution is not None:
            drawn[name] = to_digits(distribution.marginal().quantile(points))
    update: dict[str, Any] = {}
    if "friction" in drawn:
        product = np.broadcast_to(np.asarray(entry.friction, dtype=float), n_joint)
        update["friction"] = tuple(to_digits(product * drawn["friction"]).tolist())
    ends = {side: drawn.get(f"recess_{side}") for side in ("intrados", "extrados")}
    if any(depth is not None for depth in ends.values()):
        own = entry.recess or Recess()
        update["recess"] = own.model_copy(
            update={k: tuple(v.tolist()) for k, v in ends.items() if v is not None}
        )
    if "position" in drawn:
        update["joints"] = _shifted(entry, drawn["position"])
    return update


def _shifted(entry: Chain, shift: FloatArray) -> tuple[float, ...]:
    """Positions of joints that are shifted by parts of a voussoir's length, the springings not."""
    assert isinstance(entry, Ring)
    end = float(getattr(entry, "embrace", 1.0))
    step = end / entry.voussoirs
    equal = (*(step * j for j in range(entry.voussoirs)), end)
    place = np.asarray(entry.joints or equal)
    inner = place[1:-1] + step * shift[1:-1]
    return (float(place[0]), *(float(f"{value:.12g}") for value in inner), float(place[-1]))


def _joints(entry: Chain) -> int:
    if isinstance(entry, Ring):
        return entry.voussoirs + 1
    if isinstance(entry, FromJoints):
        return len(entry.intrados) - entry.free_end
    if isinstance(entry, Polygons):
        return entry.build().n_joint
    return 1
