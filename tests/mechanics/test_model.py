"""Shapes of what kernels take."""

import numpy as np
import pytest

import archfrag as af
from archfrag.mechanics.compile import kernel
from archfrag.mechanics.model import model_of, new_state, new_work, with_shapes

CHAINS = [af.Arch.circular(10.0, 1.5, 157.5, 7, 0.7).chain, af.Block(0.6, 1.8, friction=0.4).chain]


@kernel
def shapes_known(model, state, work):
    return with_shapes(model, state, work)


@pytest.mark.parametrize("chain", CHAINS)
def test_shapes_told_to_the_compiler_are_those_of_the_arrays(chain):
    model = model_of(chain)
    given = model, new_state(model), new_work(model)
    for before, after in zip(given, shapes_known(*given), strict=True):
        for name, one, other in zip(before._fields, before, after, strict=True):
            assert np.shape(other) == np.shape(one), name
            assert not np.ndim(one) or other.strides == one.strides, name
