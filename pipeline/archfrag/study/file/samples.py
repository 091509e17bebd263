"""Arches drawn for an entry with `vary`: keys by a design of points, joints one by one."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from archfrag.errors import InputError
from archfrag.study.file.arches import ArchEntry, Recess
from archfrag.study.file.messages import first_message
from archfrag.study.file.vary import JointScatter

FloatArray = NDArray[np.float64]
LONGEST_ID = 70  # of an entry whose arches get its id with a number behind it
_DIGITS = 4


def draw(
    entry: ArchEntry, count: int, stream: tuple[int, ...] = ()
) -> list[tuple[ArchEntry, dict[str, float]]]:
    """Draw arches for an entry with `vary`.

    Keys are drawn by the scheme of `vary` (`archfrag.arch.uncertain.sample`). What differs from
    joint to joint is drawn by plain random numbers, the same for the n-th sample of a seed
    whatever their number: it has as many coordinates as joints, in which no design of some
    points is even, and an arch averages over its joints.

    Parameters
    ----------
    entry : ArchEntry
        From no drawing and no table.
    count : int
    stream : tuple of int
        Integers that distinguish its random numbers from those of other entries.

    Returns
    -------
    list of (ArchEntry, dict)
        Each arch, and the values of its keys that were drawn.

    Raises
    ------
    InputError
        If the id is too long, or a value is beyond what its key allows.
    """
    from archfrag.arch.uncertain import sample

    vary = entry.vary
    assert vary is not None
    if len(entry.id) > LONGEST_ID:
        raise InputError(f"id must have at most {LONGEST_ID} characters where arches are drawn")
    marginals = {key: distribution.marginal() for key, distribution in vary.of.items()}
    seed = (vary.seed, *stream)
    values = sample(
        marginals, count, scheme=vary.scheme, seed=seed, correlation=vary.correlation
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
            many = isinstance(update[key], list)
            shown[f"{key}_factor" if many else key] = value if many else update[key]
        if entry.joints and "embrace" in update and entry.embrace:
            # Joints in degrees keep their parts of an angle of embrace that varies.
            ratio = update["embrace"] / entry.embrace
            joints = [joint * ratio for joint in entry.joints[:-1]]
            update["joints"] = [*joints, update["embrace"]]
        arch = entry.model_copy(update=update)
        if vary.joints is not None:
            # Zeros behind a seed are the same seed to numpy: 1 separates joints from keys.
            generator = np.random.default_rng([*seed, i, 1])
            arch = arch.model_copy(update=_scatter(arch, vary.joints, generator))
        _check_bounds(arch, i + 1, shown)
        drawn.append((arch, shown))
    return drawn


def listed(values: dict[str, float]) -> str:
    """What was drawn for an arch, in words."""
    return ", ".join(f"{name} = {value:.6g}" for name, value in values.items()) or "joints"


def _check_bounds(entry: ArchEntry, number: int, values: dict[str, float]) -> None:
    """See that what was drawn is within what a study file may give."""
    given = entry.parameters
    try:
        ArchEntry.model_validate(given)
    except ValidationError as error:
        which = f"sample {number} ({listed(values)})"
        raise InputError(f"{which}: {first_message(error, given)}") from None


def _times(own: Any, factor: float) -> Any:
    if isinstance(own, list):
        return [float(f"{value * factor:.10g}") for value in own]
    return float(f"{own * factor:.10g}")


def _scatter(
    entry: ArchEntry, joints: JointScatter, generator: np.random.Generator
) -> dict[str, Any]:
    """Keys of an arch whose joints differ from each other."""
    from archfrag.arch.uncertain import to_digits

    n_joint = _n_joint(entry)
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
        update["friction"] = to_digits(product * drawn["friction"]).tolist()
    ends = {side: drawn.get(f"recess_{side}") for side in ("intrados", "extrados")}
    depths = {side: depth.tolist() for side, depth in ends.items() if depth is not None}
    if depths:
        update["recess"] = (entry.recess or Recess()).model_copy(update=depths)
    if "position" in drawn:
        update["joints"] = _shifted(entry, drawn["position"])
    return update


def _shifted(entry: ArchEntry, shift: FloatArray) -> list[float]:
    """Positions of joints that are shifted by parts of a voussoir's length, the springings not."""
    assert entry.voussoirs is not None
    end = float(entry.embrace or 1.0)
    step = end / entry.voussoirs
    equal = [*(step * j for j in range(entry.voussoirs)), end]
    place = np.asarray(entry.joints or equal)
    inner = place[1:-1] + step * shift[1:-1]
    return [float(place[0]), *(float(f"{value:.12g}") for value in inner), float(place[-1])]


def _n_joint(entry: ArchEntry) -> int:
    if entry.voussoirs is not None:
        return entry.voussoirs + 1
    if entry.intrados is not None:
        return len(entry.intrados) - bool(entry.free_end)
    return 1 if entry.profile == "block" else entry.build().n_joint
