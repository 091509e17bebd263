"""The examples in the documentation of what `archfrag` offers run and give what they say."""

import doctest
import importlib
import inspect

import pytest

import archfrag as af

MODULES = (
    "archfrag.arch.model",
    "archfrag.arch.block",
    "archfrag.fragility.deaggregate",
    "archfrag.fragility.fit",
    "archfrag.kernel_cache",
    "archfrag.methods.registry",
    "archfrag.motions.motion",
    "archfrag.motions.read",
    "archfrag.simulate",
    "archfrag.simulation.mechanism",
    "archfrag.simulation.rest",
)
FUNCTIONS = ("Block", "Motion", "fit_ida", "fit_stripes", "onset", "read_motion", "simulate")


@pytest.mark.parametrize("name", MODULES)
def test_examples_hold(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = doctest.testmod(importlib.import_module(name))
    assert result.attempted > 0
    assert result.failed == 0


@pytest.mark.parametrize("name", FUNCTIONS)
def test_public_function_has_an_example(name):
    assert ">>>" in inspect.getdoc(getattr(af, name))
