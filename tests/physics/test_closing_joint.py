"""A corner that closes and opens again within a step is seen; none is closed by moving it."""

from types import SimpleNamespace

import numpy as np
import pytest

import archfrag as af
from archfrag.mechanics.mechanism import (
    assemble_mechanism,
    farthest_regrouped,
    gather_state,
    new_mechanism,
)
from archfrag.methods.events import may_have_closed

ARCH = af.Arch.circular(10.0, 1.5, 157.5, 7, 0.7)


class TestSuspicion:
    """Gap and rate at both ends of a step against a parabola in between."""

    @pytest.mark.parametrize(("least", "suspect"), [(-1e-3, True), (-1e-6, True), (0.5, False)])
    def test_a_parabola_that_dips_is_suspected(self, least, suspect):
        # gap(t) = least + (t - 0.4)**2 over a step of 1 s.
        few = SimpleNamespace(work=SimpleNamespace(mode=np.array([1], np.int8)))
        first = np.array([[[np.inf, np.inf], [least + 0.16, -0.8]]])
        last = np.array([[[np.inf, np.inf], [least + 0.36, 1.2]]])
        margins = SimpleNamespace(low_gap=first, gap=last)
        assert may_have_closed.py_func(few, margins, 1.0) == suspect

    def test_one_that_only_opens_is_not(self):
        few = SimpleNamespace(work=SimpleNamespace(mode=np.array([1], np.int8)))
        first = np.array([[[np.inf, np.inf], [0.0, 0.1]]])
        last = np.array([[[np.inf, np.inf], [0.2, 0.3]]])
        margins = SimpleNamespace(low_gap=first, gap=last)
        assert not may_have_closed.py_func(few, margins, 1.0)


class TestRegrouping:
    def test_is_measured_as_the_farthest_move_of_a_voussoir(self):
        chain = ARCH.chain
        length = np.full(8, 1.5)
        mode = np.full(8, 7, np.int8)
        mode[[0, 2, 4, 7]] = (4, 1, 4, 1)
        mechanism = new_mechanism(7, 8)
        n, _ = assemble_mechanism(chain, mode, np.zeros(8), length, mechanism)
        assert n == 3
        position, velocity = np.zeros((7, 3)), np.zeros((7, 3))
        position[:, :2] = chain.centroid
        mega, speed = np.zeros((7, 3)), np.zeros((7, 3))
        gather_state(chain, mechanism, position, velocity, mega, speed)
        assert farthest_regrouped(mechanism, 1.5, mega, position) < 1e-14
        # The second voussoir of a mega-voussoir, turned against the first.
        position[1, 2] += 1e-3
        gather_state(chain, mechanism, position, velocity, mega, speed)
        assert farthest_regrouped(mechanism, 1.5, mega, position) == pytest.approx(1.5e-3)
