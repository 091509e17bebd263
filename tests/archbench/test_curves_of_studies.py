"""Coverage of bands, and designs: that both report what a study gives, and failures as such."""

from pathlib import Path

import pytest

from archbench import bands, designs
from archfrag.errors import ArchfragError

SHIPPED = Path(__file__).parents[2] / "configs" / "shipped.yaml"


def test_a_band_holds_lognormal_capacities_and_not_two_peaks():
    found = {
        family: bands.coverage_of(bands.RECORDS, family, 24, 40)
        for family in ("lognormal", "two peaks")
    }
    assert found["lognormal"]["theta"] > 0.75
    assert found["two peaks"]["theta"] < 0.75


def test_families_are_standardised():
    for quantile in bands.FAMILIES.values():
        assert abs(quantile(bands.P[2])) < 0.35
        assert quantile(bands.P[4]) - quantile(bands.P[0]) == pytest.approx(2.5, rel=0.25)


def test_a_study_that_fails_is_reported(tmp_path):
    (tmp_path / "configs").mkdir()
    shipped = SHIPPED.read_text("utf-8")
    (tmp_path / "configs" / "shipped.yaml").write_text(shipped, encoding="utf-8")
    with pytest.raises(ArchfragError, match=r"design ida: .*index\.csv"):
        designs.run_design("ida", 0, tmp_path / "records")
