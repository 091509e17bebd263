"""Samples of parameters that are not known exactly: marginals, designs of points."""

import numpy as np
import pytest
from scipy import stats

from archfrag.study.file.arches import Vary
from archfrag.study.file.members import sample

# A distribution as a study gives it, and the one of scipy that it is to be.
MARGINALS = {
    "normal": ({"mean": 1.5, "cov": 0.2}, stats.norm(1.5, 0.3)),
    "lognormal": ({"median": 0.7, "beta": 0.4}, stats.lognorm(0.4, scale=0.7)),
    "uniform": ({"start": -1.0, "stop": 3.0}, stats.uniform(-1.0, 4.0)),
    "triangular": ({"start": 0.0, "mode": 0.2, "stop": 1.0}, stats.triang(0.2)),
    "normal cut": (
        {"mean": 1.5, "sd": 0.3, "lower": 1.2, "upper": 2.4},
        stats.truncnorm(-1.0, 3.0, 1.5, 0.3),
    ),
}


@pytest.mark.parametrize("name", MARGINALS)
@pytest.mark.parametrize("scheme", ["sobol", "latin_hypercube"])
def test_samples_have_mean_and_deviation_of_their_distribution(name, scheme):
    given, other = MARGINALS[name]
    own = {"distribution": name.split()[0], **given}
    values = sample(Vary(samples=1024, scheme=scheme, of={"x": own}), [7])["x"]
    assert values.mean() == pytest.approx(other.mean(), abs=2e-3 * other.std())
    assert values.std() == pytest.approx(other.std(), rel=0.01)


def unit_points(count, scheme):
    uniform = {"distribution": "uniform", "start": 0.0, "stop": 1.0}
    vary = Vary(samples=count, scheme=scheme, of=dict.fromkeys("abc", uniform))
    return np.array(list(sample(vary, [3]).values())).T


@pytest.mark.parametrize("scheme", ["sobol", "latin_hypercube"])
def test_each_slice_of_each_coordinate_has_one_point(scheme):
    points = unit_points(64, scheme)
    for coordinate in np.floor(points * 64).astype(int).T:
        assert sorted(coordinate) == list(range(64))
    assert 0.0 < points.min() < points.max() < 1.0
    if scheme == "sobol":  # they stay when more are asked for
        for count in (1, 4, 32):
            np.testing.assert_array_equal(unit_points(count, scheme), points[:count])
