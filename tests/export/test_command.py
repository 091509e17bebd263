"""The command `archfrag export`: what it writes, and what it refuses."""

import json

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from archfrag.cli import main
from archfrag.errors import FitError, InputError
from archfrag.export import command
from archfrag.export.command import export_study
from archfrag.study.config import load_study
from archfrag.study.fits import load_answers
from tests.export.made import fragility
from tests.report import synthetic
from tests.study.small import small_study

ALL = ("nrml-continuous", "nrml-discrete", "pelicun", "in-core", "csv", "parquet")

# As a study stores them, [m/s2]: of motion no arch has a curve, residual lies above collapse.
STATES = [
    {"name": "motion", "curve": {"none": "all runs collapse"}},
    {"name": "residual", "curve": fragility(9.0, 0.4).to_dict()},
    {"name": "contact lost", "curve": fragility(1.0, 0.4).to_dict()},
]


@pytest.fixture
def study(tmp_path, monkeypatch):
    """A study with a cube and fits that nobody simulated: one arch has no curve."""
    loaded = load_study(small_study(tmp_path))
    cube = synthetic.cube(("ring", "slab")).assign_coords(level=range(9))
    cube.attrs |= {"archfrag_study": "small", "archfrag_commit": "0123abcd"}
    loaded.folder.mkdir()
    cube.to_netcdf(loaded.folder / "cube.nc")
    answers = {"ring": synthetic.answers_of(cube)["ring"], "slab": synthetic.none("it fell")}
    answers["ring"].more["limit_states"] = {"states": STATES}
    stored = {"arches": {name: found.to_dict() for name, found in answers.items()}}
    (loaded.folder / "fits.json").write_text(json.dumps(stored))
    monkeypatch.setattr(command, "require", lambda study, step: None)
    return loaded


def call(*arguments):
    return CliRunner().invoke(main, ["export", *map(str, arguments)])


class TestExportStudy:
    def test_limit_states_that_all_have_in_order(self, study, tmp_path):
        made = export_study(study, ["csv", "in-core"], tmp_path / "x")
        found = pd.read_csv(tmp_path / "x" / "small-parameters.csv")
        assert found["limit_state"].tolist() == ["contact_lost", "collapse"]
        assert made.notes[0] == (
            "limit state 'residual' is left out: its median is above that of a severer one"
        )
        assert made.notes[1] == (
            "limit state 'motion' is left out: not every arch has a curve of it"
        )

    def test_bands_are_those_that_the_report_quotes(self, study, tmp_path):
        export_study(study, ["csv"], tmp_path / "x")
        answer = load_answers(study.folder / "fits.json")["ring"]
        found = pd.read_csv(tmp_path / "x" / "small-curves.csv").query("limit_state == 'collapse'")
        for side in ("lower", "upper"):
            expected = np.interp(found["intensity"], answer.im, getattr(answer, side))
            np.testing.assert_allclose(found[side], expected, rtol=1e-9, atol=1e-12)

    def test_all_formats(self, study, tmp_path):
        pytest.importorskip("pyarrow")
        made = export_study(study, ALL, tmp_path / "x")
        assert sorted(path.name for path in (tmp_path / "x").iterdir()) == sorted(
            path.name for _, path in made.files
        )
        names = [path.name for name, path in made.files if name not in ("csv", "parquet")]
        assert names == [
            "small-fragility-continuous.xml", "small-fragility-discrete.xml",
            "small-pelicun.csv", "small-pelicun.json", "small-in-core-ring.json",
        ]  # fmt: skip
        assert "collapse: it fell" in made.left_out["slab"]
        tables = [path.name for name, path in made.files if name == "csv"]
        assert tables == [
            f"small-{name}" for name in
            ("curves.csv", "parameters.csv", "runs.csv", "records.csv", "arches.csv",
             "tables.json")
        ]  # fmt: skip
        assert set(pd.read_csv(tmp_path / "x" / "small-runs.csv")["arch"]) == {"ring", "slab"}
        assert set(pd.read_csv(tmp_path / "x" / "small-curves.csv")["arch"]) == {"ring"}

    def test_writing_again_gives_the_same_bytes(self, study):
        pytest.importorskip("pyarrow")
        paths = [path for _, path in export_study(study, ALL).files]
        before = [path.read_bytes() for path in paths]
        export_study(study, ALL)
        assert [path.read_bytes() for path in paths] == before

    def test_no_curve_at_all(self, study):
        arches = {name: synthetic.none("it fell").to_dict() for name in ("ring", "slab")}
        (study.folder / "fits.json").write_text(json.dumps({"arches": arches}))
        with pytest.raises(FitError, match="no curve to export for pelicun: ring: collapse: it"):
            export_study(study, ["csv", "pelicun"])
        assert not (study.folder / "export").exists()
        assert len(export_study(study, ["csv"]).files) == 6

    def test_a_measure_without_a_name_is_refused_before_anything_is_written(self, study):
        measure = study.intensity.model_copy(update={"measure": "HI", "unit": "m"})
        with pytest.raises(InputError, match=r"OpenQuake has no name for .* HI"):
            export_study(study.model_copy(update={"intensity": measure}), ["csv", ALL[0]])
        assert not (study.folder / "export").exists()


class TestCommand:
    def test_messages_and_json(self, study, tmp_path):
        path = tmp_path / "small.yaml"
        result = call(path, "--format", "pelicun", "--format", "pelicun", "--out", tmp_path / "x")
        assert result.exit_code == 0, result.output
        assert result.stderr.startswith("archfrag: no curve of slab is exported: contact_lost: ")
        assert result.stderr.splitlines()[0].endswith("collapse: it fell")
        assert result.stdout.splitlines() == [
            f"pelicun: {tmp_path / 'x' / 'small-pelicun.csv'}",
            f"pelicun: {tmp_path / 'x' / 'small-pelicun.json'}",
        ]
        facts = json.loads(call(path, "--format", "in-core", "--json").stdout)
        assert [each["format"] for each in facts["files"]] == ["in-core"]
        assert list(facts["left_out"]) == ["slab"]
