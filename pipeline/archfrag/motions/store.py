"""Motions as one file that a worker can read without obspy."""

import json
import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from archfrag.errors import InputError
from archfrag.files import replacing
from archfrag.motions.motion import Motion

FORMAT = "archfrag motions 1"


def save_motions(path: str | Path, motions: Sequence[Motion]) -> None:
    """Write motions to one file, complete or not at all; the same motions give the same bytes.

    A numpy archive with, for each motion, its samples as float64 and, for all, one JSON text.
    InputError if the metadata of a motion are not JSON, OutputError if it cannot be written.
    """
    arrays: dict[str, np.ndarray] = {}
    table = []
    for number, motion in enumerate(motions):
        arrays[f"horizontal_{number}"] = motion.acceleration
        if motion.vertical is not None:
            arrays[f"vertical_{number}"] = motion.vertical
        entry = {"id": motion.id, "dt": motion.dt, "log": motion.log, "metadata": motion.metadata}
        try:
            table.append(json.dumps(entry, allow_nan=True, sort_keys=True))
        except (TypeError, ValueError) as error:
            name = motion.id or f"motion {number}"
            raise InputError(f"{name}: metadata cannot be stored as JSON ({error})") from None
    text = json.dumps({"format": FORMAT, "motions": table})
    arrays["table"] = np.frombuffer(text.encode(), dtype=np.uint8)
    with replacing(Path(path), lasting=False) as part, open(part, "wb") as file:
        np.savez(file, allow_pickle=False, **arrays)  # type: ignore[arg-type]


def load_motions(path: str | Path) -> list[Motion]:
    """Read the motions that `save_motions` wrote, in their order.

    InputError if the file is missing, damaged or something else.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            header = json.loads(archive["table"].tobytes().decode())
            if header["format"] != FORMAT:
                raise ValueError(f"format {header['format']!r}")
            motions = []
            for number, entry in enumerate(map(json.loads, header["motions"])):
                name = f"vertical_{number}"
                vertical = archive[name] if name in archive.files else None
                about = {key: entry[key] for key in ("dt", "id", "metadata", "log")}
                motions.append(
                    Motion(archive[f"horizontal_{number}"], vertical=vertical, **about)
                )
            return motions
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file of motions") from None
    except (OSError, ValueError, KeyError, TypeError, zipfile.BadZipFile) as error:
        raise InputError(
            f"{path}: not a file of motions written by archfrag, or damaged ({error})"
        ) from None
