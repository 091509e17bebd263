"""The command `archfrag export`: what it writes, and what it refuses."""

import itertools
import json
import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from archfrag.errors import FitError, InputError
from archfrag.export import CURVES, FORMATS, writers
from archfrag.export.command import (
    LIMIT_STATES,
    _left_out,
    _not_fitted,
    _with_uncertainty,
    export_study,
)
from archfrag.fragility.curve import Curve
from archfrag.fragility.risk import HazardCurve, collapse_rate, lognormal_rates
from archfrag.study import steps
from archfrag.study.answer.curves import Fitted
from archfrag.study.answer.fits import load_fits
from archfrag.study.answer.rates import SEED
from archfrag.study.file.schema import LimitStates, load_study
from tests.export.made import fragility
from tests.report import synthetic
from tests.study.small import ROOT, command, files_below, small_study

FILES = {
    "fragility-continuous.xml",
    "fragility-discrete.xml",
    "in-core-ring.json",
    "pelicun.csv",
    "pelicun.json",
    "tables.json",
    "arches.csv",
    "curves.csv",
    "parameters.csv",
    "records.csv",
    "runs.csv",
    "rdls.json",
}
# As a study stores them, [m/s2]: of motion there is no curve; impact is the rarest of the others,
# and its curve crosses that of contact lost.
STATES = (
    Curve(reason="all runs collapse", state="motion"),
    replace(fragility(1.1, 0.3), state="impact"),
    replace(fragility(0.5, 0.4), state="residual"),
    replace(fragility(1.0, 0.4), state="contact lost"),
)
MOVED = (
    "limit state 'contact_lost': 1 curve lay below that of a severer state by more than 0.01 and "
    "took up its dispersion as far as needed (such as ring: dispersion 0.4 to 0.376, median times "
    "1)"
)
LEFT_OUT = (
    "limit states left out: motion, of which ring has no curve: all runs collapse"
)
SLIDES = (
    "limit states left out: rotation, of which ring has no curve: the mechanism at onset slides "
    "or does not have four hinges, so there is no rotation of unstable equilibrium to compare with"
)


@pytest.fixture
def study(tmp_path, monkeypatch):
    """A study with a cube and fits that nobody simulated: one arch has no curve."""
    loaded = load_study(small_study(tmp_path))
    cube = synthetic.cube(("ring", "slab")).assign_coords(level=range(9))
    cube.attrs |= {"archfrag_study": "small", "archfrag_commit": "0123abcd"}
    cube["static_limit"] = "arch", [np.nan, 0.1]
    loaded.folder.mkdir()
    cube.assign(intensity_si=cube["intensity"]).to_netcdf(loaded.folder / "cube.nc")
    answers = {
        "ring": replace(
            synthetic.answers_of(cube)["ring"], states=STATES, crossings="x"
        ),
        "slab": synthetic.none("it fell"),
    }
    stored = {
        "classes": {},
        "arches": {name: found.to_dict() for name, found in answers.items()},
    }
    (loaded.folder / "fits.json").write_text(json.dumps(stored))
    monkeypatch.setattr(steps, "_require", lambda study, *names: None)
    return loaded


