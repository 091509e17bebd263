"""What a trial stage of a rejected step leaves behind reaches nothing."""

import numpy as np
import pytest

import archfrag as af
from tests.physics.audit import g


# Time stepping collapses from 0.6038 g on.
@pytest.mark.parametrize(
    ("amplitude", "tolerance"), [(0.4906183863126449, 1e-4), (0.593843, 1e-4), (0.593843, 1e-5)]
)
def test_slips_of_a_rejected_stage_are_not_handed_to_time_stepping(amplitude, tolerance):
    arch = af.Arch.circular(10.0, 1.5, 157.5, 27, 0.7)
    acceleration = np.zeros(4003)
    acceleration[:4000] = g
    run = af.simulate(
        arch, af.Motion(acceleration, 1e-4), amplitude, method="event_driven", rtol=tolerance
    )
    assert run.collapsed is False
