"""Scenes become runs and searches; records are found, or missed in one sentence."""

from pathlib import Path

import numpy as np
import pytest

from archfrag.errors import InputError
from archfrag.evidence.part import in_processes
from archfrag.evidence.run import (
    Places,
    Way,
    at_hand,
    least_amplitude,
    peak_acceleration,
    run_scene,
    verdict,
    with_samples,
)
from archfrag.evidence.scene import load_scene
from archfrag.evidence.store import load, save

RECORDS = Path(__file__).parents[2] / "records"
STEPS = Way("time_stepping", "dt", 2e-3)


def test_a_shipped_record_is_scaled_to_the_scene_s_peak():
    scene = with_samples(load_scene("arch7_shipped_m65_r010"), Places(RECORDS))
    assert peak_acceleration(scene.at(0.37)) == pytest.approx(0.37, rel=1e-12)


def test_a_record_that_is_not_there_is_named(tmp_path):
    scene = load_scene("arch7_real_rinaldi")
    with pytest.raises(InputError, match=r"at2/Rinaldi228\.AT2.*--real"):
        with_samples(scene, Places(RECORDS))
    found, missing = at_hand([scene, load_scene("arch7_pulse")], Places(RECORDS))
    assert [each.name for each in found] == ["arch7_pulse"]
    assert len(missing) == 1


def test_least_amplitude_is_where_verdicts_change():
    scene = load_scene("block_sine")
    found = least_amplitude(scene, STEPS, width=1e-3)
    assert 0.293 < found.least < 0.299
    assert verdict(run_scene(scene.at(found.least), STEPS)) is True
    assert verdict(run_scene(scene.at(found.least * (1.0 - 1.01e-3)), STEPS)) is False
    assert found.failures == 0
    assert found.seconds > 0.0


def test_what_stands_throughout_has_no_least_amplitude():
    scene = load_scene("block_sine")
    calm = type(scene)(**{**vars(scene), "low": 0.01, "high": 0.05})
    assert np.isnan(least_amplitude(calm, STEPS).least)


@pytest.mark.parametrize("workers", [1, 2])
def test_results_keep_their_order(workers):
    assert in_processes(divmod, [(7, 2), (9, 4), (5, 5)], workers) == [(3, 1), (2, 1), (1, 0)]


def test_tables_come_back_as_they_were_saved(tmp_path):
    import pandas as pd
    import xarray as xr

    frame = pd.DataFrame({"scene": ["a", "b"], "error": [0.5, np.nan], "fell": [True, False]})
    save(tmp_path, "speed", {"errors": frame}, {"quick": True})
    pd.testing.assert_frame_equal(load(tmp_path, "speed")["errors"], frame)
    with xr.open_dataset(tmp_path / "speed" / "errors.nc") as data:
        assert data.attrs["archfrag_arguments"] == '{"quick": true}'
        assert data["error"].values[0] == 0.5