def test_all_formats(study, tmp_path):
    made = export_study(study, list(FORMATS), tmp_path / "x")
    folder = tmp_path / "x"
    assert {path.name.removeprefix("small-") for path in folder.iterdir()} == FILES
    assert sorted(each["file"] for each in made["files"]) == sorted(
        map(str, folder.iterdir())
    )
    assert made["left_out"] == {"slab": "it fell"}
    assert made["notes"][:3] == [MOVED, SLIDES, LEFT_OUT]
    assert ["mean rate" in each for each in made["notes"]] == [False] * 3 + [True]
    for name in (
        "fragility-continuous.xml",
        "pelicun.json",
        "in-core-ring.json",
        "tables.json",
    ):
        text = (folder / f"small-{name}").read_text()
        assert [note in text for note in made["notes"]] == [True] * 4, name
    stated = pd.read_csv(folder / "small-parameters.csv")
    assert stated["limit_state"].tolist() == [
        "residual",
        "contact_lost",
        "impact",
        "collapse",
    ]
    assert stated["kind"].tolist()[:3] == ["stripes", "adjusted", "stripes"]
    assert np.isnan(
        stated["theta_maximum_likelihood"][1]
    )  # it is no longer the likeliest curve
    assert set(pd.read_csv(folder / "small-runs.csv")["arch"]) == {"ring", "slab"}
    answer = load_fits(study).arches["ring"]
    curves = pd.read_csv(folder / "small-curves.csv").query("limit_state == 'collapse'")
    for side in ("lower", "upper"):  # the band that the report quotes
        expected = np.interp(curves["intensity"], answer.im, getattr(answer, side))
        np.testing.assert_allclose(curves[side], expected, rtol=1e-9, atol=1e-12)
    before = files_below(folder)
    assert export_study(study, list(FORMATS), folder) == made
    assert files_below(folder) == before


def test_limit_states_that_are_asked_for(study, tmp_path):
    made = export_study(
        study, ["pelicun"], tmp_path, limit_states=["contact lost", "impact"]
    )
    row = pd.read_csv(tmp_path / "small-pelicun.csv").iloc[0]
    assert [name for name in row.index if name.endswith("Theta_0")] == [
        "LS1-Theta_0",
        "LS2-Theta_0",
        "LS3-Theta_0",
    ]
    about = json.loads((tmp_path / "small-pelicun.json").read_text())["ring"][
        "LimitStates"
    ]
    names = [one["Description"] for each in about.values() for one in each.values()]
    assert names == ["contact_lost", "impact", "collapse"]
    assert [note.split(":")[0] for note in made["notes"]] == [
        "limit state 'contact_lost'",
        "ring",
    ]
    for state, error, message in (
        ("motion", FitError, LEFT_OUT),
        ("Rotation", FitError, SLIDES),
        (
            "sliding",
            InputError,
            "they are motion, impact, residual, rotation, contact",
        ),
    ):
        with pytest.raises(error, match=message):
            export_study(study, ["pelicun"], tmp_path / "none", limit_states=[state])
    assert not (tmp_path / "none").exists()
    result = command(
        "export", tmp_path / "small.yaml", "--format=csv", "--limit-state=motion"
    )
    assert (result.exit_code, result.stderr) == (6, f"archfrag: error: {LEFT_OUT}\n")


@pytest.mark.parametrize(
    "name", ["contact lost", "contact_lost", "Residual Displacement"]
)
def test_limit_states_go_by_their_names_in_texts_and_tables(study, tmp_path, name):
    made = export_study(study, ["csv"], tmp_path / "x", limit_states=[name])
    assert made["limit_states"] == [
        name.lower().split(" d")[0].replace(" ", "_"),
        "collapse",
    ]


def test_states_without_a_curve_for_one_reason_are_one_note():
    of = "ring", "every run collapsed"
    assert _left_out(of, ["motion", "impact"]) == (
        "limit states left out: motion, impact, of which ring has no curve: every run collapsed"
    )


def test_a_state_without_a_curve_says_why_and_what_helps(study, tmp_path):
    """An arch whose every run exceeds a state, beside one that has a curve of it."""
    stored = json.loads((study.folder / "fits.json").read_text())
    slab = stored["arches"]["slab"] = json.loads(json.dumps(stored["arches"]["ring"]))
    slab["more"]["limit_states"]["states"][2]["curve"] = {"none": "every run collapsed"}
    (study.folder / "fits.json").write_text(json.dumps(stored))
    helps = {
        "stripes": "a larger limit_states.residual",
        "ida": "design: {kind: stripes}",
    }
    for design, help_ in helps.items():
        result = command(
            "export",
            tmp_path / "small.yaml",
            "--set",
            f"design.kind={design}",
            "--format=csv",
            "--limit-state",
            "residual displacement",
        )
        assert result.stderr == (
            "archfrag: error: limit states left out: residual, of which slab has no curve: every "
            f"run collapsed; try {help_}; 1 of 2 arches or classes "
            "have one\n"
        )
    del slab["more"]["limit_states"]
    (study.folder / "fits.json").write_text(json.dumps(stored))
    with pytest.raises(
        FitError, match="fits limit states to all of up to 12 arches, and to thre"
    ):
        export_study(study, ["csv"], limit_states=["residual"])


