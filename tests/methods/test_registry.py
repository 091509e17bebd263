"""Every method is described, and all are called alike."""

import inspect

import numpy as np
import pytest

import archbench  # noqa: F401  registers the baselines
import archfrag as af
from archfrag.errors import InputError
from archfrag.methods.registry import known_methods
from archfrag.simulation.checks import is_available, own_parameters

SIGNATURE = [
    "chain", "grounds", "factor", "position", "velocity", "from_rest", "options", "frames", "log"
]  # fmt: skip
STILL = af.Motion(np.zeros(3), 0.01)
BLOCK = af.Block(1.0, 2.0, friction=0.6)


@pytest.mark.parametrize(("name", "info"), known_methods().items())
def test_every_method_has_the_common_signature_and_is_named_in_its_response(name, info):
    run = info.load()
    parameters = list(inspect.signature(getattr(run, "py_func", run)).parameters)
    assert parameters == [*SIGNATURE, *own_parameters(info)]
    if is_available(info):
        assert af.simulate(BLOCK, STILL, method=name).method == name


def test_a_setting_that_the_method_does_not_have_is_named():
    with pytest.raises(InputError, match=r"'stifness'"):
        af.simulate(BLOCK, STILL, settings={"stifness": 1.0})
