"""How far the mechanism of onset can rotate before the weight no longer brings it back."""

import numpy as np
import pytest
from scipy.optimize import fsolve, minimize_scalar

import archfrag as af
from archfrag.simulation.static_limit import static_limit


def test_of_an_arch_it_is_where_the_potential_energy_of_the_linkage_is_largest():
    arch = af.Arch.circular(10.0, 1.5, 157.5, 12, friction=0.7)
    start = af.onset(arch)
    corner = {"intrados": arch.intrados, "extrados": arch.extrados}
    a, b, c, d = (corner[side][joint] for joint, side in start.hinges)
    joints = [joint for joint, _ in start.hinges]

    def rotate(vector, angle):
        return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ vector

    def angles(first):
        def closing(two):
            ends = rotate(b - a, first) + rotate(c - b, two[0]) + rotate(d - c, two[1])
            return ends - (d - a)

        # The hinges of this arch rotate its middle bar in the opposite sense.
        return np.array([first, *fsolve(closing, [-first, first])])

    def energy(first):
        rotation = angles(first)
        knees = [a, a + rotate(b - a, rotation[0]), d - rotate(d - c, rotation[2])]
        return sum(
            arch.chain.mass[i] * (knee + rotate(arch.chain.centroid[i] - pivot, angle))[1]
            for knee, pivot, angle, low, high in zip(
                knees, (a, b, c), rotation, joints, joints[1:]
            )
            for i in range(low, high)
        )

    sense = 1.0 if energy(1e-4) > energy(-1e-4) else -1.0
    top = minimize_scalar(
        lambda x: -energy(sense * x), bounds=(0.0, 0.3), method="bounded", options={"xatol": 1e-9}
    )
    expected = np.abs(angles(sense * top.x)).max()
    assert static_limit(arch, start) == pytest.approx(expected, rel=1e-4)


def test_a_mechanism_that_slides_has_none():
    block = af.Block(width=1.0, height=1.0, friction=0.2)
    assert np.isnan(static_limit(block, af.onset(block)))
