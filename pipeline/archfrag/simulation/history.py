"""Histories: arrays for the frames of a run, and the data set made of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from archfrag.arch import STANDARD_GRAVITY, Arch
from archfrag.mechanics.types import Frames

if TYPE_CHECKING:
    import xarray


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
    position, velocity, reaction = (
        values[:n_frame] for values in (frames.position, frames.velocity, frames.reaction)
    )
    middle = "moment of the reaction about the middle between the joint's contact points"
    table = (
        ("displacement", body, position[:, :, :2], "m", "displacement of the centroid from rest"),
        ("rotation", body[:2], position[:, :, 2], "rad", "rotation of the voussoir"),
        ("velocity", body, velocity[:, :, :2], "m s-1",
         "velocity of the centroid relative to the ground"),
        ("angular_velocity", body[:2], velocity[:, :, 2], "rad s-1",
         "angular velocity of the voussoir"),
        ("reaction", joint, reaction[:, :, :2], "N", "reaction on the voussoir after the joint"),
        ("moment", joint[:2], reaction[:, :, 2], "N m", middle),
    )  # fmt: skip
    variables = {
        name: (dimensions, values, {"units": units, "long_name": text})
        for name, dimensions, values, units, text in table
    }
    places = (arch.corner_name(0), arch.corner_name(1), "closed")
    slips = ("sticks", "slides_plus", "slides_minus")
    meanings = ["open", *(f"{place}_{slip}" for place in places for slip in slips)]
    mode = {
        "long_name": "contact mode of the joint",
        "flag_values": np.arange(10, dtype=np.int8),
        "flag_meanings": " ".join(meanings),
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
