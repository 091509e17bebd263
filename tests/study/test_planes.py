"""Planes of a study's cube: which measures its runs have, their units, and the best of several."""

import numpy as np
import pytest

from archfrag.errors import FitError, InputError
from archfrag.fragility.curve import Curve
from archfrag.study.answer.compare import plane_of
from archfrag.study.answer.curves import Fitted
from archfrag.study.file.schema import Intensity
from tests.report import synthetic

N = 24
G = 9.80665


LEVELS = Intensity(measure="PGA", unit="g", levels=[0.1, 0.2])  # its unit alone is read


@pytest.fixture(scope="module")
def fitted():
    """Collapse by Arias intensity more than by PGA; PGV is PGA times a constant."""
    data = synthetic.cube(("ring",), synthetic.motions(N), n_level=15)
    generator = np.random.default_rng(4)
    pga = np.exp(0.5 * generator.standard_normal(N))
    s = generator.standard_normal(N)
    values = {
        "PGA": pga,
        "PGV": 0.1 * pga,
        "Arias": pga**2 * np.exp(s),
        "Sa(1)": pga * np.exp(generator.standard_normal(N)),
        "D5_95": 1.0 + pga,
    }
    capacity = 4.0 * np.exp(0.25 * generator.standard_normal(N) - 0.4 * s)
    verdict = (capacity[:, None] < data["intensity"].values).astype(np.int8)[None]
    data = data.assign(
        verdict=(data["verdict"].dims, verdict),
        measure=list(values),
        record_measure=(("record", "measure"), np.column_stack(list(values.values()))),
        measure_exponent=("measure", [1, 1, 2, 1, 0]),
        event=("record", [""] * N),
        measure_unit=("measure", ["m/s2", "m/s", "m/s", "m/s2", "s"]),
        scale_factor=(("record", "level"), data["intensity"].values / pga[:, None]),
    )
    return Fitted({"ring": Curve()}, {}, data)


def test_intensities_of_runs_are_those_of_the_scaled_motions(fitted):
    for name, exponent, unit, si in (("Arias", 2, "m/s", 1.0), ("Sa(1)", 1, "g", G)):
        plane = plane_of(fitted, LEVELS, name)
        unscaled = fitted.cube["record_measure"].sel(measure=name).values
        expected = (
            unscaled[:, None] * fitted.cube["scale_factor"].values ** exponent / si
        )
        np.testing.assert_allclose(plane.runs[:, 1], expected.ravel(), rtol=1e-12)
        levels = np.tile(fitted.cube["intensity"].values / G, N)
        np.testing.assert_allclose(plane.runs[:, 0], levels, rtol=1e-12)
        assert (plane.measures, plane.units) == (("PGA", name), ("g", unit))


def test_the_best_pays_for_those_that_were_tried(fitted):
    best = plane_of(fitted, LEVELS)
    named = plane_of(fitted, LEVELS, "Arias", "ring")
    assert (best.measures[1], best.tests, named.tests) == (
        "Arias",
        2,
        1,
    )  # PGV is as PGA is
    assert best.p_value == pytest.approx(2.0 * named.p_value)
    assert best.gains
    assert "by PGA and Arias (best of 2), runs of records held back are" in repr(best)


def test_what_cannot_be_is_named(fitted):
    with pytest.raises(
        FitError, match=r"say the same \(correlation of their logarithms 1.000\)"
    ):
        plane_of(fitted, LEVELS, "PGV")
    for name in ("D5_95", "PGA", "pgv"):
        with pytest.raises(
            InputError,
            match=f"second = {name!r} must be best, or one of "
            r"PGV, Arias, Sa\(1\)",
        ):
            plane_of(fitted, LEVELS, name)
    both = Fitted({"ring": Curve(), "wall": Curve()}, {}, fitted.cube)
    for one, arch in ((fitted, "wall"), (both, None)):
        with pytest.raises(InputError, match=f"arch = {arch!r} must be one of ring"):
            plane_of(one, LEVELS, arch=arch)
