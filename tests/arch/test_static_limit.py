"""How far the mechanism of onset can rotate before the weight no longer brings it back."""

import numpy as np
import pytest
from scipy.optimize import fsolve, minimize_scalar

import archfrag as af
from archfrag.simulation.rest import static_limit


def test_of_an_arch_it_is_where_the_potential_energy_of_the_linkage_is_largest():
    arch = af.Arch.circular(10.0, 1.5, 157.5, 12, friction=0.7)
    start = af.onset(arch)
    corner = {"intrados": arch.intrados, "extrados": arch.extrados}
    a, b, c, d = (corner[side][joint] @ [1, 1j] for joint, side in start.hinges)
    joints, centroid = [joint for joint, _ in start.hinges], arch.chain.centroid @ [1, 1j]

    def angles(first):
        def closing(two):
            bars = np.exp(1j * np.array([first, *two])) @ [b - a, c - b, d - c]
            return [(bars - d + a).real, (bars - d + a).imag]

        # The hinges of this arch rotate its middle bar in the opposite sense.
        return np.array([first, *fsolve(closing, [-first, first])])

    def energy(first):
        turn = np.exp(1j * angles(first))
        knees = [a, a + turn[0] * (b - a), d - turn[2] * (d - c)]
        return sum(
            arch.chain.mass[i] * (knee + factor * (centroid[i] - pivot)).imag
            for knee, pivot, factor, low, high in zip(knees, (a, b, c), turn, joints, joints[1:])
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
