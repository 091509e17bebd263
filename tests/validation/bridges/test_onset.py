"""Onset of bridges of several spans: beside a programme written here, and by laws."""

import math

import numpy as np
import pytest

from archfrag.physics.state import model_of
from archfrag.physics.steps.run import rest_of
from tests.validation.bridges.chains import (
    Pier,
    arc,
    chain_of,
    onset_by_programme,
    random_bridge,
)

# Semicircles of 17 voussoirs, mean radius 2.5 m, 0.5 m thick, on piers of a width and a height:
# onset [g] of so many spans, by a programme that knows nothing of this one.
SPANS = 1, 2, 3, 4, 5, 8
EQUAL = {
    (1.0, 4.0): (0.286567, 0.206449, 0.188999, 0.181659, 0.178118, 0.173778),
    (1.5, 6.0): (0.286567, 0.215430, 0.204670, 0.200564, 0.198434, 0.195833),
    (2.0, 8.0): (0.286567, 0.223593, 0.216545, 0.213967, 0.212651, 0.211065),
    (1.0, 2.0): (0.286567, 0.261708, 0.256141, 0.254027, 0.253075, 0.252266),
    (1.5, 4.0): (0.286567, 0.262335, 0.257963, 0.256273, 0.255452, 0.254604),
}


def rest(*bridge, **given):
    """Return the range of rest of a bridge by archfrag's kernels: plus and minus [g]."""
    return rest_of(model_of(chain_of(*bridge, **given)))


def equal(spans, width, height, courses=4):
    """Return one of the bridges of `EQUAL`."""
    return [arc(2.5, 0.5, 17)] * spans, [Pier(width, height, courses)] * (spans - 1)


def compare(chain):
    """Assert that archfrag's range of rest is that of the programme."""
    theirs = [onset_by_programme(chain, sense) for sense in (1.0, -1.0)]
    assert np.isfinite(theirs).all()
    assert rest_of(model_of(chain)) == pytest.approx(theirs, abs=1e-8)


@pytest.mark.parametrize("shape", EQUAL)
def test_equal_spans(shape):
    for spans, expected in zip(SPANS, EQUAL[shape], strict=True):
        bridge = equal(spans, *shape)
        ours = rest(*bridge)
        assert ours == pytest.approx((expected, expected), abs=1e-6)
        chain = chain_of(*bridge)
        assert onset_by_programme(chain) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("friction", [math.inf, 0.6])
def test_random_bridges(friction):
    """Forty of unequal spans and piers."""
    generator = np.random.default_rng(54)
    for _ in range(40):
        compare(chain_of(**random_bridge(generator), friction=friction))


def test_long_viaducts():
    generator = np.random.default_rng(3)
    for spans in (12, 20, 30):
        compare(chain_of(**random_bridge(generator, spans)))


@pytest.mark.parametrize("wider", [10.0, 1000.0])
def test_wide_piers_leave_each_span_alone(wider):
    """Each span in turn is the thinnest, so that it decides."""
    rings = [(2.5, 9, 180.0), (3.5, 11, 172.0), (2.0, 7, 176.0)]
    piers = [Pier(1.5 * wider, 5.0), Pier(1.8 * wider, 4.0, 2)]
    for k in range(3):
        made = [
            arc(radius, radius * (0.2 if i == k else 0.3), voussoirs, embrace)
            for i, (radius, voussoirs, embrace) in enumerate(rings)
        ]
        assert rest(made, piers) == pytest.approx(rest([made[k]], []), rel=1e-6)


def test_mirror_images():
    generator = np.random.default_rng(7)
    for _ in range(10):
        given = random_bridge(generator)
        mirrored = {name: given[name][::-1] for name in given}
        mirrored["rings"] = [ring[::-1] * [-1.0, 1.0] for ring in mirrored["rings"]]
        ours = rest(**given, friction=0.6)
        assert rest(**mirrored, friction=0.6)[::-1] == pytest.approx(ours, rel=1e-9)


@pytest.mark.parametrize("courses", [1, 2, 9])
def test_courses_of_a_pier_do_not_matter(courses):
    ours = rest(*equal(3, 1.0, 4.0, courses))
    assert ours == pytest.approx(rest(*equal(3, 1.0, 4.0)), rel=1e-9)


def test_more_spans_and_higher_and_narrower_piers_start_earlier():
    onsets = [rest(*equal(spans, 1.2, 4.0))[0] for spans in (1, 2, 3, 4)]
    onsets += [rest(*equal(4, 1.2, 5.0))[0], rest(*equal(4, 1.0, 5.0))[0]]
    assert np.all(np.diff(onsets) < 0.0)


def test_a_chain_with_a_table_is_the_chain_without():
    chain = chain_of([arc(2.5, 0.5, 9)], [])
    j = np.arange(10)
    table = chain._replace(body=np.column_stack([j - 1, j]))
    assert rest_of(model_of(table)) == rest_of(model_of(chain))
