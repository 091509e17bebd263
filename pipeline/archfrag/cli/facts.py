"""Answers for one arch, as facts for scripts and as text for people."""

import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from archfrag.errors import InputError, StudyError
from archfrag.study.file.arches import ArchEntry
from archfrag.study.file.messages import first_message, option_path
from archfrag.study.file.schema import load_study
from archfrag.study.provenance import finite

if TYPE_CHECKING:
    from archfrag.arch import Arch
    from archfrag.simulate import Onset, Response

_SHOWN = 40  # entries of a log that fit a screen
_NAMES = 12  # of arches, in a message


def arch_of_study(path: Path, name: str | None) -> "Arch":
    """An arch of a study file; its only one if `name` is None."""
    # Of arches that each record has of its own, those of the first.
    entries = {entry.id: entry for entry in load_study(path).members(n_record=1).entries}
    if name is None and len(entries) == 1:
        return next(iter(entries.values())).build()
    if name not in entries:
        wanted = "--arch is missing" if name is None else f"--arch {name}: there is none"
        some, left = ", ".join(list(entries)[:_NAMES]), len(entries) - _NAMES
        more = f" and {left} more" if left > 0 else ""
        raise StudyError(f"{path}: {wanted}; the study has {some}{more}")
    return entries[name].build()


def arch_by_numbers(options: dict[str, Any]) -> "Arch":
    """An arch from the options of the command line, None where not given."""
    given = {key: value for key, value in options.items() if value is not None}
    if given.pop("straight"):
        given["sector"] = False
    given["id"] = "arch"
    if "drawing_unit" in given:
        given["unit"] = given.pop("drawing_unit")
    what = f"--profile {given['profile']}: "
    if "drawing" in given:
        del given["profile"]
        what = "--drawing: "
    try:
        return ArchEntry.model_validate(given).build()
    except ValidationError as error:
        how = "or take an arch of a study by --study STUDY --arch ID"
        message = first_message(error, given, option_path)
        raise InputError(f"{what}{message}; {how}") from error


def onset_facts(start: "Onset") -> dict[str, Any]:
    """Rest range [g] and mechanisms, ready for JSON."""
    names = ("stands", "plus", "minus", "hinges", "sliding", "hinges_minus", "sliding_minus")
    return finite({name: getattr(start, name) for name in names})


def onset_text(start: "Onset") -> str:
    """Rest range and mechanisms in short lines."""
    if not start.stands:
        return "does not stand under its own weight"
    lines = []
    for sense, value, hinges, sliding in (
        ("+x", start.plus, start.hinges, start.sliding),
        ("-x", start.minus, start.hinges_minus, start.sliding_minus),
    ):
        parts = [f"joint {joint} {side}" for joint, side in hinges]
        parts += [f"joint {joint} slides" for joint in sliding]
        how = f": {', '.join(parts)}" if parts else ""
        bears = "any acceleration" if math.isinf(value) else f"{value:.4f} g"
        lines.append(f"ground towards {sense}: moves from {bears}{how}")
    return "\n".join(lines)


def response_facts(response: "Response", scale: float) -> dict[str, Any]:
    """What one run did, ready for JSON."""
    names = (
        "collapsed", "collapse_time", "collapse_joint", "collapse_mode", "peak_rotation",
        "peak_displacement", "events", "model_time", "energy_error", "energy", "end_time",
        "work", "steps", "fallbacks", "residual", "method", "wall_time",
    )  # fmt: skip
    facts = {name: getattr(response, name) for name in names}
    if response.mechanism is not None:
        facts["mechanism"] = [asdict(change) for change in response.mechanism]
    return finite({"status": response.status.name.lower(), "scale": scale, **facts}, None)


def response_text(response: "Response", scale: float) -> str:
    """What one run did in short lines."""
    from archfrag.errors import STATUS_MESSAGE

    lines = [f"{response.status.name.lower()}: {STATUS_MESSAGE[response.status]}"]
    if response.collapsed:
        lines.append(
            f"collapse at {response.collapse_time:.3f} s by {response.collapse_mode} at joint "
            f"{response.collapse_joint}"
        )
    lines += [
        f"scale {scale:.6g}, end at {response.end_time:.3f} s",
        f"peak rotation {response.peak_rotation:.4g} rad, peak displacement "
        f"{response.peak_displacement:.4g} m",
        f"energy error {response.energy_error:.2g}, contact residual {response.residual:.2g}",
        f"{response.method}: {response.steps} steps in {response.wall_time:.2f} s",
        f"simulated time: {_listed(response.model_time, ' {:.3f} s')}",
        f"events: {_listed(response.events)}",
        f"work: {_listed(response.work)}",
    ]
    if response.mechanism is not None:
        from archfrag.simulation.response import summary

        left = len(response.mechanism) - _SHOWN
        lines += [summary(response.mechanism)]
        lines += [f"  {change}" for change in response.mechanism[:_SHOWN]]
        lines += [f"  ... and {left} more entries"] if left > 0 else []
    return "\n".join(lines)


def _listed(values: Mapping[str, float], form: str = " {}") -> str:
    """Values that are not zero."""
    shown = [
        name.replace("_", " ") + form.format(value) for name, value in values.items() if value
    ]
    return ", ".join(shown) or "none"
