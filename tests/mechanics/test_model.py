"""Shapes of what kernels take."""

import numpy as np
import pytest

import archfrag as af
from archfrag.mechanics.model import (
    MODEL_SHAPES,
    STATE_SHAPES,
    WORK_SHAPES,
    model_of,
    new_state,
    new_work,
)

CHAINS = [af.Arch.circular(10.0, 1.5, 157.5, 7, 0.7).chain, af.Block(0.6, 1.8, friction=0.4).chain]


@pytest.mark.parametrize("chain", CHAINS)
def test_shapes_compiled_for_are_those_of_the_arrays(chain):
    model = model_of(chain)
    given = model, new_state(model), new_work(model)
    for arrays, shapes in zip(given, (MODEL_SHAPES, STATE_SHAPES, WORK_SHAPES), strict=True):
        for name, array, shape in zip(arrays._fields, arrays, shapes, strict=True):
            assert np.shape(array)[1:] == shape, name
            assert not shape or array.flags.c_contiguous, name
