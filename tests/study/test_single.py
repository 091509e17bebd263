"""One run reported to people and to scripts."""

import json

import numpy as np
import pytest

import archfrag as af
from archfrag.cli.facts import response_facts
from archfrag.study.provenance import strict_json

ARCH = af.Arch.circular(10.0, 1.5, 157.5, 5, 0.7)
PUSH = af.Motion(np.where(np.arange(800) < 250, 6.0, 0.0), 1e-3)


@pytest.fixture(scope="module")
def response():
    return af.simulate(ARCH, PUSH, history=True)


def test_facts_are_json_and_hold_the_log(response):
    facts = json.loads(strict_json(response_facts(response, 1.0)))
    assert facts["model_time"] == response.model_time
    assert facts["work"] == response.work
    assert len(facts["mechanism"]) == len(response.mechanism)
    last = facts["mechanism"][3]
    assert set(last) == {"time", "until", "cause", "joint", "model", "joints"}
    assert last["time"] == response.mechanism[3].time
    assert {int(k): v for k, v in last["joints"].items()} == response.mechanism[3].joints


def test_what_a_status_advises_can_be_given():
    """Options of the command, keys of a study, arguments of the function, or a method's name."""
    import inspect
    import re

    from archfrag.cli import main
    from archfrag.errors import STATUS_MESSAGE
    from archfrag.simulation.checks import method_names
    from archfrag.study.file.schema import Method

    known = {option.name for option in main.commands["simulate"].params}
    known &= {"method", *Method.model_fields} & set(inspect.signature(af.simulate).parameters)
    advised = set(re.findall(r"`(\w+)`", " ".join(STATUS_MESSAGE.values())))
    assert {"dt", "follow"} <= advised
    assert advised <= known | set(method_names())
