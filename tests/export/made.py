"""Curves made up for the tests of exports, and the lognormal law written once more."""

import math

import numpy as np

from archfrag.export.writers import CurveSet
from archfrag.fragility.curve import Curve

MADE = {
    "study": "my.study",
    "title": 'A "title" <with> & -- signs\x0b',
    "archfrag": "0.1.0",
    "archfrag_commit": "abc",
    "cube_archfrag_commit": "def",
    "cube_sha256": "0" * 64,
}
STATES = ("rocking", "damage", "collapse")


def fragility(theta, beta):
    """A curve with some covariance."""
    covariance = np.array([[4e-3, 1e-3], [1e-3, 3e-3]])
    return Curve(theta, beta, covariance, -10.0, 9, 54, "stripes")


def curve_set(measure="PGA", *, states=STATES, left_out=(), **changed):
    """Two arches with three limit states, medians around 4 [SI]."""
    curves = {
        arch: {
            state: fragility(theta * factor, beta)
            for state, factor in zip(states, (0.4, 0.7, 1.0))
        }
        for arch, theta, beta in (("ring-7", 4.0, 0.45), ("wall+2", 3.1, 0.3))
    }
    return CurveSet(curves | changed, dict(left_out), measure, (1.0, 8.0), MADE)


def lognormal(im, theta, beta):
    """Probability of exceedance, by the error function of the standard library."""
    return 0.5 * math.erfc(-math.log(im / theta) / (beta * math.sqrt(2.0)))