def test_a_class_says_how_many_of_its_arches_slide():
    arches = xr.Dataset({"arch": list("abc"), "arch_class": ("arch", ["k", "k", "c"])})
    cube = arches.assign(static_limit=("arch", [0.1, np.nan, np.nan]))
    assert "at onset of 1 of its 2 arches slides" in _not_fitted(cube, "k", "rotation")
    assert "at onset slides" in _not_fitted(cube, "c", "rotation")
    assert "up to 12 arches" in _not_fitted(cube, "a", "rotation")


def test_the_page_on_exports_lists_the_limit_states_with_their_limits():
    page = (ROOT / "docs" / "howto" / "export.md").read_text("utf-8")
    rows = dict(re.findall(r"^\| `(\w+)` \| [^|]*\|[^|]*\| ([^|]*) \|", page, re.M))
    assert tuple(rows) == LIMIT_STATES
    for name, field in LimitStates.model_fields.items():
        assert rows[name] == f"`limit_states.{name}`, {field.default:g}"


def test_formats_have_their_functions_and_are_told_in_the_help():
    text = command("export", "--help").stdout
    for name, (about, receiver, functions) in FORMATS.items():
        assert f"{name:15}  {about}" in text
        assert bool(functions) == bool(receiver)
        assert all(callable(getattr(writers, each)) for each in functions.values())


def test_no_curve_at_all(study):
    arches = {name: synthetic.none("it fell").to_dict() for name in ("ring", "slab")}
    (study.folder / "fits.json").write_text(
        json.dumps({"arches": arches, "classes": {}})
    )
    with pytest.raises(FitError, match="no curve to export for pelicun: ring: it fell"):
        export_study(study, ["csv", "pelicun"])
    assert not (study.folder / "export").exists()
    assert len(export_study(study, ["csv"])["files"]) == 7


def test_messages_and_json(study, tmp_path):
    call = ("export", tmp_path / "small.yaml", "--format")
    result = command(
        *call, "pelicun", "--format", "pelicun", "--out", str(tmp_path / "x")
    )
    assert (
        result.stderr.splitlines()[0]
        == "archfrag: no curve of slab is exported: it fell"
    )
    names = "small-pelicun.csv", "small-pelicun.json"
    assert result.stdout.splitlines() == [
        *(f"pelicun: {tmp_path / 'x' / name}" for name in names),
        f"rdls: {tmp_path / 'x' / 'small-rdls.json'}",
        "limit states written: 4 (residual, contact_lost, impact, collapse)",
    ]
    facts = json.loads(command(*call, "in-core", "--json").stdout)
    assert [each["format"] for each in facts["files"]] == ["in-core", "rdls"]
    assert list(facts["left_out"]) == ["slab"]


@pytest.mark.parametrize(("n_record", "noted"), [(6, True), (40, False)])
def test_a_median_curve_whose_mean_rate_is_far_above_is_noted(
    tmp_path, n_record, noted, monkeypatch
):
    loaded = load_study(small_study(tmp_path))
    cube = synthetic.cube(items=synthetic.motions(n_record), beta=0.7)
    cube.attrs |= {"archfrag_study": "small", "archfrag_commit": "0123abcd"}
    fitted = Fitted(synthetic.answers_of(cube), {}, cube)
    monkeypatch.setattr("archfrag.export.command.sha256_of", lambda path: "0")
    for kind in ("median", "predictive"):
        notes = export_study(
            loaded, ["pelicun"], tmp_path / kind, curve=kind, fitted=fitted
        )
        found = [
            each for each in notes["notes"] if "times that of this median curve" in each
        ]
        assert len(found) == (noted and kind == "median")
        if kind == "predictive":
            assert any("is not the mean rate" in each for each in notes["notes"])


