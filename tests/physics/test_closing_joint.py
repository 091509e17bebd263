"""A corner that closes and opens again within a step is seen; none is closed by moving it."""

import numpy as np
import pytest

import archfrag as af
from archfrag.mechanics.mega_voussoirs.assemble import (
    assemble,
    farthest_move,
    gather_state,
    new_mega_voussoirs,
    split_state,
)
from archfrag.mechanics.model import model_of
from tests.mechanics.adapters import CLOSED, Mode, framed, set_modes, views_of

ARCH = af.Arch.circular(10.0, 1.5, 157.5, 7, 0.7)
g = 9.80665


class TestRegrouping:
    def test_is_measured_as_the_farthest_move_of_a_voussoir(self):
        model, touch, slide = model_of(ARCH.chain), np.zeros((8, 2)), np.zeros(8)
        corners = {0: (1,), 2: (0,), 4: (1,), 7: (0,)}
        modes = [Mode(corners[j]) if j in corners else CLOSED for j in range(8)]
        set_modes(modes, touch, slide)
        mega = new_mega_voussoirs(model)
        assemble(model, touch, slide, np.zeros(8), mega)
        mega = views_of(mega)
        assert mega.count[0] == 3

        def moved(position):
            still, place, speed = np.zeros((3, *position.shape))
            gather_state(model, position, still, mega)
            split_state(mega, mega.position, mega.velocity, place, speed)
            return farthest_move(model, position, place)

        position = framed(np.column_stack([ARCH.chain.centroid, np.zeros(7)]))
        assert moved(position) < 1e-14
        # The second voussoir of a mega-voussoir, rotated against the first.
        position[2, 2] += 1e-3
        assert moved(position) == pytest.approx(1.5e-3)
