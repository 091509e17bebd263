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


@pytest.mark.parametrize("name", known_methods())
class TestEveryMethod:
    def test_loads_a_kernel_of_the_common_signature(self, name):
        run = known_methods()[name].load()
        parameters = list(inspect.signature(getattr(run, "py_func", run)).parameters)
        assert parameters == [*SIGNATURE, *own_parameters(known_methods()[name])]

    def test_parameters_have_names_of_their_own_units_and_positive_defaults(self, name):
        parameters = known_methods()[name].parameters
        names = [parameter.name for parameter in parameters]
        assert len(set(names)) == len(names) > 0
        arguments = inspect.signature(af.simulate).parameters
        own = own_parameters(known_methods()[name])
        for parameter in parameters:
            assert parameter.name in arguments or parameter.name in own
            assert parameter.least <= parameter.default <= parameter.most
            assert parameter.unit
            assert parameter.meaning


class TestRegistry:
    def test_response_names_the_method_that_ran(self):
        for name in filter(lambda name: is_available(known_methods()[name]), known_methods()):
            assert af.simulate(BLOCK, STILL, method=name).method == name

    def test_a_setting_that_the_method_does_not_have_is_named(self):
        with pytest.raises(InputError, match=r"'stifness'"):
            af.simulate(BLOCK, STILL, settings={"stifness": 1.0})