def test_branches_and_predictive_curves_in_files(study, tmp_path):
    """Each file has all curves; weights are 1 in sum; states do not cross within a branch."""
    formats = ["nrml-continuous", "nrml-discrete", "pelicun", "in-core", "csv"]
    made = {
        kind: export_study(study, formats, tmp_path / kind, curve=kind)
        for kind in CURVES
    }
    weights = pd.read_csv(tmp_path / "branches" / "small-branches.csv")
    assert list(weights) == ["taxonomy", "risk_id", "weight"]
    assert (weights["taxonomy"] == "ring").all()
    assert weights["weight"].sum() == pytest.approx(1.0, abs=1e-12)
    text = (tmp_path / "branches" / "small-fragility-continuous.xml").read_text()
    assert (
        re.findall(r'fragilityFunction id="([^"]*)"', text)
        == weights["risk_id"].tolist()
    )
    assert "ring-b5: Masonry arch ring; branch of weight 0." in text
    ids = pd.read_csv(tmp_path / "branches" / "small-pelicun.csv")["ID"]
    assert ids.tolist() == [name.replace("-", "_") for name in weights["risk_id"]]
    assert len(list((tmp_path / "branches").glob("small-in-core-ring-b*.json"))) == 15
    points = pd.read_csv(tmp_path / "branches" / "small-curves.csv")
    assert points["lower"].isna().all()
    by_state = points.pivot(
        index=["arch", "im"], columns="limit_state", values="probability"
    )
    for mild, severe in itertools.pairwise(made["branches"]["limit_states"]):
        assert (by_state[severe] - by_state[mild]).max() < 0.0101, mild
    collapse = by_state["collapse"].unstack("arch")[weights["risk_id"]]
    mean = pd.read_csv(tmp_path / "predictive" / "small-curves.csv")
    mean = mean.query("limit_state == 'collapse'")["probability"].values
    np.testing.assert_allclose(
        mean, collapse.values @ weights["weight"].values, atol=6e-3
    )
    assert "the predictive curve is no lognormal one" in made["predictive"]["notes"][-1]
    assert not any("the predictive curve" in note for note in made["median"]["notes"])
    with pytest.raises(
        InputError, match="curve is 'mean'; it is one of median, predictive"
    ):
        export_study(study, ["csv"], tmp_path / "none", curve="mean")


def test_rates_by_the_files_are_the_mean_rate_of_the_study(study, tmp_path):
    """Of branches by their parameters, of the predictive curve by its points."""
    curve = load_fits(study).arches["ring"]
    for kind in CURVES:
        export_study(
            study, ["csv"], tmp_path / kind, curve=kind, limit_states=["impact"]
        )
    # Of six records, so that much would be from below a hazard curve that went on there.
    hazard = HazardCurve(
        [0.01, 0.05, 0.2, 1.0, 4.0, 16.0], [0.1, 0.1, 0.03, 3e-3, 1e-4, 1e-6]
    )
    mean = collapse_rate(hazard, curve, curve.draws(SEED)).mean
    weights = pd.read_csv(tmp_path / "branches" / "small-branches.csv")["weight"].values
    stated = pd.read_csv(tmp_path / "branches" / "small-parameters.csv")
    theta, beta = stated.query("limit_state == 'collapse'")[
        ["theta_si", "beta"]
    ].values.T
    assert weights @ lognormal_rates(hazard, theta, beta) == pytest.approx(
        mean, rel=0.04
    )
    predicted = _with_uncertainty({"ring": {"collapse": curve}}, "predictive")[0][
        "ring"
    ]
    assert collapse_rate(hazard, predicted["collapse"]).rate == pytest.approx(
        mean, rel=5e-3
    )
