"""Synthetic motions of a study: from its seed alone, made where needed, never stored."""

import json
from dataclasses import replace

import netCDF4
import numpy as np
import pytest

from archfrag.errors import InputError, StudyError
from archfrag.motions.synthetic import Options, Seeds, make_motion
from archfrag.study.batch import run_batch
from archfrag.study.config import load_study
from archfrag.study.cube import write_cube
from archfrag.study.records import load_prepared, load_record, prepare_motions
from tests.study.small import TEXT, small_study

FILES = 'files: ["records/*.AT2"]'
MADE = (
    "synthetic: {events: 2, records_per_event: 2, magnitude: [5.5, 6.0], "
    "distance_km: {start: 10, stop: 30}, seed: 3}"
)


def study_with(folder, motions=MADE, text=TEXT):
    return load_study(small_study(folder, text.replace(FILES, motions)))


def stored(study):
    return [path.name for path in (study.work / "motions").rglob("*") if path.is_file()]


class TestPrepared:
    def test_no_motion_is_stored_and_each_follows_from_what_the_manifest_states(self, tmp_path):
        study = study_with(tmp_path)
        prepare_motions(study)
        records = load_prepared(study)
        assert stored(study) == []
        assert [record.id for record in records] == ["e1-r1", "e1-r2", "e2-r1", "e2-r2"]
        assert [record.event_seed for record in records] == [3_000_000] * 2 + [3_000_001] * 2
        for record in records:
            seeds = Seeds(record.seed, record.event_seed, record.site_seed)
            made = make_motion(record.magnitude, record.distance, seeds)
            assert 10.0 <= record.distance <= 30.0
            assert np.array_equal(load_record(study.work, record).acceleration, made.acceleration)

    def test_beside_files_and_selected(self, tmp_path):
        study = study_with(tmp_path, f"{FILES}\n  {MADE}\n  select: [e2-r1, wave1]")
        assert [record.id for record in prepare_motions(study)] == ["e2-r1", "wave1"]
        assert len(stored(study)) == 1
        unknown = study.motions.model_copy(update={"select": ("e3-r1",)})
        with pytest.raises(StudyError, match="'e3-r1' is no record of the study"):
            prepare_motions(study.model_copy(update={"motions": unknown}))

    def test_vertical_and_pulse(self, tmp_path):
        wanted = MADE.replace("seed: 3", "seed: 3, vertical: true, pulses: 1.0, vs30: 600")
        study = study_with(tmp_path, wanted)
        record = prepare_motions(study)[0]
        motion = load_record(study.work, record)
        assert motion.metadata["pulse_period_s"] > 0.0
        options = Options(vs30=600.0, vertical=True, pulse=True)
        seeds = Seeds(record.seed, record.event_seed, record.site_seed)
        made = make_motion(record.magnitude, record.distance, seeds, options)
        assert np.array_equal(motion.vertical, made.vertical)

    def test_other_samples_than_prepared_are_refused(self, tmp_path):
        study = study_with(tmp_path)
        record = prepare_motions(study)[0]
        recipe = json.loads(record.recipe)
        recipe["seeds"]["event"] += 1
        with pytest.raises(
            InputError, match=r"synthetic motion 'e1-r1': its samples are not those"
        ):
            load_record(study.work, replace(record, recipe=json.dumps(recipe)))


def test_cube_holds_the_seeds_and_which_records_have_a_vertical(tmp_path, here):
    text = TEXT.replace("levels: [0.1, 0.6, 1.2]", "levels: [0.1]")
    made = MADE.replace("seed: 3", "seed: 3, vertical: true")
    study = study_with(tmp_path, f"{FILES}\n  {made}", text)
    prepare_motions(study)
    run_batch(study, workers=1, quiet=True)
    with netCDF4.Dataset(write_cube(study)) as cube:
        seeds = cube["record_event_seed"][:].filled(np.nan)
        assert np.isnan(seeds[:2]).all()
        assert seeds[2:].tolist() == [3_000_000, 3_000_000, 3_000_001, 3_000_001]
        assert cube["record_seed"][2:].tolist() == [3_000_000 + n for n in range(4)]
        assert cube["record_vertical"][:].tolist() == [0, 0, 1, 1, 1, 1]
        assert cube.vertical_component == "used for 4 of 6 records"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("[5.5, 6.0]", "[9]"), "motions.synthetic.magnitude[0] = 9 must be less than or equal"),
        (("[5.5, 6.0]", "6"), "motions.synthetic.magnitude = 6 must be a list"),
        (("stop: 30", "stop: 5"), "distance_km must have stop above start = 10, not 5"),
        (("seed: 3", "sed: 3"), "motions.synthetic.sed is no known key; did you mean seed?"),
    ],
)
def test_bad_study(tmp_path, change, message):
    with pytest.raises(StudyError) as caught:
        study_with(tmp_path, MADE.replace(*change))
    assert message in str(caught.value)
