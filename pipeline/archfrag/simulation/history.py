"""Histories: space for the frames of a run, and the labelled data set made of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from archfrag.arch import STANDARD_GRAVITY, Arch
from archfrag.mechanics.types import Frames

if TYPE_CHECKING:
    import xarray

_TEXT = {
    "displacement": ("m", "displacement of the centroid from rest"),
    "rotation": ("rad", "rotation of the voussoir"),
    "velocity": ("m s-1", "velocity of the centroid relative to the ground"),
    "angular_velocity": ("rad s-1", "angular velocity of the voussoir"),
    "reaction": ("N", "reaction on the voussoir after the joint"),
    "moment": (
        "N m",
        "moment of the reaction about the middle between the joint's contact points",
    ),
}


def empty_frames(n_frame: int, n_body: int, n_joint: int) -> Frames:
    """Space for so many frames."""
    return Frames(
        time=np.zeros(n_frame),
        position=np.zeros((n_frame, n_body, 3)),
        velocity=np.zeros((n_frame, n_body, 3)),
        reaction=np.zeros((n_frame, n_joint, 3)),
        mode=np.zeros((n_frame, n_joint), np.int8),
    )


def history_of(arch: Arch, frames: Frames, n_frame: int) -> xarray.Dataset:
    """The frames that were written, with names and units; along time, voussoir, joint, component.

    All of a frame belongs to one instant. Event-driven methods evaluate it there; time stepping
    writes it where a step sets out, with the velocities between those half a step before and
    after and the mean reactions over that time; the baselines on the velocity level write the
    middles of their steps. At an impact velocities and reactions of steps are means across it.
    """
    import xarray

    body, joint = ("time", "voussoir", "component"), ("time", "joint", "component")
    arrays = {
        "displacement": (body, frames.position[:n_frame, :, :2]),
        "rotation": (body[:2], frames.position[:n_frame, :, 2]),
        "velocity": (body, frames.velocity[:n_frame, :, :2]),
        "angular_velocity": (body[:2], frames.velocity[:n_frame, :, 2]),
        "reaction": (joint, frames.reaction[:n_frame, :, :2]),
        "moment": (joint[:2], frames.reaction[:n_frame, :, 2]),
    }
    variables = {
        name: (*arrays[name], {"units": units, "long_name": long_name})
        for name, (units, long_name) in _TEXT.items()
    }
    mode = {
        "long_name": "contact mode of the joint",
        "flag_values": np.arange(10, dtype=np.int8),
        "flag_meanings": _mode_meanings(arch),
    }
    dataset = xarray.Dataset(
        variables | {"contact_mode": (joint[:2], frames.mode[:n_frame], mode)},
        coords={
            "time": ("time", frames.time[:n_frame], {"units": "s", "long_name": "time"}),
            "voussoir": np.arange(arch.n_voussoir),
            "joint": np.arange(arch.n_joint),
            "component": ["x", "y"],
        },
    )
    dataset.attrs["gravity"] = STANDARD_GRAVITY
    return dataset


def _mode_meanings(arch: Arch) -> str:
    places = [arch.corner_name(0), arch.corner_name(1), "closed"]
    slips = ("sticks", "slides_plus", "slides_minus")
    return " ".join(["open", *(f"{place}_{slip}" for place in places for slip in slips)])
