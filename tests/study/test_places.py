"""Where bridges fail: names of joints, spans and piers beside numbers, and rates by part."""

import json

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import archfrag as af
from archfrag.errors import InputError
from archfrag.fragility.verdicts import Verdict
from archfrag.study.answer.cube import build_cube
from archfrag.study.answer.curves import runs_of_cube
from archfrag.study.answer.rates import parts_of, risk_facts, risk_of, risk_text
from archfrag.study.file.schema import load_study
from archfrag.study.hazard import hazard_of_table
from archfrag.study.runs.store import gather
from tests.study.small import TEXT, assert_compliant, command, small_study

RING = "profile: circular, radius: 2.5, thickness: 0.5, embrace: 180.0, friction: 0.6, voussoirs"
PIERS = "piers: {height: 4.0, width: 1.0, courses: 2}"
ARCHES = f"""
  - {{id: ring, {RING}: 9}}
  - {{id: viaduct, {RING}: 9, spans: 2, {PIERS}}}
  - {{id: long, {RING}: 7, spans: 3, {PIERS}, ends: [{{height: 3.0, width: 1.5}}, null]}}
motions:"""
LEVELS = [0.15, 0.3, 0.6, 0.9, 1.5]


def text_of(design="stripes"):
    head, _, rest = TEXT.partition("arches:")
    text = head + "arches:" + ARCHES + rest.partition("motions:")[2]
    text = text.replace("[0.1, 0.6, 1.2]", str(LEVELS))
    return text + f"design: {{kind: {design}}}\n"


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    path = small_study(tmp_path_factory.mktemp("bridges"), text_of())
    done = command("run", path, "--quiet")
    assert done.exit_code == 0, done.output
    return path, af.open(path)


@pytest.fixture(scope="module")
def arches(finished):
    return {each.id: each.entry.build() for each in load_study(finished[0]).members}


def cells(results):
    """Cube of the runs, with verdicts as numbers and without a run's own dimensions."""
    return results.runs.stack(run=("arch", "record", "intensity"))


def test_every_joint_has_its_place_and_its_part(finished, arches):
    found = cells(finished[1])
    collapses = 0
    for name, *runs in zip(
        found.arch.values,
        found.collapse_joint.values.astype(int),
        found.lost_contact_joint.values.astype(int),
        found.collapse_place.values,
        found.collapse_part.values,
        found.lost_contact_place.values,
    ):
        joint, lost, place, part, lost_place = runs
        arch = arches[str(name)]
        assert place == (arch.place(joint) if joint >= 0 else "")
        assert lost_place == (arch.place(lost) if lost >= 0 else "")
        whole = [each.name for each in arch.parts if joint in each.joints]
        assert [part] == (whole or [""])
        collapses += joint >= 0
    assert collapses > 10
    assert finished[1].runs["spans"].values.tolist() == [1, 2, 3]


def test_tables_have_the_names(finished, arches, tmp_path):
    path, results = finished
    runs = pd.read_csv(path.parent / "out" / "runs.csv", keep_default_na=False)
    for row in runs.to_dict("records"):
        joint = row["collapse_joint"]
        place = arches[row["arch"]].place(int(joint)) if joint != "" else ""
        assert (row["collapse_place"], row["verdict"] == "collapsed") == (
            place,
            place != "",
        )
        assert row["collapse_part"] == (place.rpartition(", ")[0] or (place and "arch"))
    exported = pd.read_csv(
        next(
            each for each in results.to_csv(tmp_path) if each.name.endswith("runs.csv")
        ),
        keep_default_na=False,
    )
    assert exported["collapse_place"].tolist() == runs["collapse_place"].tolist()
    about = json.loads(next(tmp_path.glob("*tables.json")).read_text())
    assert "span or pier" in json.dumps(about)


def test_the_cube_follows_the_conventions(finished, tmp_path):
    assert_compliant(finished[0].parent / "out" / "cube.nc", tmp_path)


def test_fractions_of_parts_add_up_to_those_of_collapses(finished):
    _, results = finished
    parts = results.parts
    assert {*parts.columns.get_level_values(0)} == {"viaduct", "long"}
    for name in ("viaduct", "long"):
        np.testing.assert_allclose(
            parts[name].sum(axis=1, skipna=False), results.fractions[name], rtol=1e-14
        )
        cube = results.runs.sel(arch=name)
        for part, column in parts[name].items():
            own = (cube.collapse_part == part) & (cube.verdict == Verdict.COLLAPSED)
            mean = own.where(cube.collapsed.notnull()).mean("record")
            np.testing.assert_allclose(column, mean, rtol=1e-14)


class TestCurves:
    """P(a collapse in a part) against intensity."""

    @pytest.mark.parametrize("name", ["viaduct", "long"])
    def test_they_add_up_to_the_curve_at_every_level(self, finished, name):
        _, results = finished
        im = np.linspace(0.0, 3.0, 31)  # far below and above all levels too
        table = results.part_curves(name, im)
        parts = table.pivot(index="im", columns="part", values="probability")
        np.testing.assert_allclose(
            parts.sum(axis=1), results.curves[name](im), rtol=1e-13, atol=1e-300
        )
        assert (table.lower <= table.probability).all()
        assert (table.probability <= table.upper).all()
        given = results.part_curves(name)
        assert given["im"].unique().tolist() == LEVELS

    def test_counts_are_those_of_the_runs(self, finished):
        path, results = finished
        runs = pd.read_csv(path.parent / "out" / "runs.csv")
        own = runs[(runs.arch == "viaduct") & (runs.verdict == "collapsed")]
        found = results.part_curves("viaduct").groupby("part")["collapses"].first()
        assert found.to_dict() == own.collapse_part.value_counts().to_dict()

    def test_they_are_exported_and_shown(self, finished, tmp_path):
        path, results = finished
        files = {
            each.stem.rpartition("-")[2]: each for each in results.to_csv(tmp_path)
        }
        table = pd.read_csv(files["parts"])
        assert {*table.arch} == {"viaduct", "long"}
        own = table[table.arch == "viaduct"]
        again = results.part_curves("viaduct", own.im.unique())
        for name in ("probability", "lower", "upper"):
            np.testing.assert_allclose(own[name], again[name], rtol=1e-9, atol=1e-12)
        about = json.loads(files["tables"].read_text())["tables"]["parts"]
        assert [*about] == [*table]
        page = (path.parent / "out" / "report.html").read_text()
        assert "probability there" in page
        assert page.count("Where it falls") == 2  # a ring has one part

    def test_what_has_none(self, finished):
        _, results = finished
        assert results.part_curves("ring").empty
        with pytest.raises(InputError, match="part_curves: 'rings' has no curve; take"):
            results.part_curves("rings")


def test_summary_has_places_and_parts(finished):
    summary = json.loads((finished[0].parent / "out" / "summary.json").read_text())
    ring, viaduct, _ = (each["mechanisms"] for each in summary["arches"])
    for kind in ("joint", "place", "part"):
        assert sum(viaduct[kind].values()) == pytest.approx(1.0, abs=1e-5)
    assert {*viaduct["place"].values()} == {*viaduct["joint"].values()}
    assert {place.partition(",")[0] for place in viaduct["place"]} == {*viaduct["part"]}
    assert {*ring["part"]} == {"arch"}


@pytest.fixture(scope="module")
def found(finished):
    study = load_study(finished[0])
    im = np.geomspace(0.02, 4.0, 12)
    table = np.column_stack([im, 1e-4 * im**-2.0])
    fitted = finished[1]._fitted
    site = hazard_of_table(table, "PGA", "g")
    return study, risk_of(fitted.cube, fitted.quoted(), site)


class TestRates:
    def test_parts_divide_the_rate_as_mechanisms_do(self, found):
        known = {k: v for k, v in found[1].arches.items() if not isinstance(v, str)}
        assert {"viaduct", "long"} <= {*known}
        assert known["viaduct"].by_part.rate.any()
        for name, each in known.items():
            if name == "ring":
                assert each.by_part is None
                continue
            parts = each.by_part
            np.testing.assert_allclose(
                parts.rate.sum(axis=0), each.by_mechanism.rate.sum(axis=0), rtol=1e-12
            )
            for part, counts in zip(parts.categories, parts.counts):
                own = [
                    label.startswith(f"{part},")
                    for label in each.by_mechanism.categories
                ]
                assert counts.sum() >= each.by_mechanism.counts[own].sum()

    def test_they_are_told(self, found):
        study, risk = found
        facts = risk_facts(risk, study)
        assert "by_part" not in facts["arches"]["ring"]
        fractions = [each["fraction"] for each in facts["arches"]["viaduct"]["by_part"]]
        assert sum(fractions) == pytest.approx(1.0)
        assert "  by span 1: " in risk_text(facts)
        assert "arch: " not in risk_text(facts)


def test_parts_are_listed_from_left_to_right(finished):
    """With more than nine spans too."""
    _, results = finished
    runs = results._fitted.runs["viaduct"]
    names = [
        "left pier",
        "span 1",
        "pier 1",
        "span 2",
        "pier 2",
        "span 10",
        "right pier",
    ]
    cube = runs.whole.copy(deep=True)
    shape = cube["collapse_place"].shape
    of_run = np.random.default_rng(3).choice(names, shape)
    place = np.char.add(of_run, ", joint 1").astype(object)
    cube["collapse_place"] = cube["collapse_place"].dims, place
    cube["verdict"][:] = Verdict.COLLAPSED
    split = parts_of(runs_of_cube(cube, ["viaduct"])["viaduct"])
    assert list(split.categories) == [name for name in names if name in of_run[1]]
    for name, counts in zip(split.categories, split.counts):
        np.testing.assert_array_equal(counts, (of_run[1] == name).sum(axis=0))


def test_adaptive_designs_add_up_too(tmp_path):
    path = small_study(tmp_path, text_of("ida"))
    assert command("run", path, "--quiet").exit_code == 0
    results = af.open(path)
    for name in ("viaduct", "long"):
        np.testing.assert_allclose(
            results.parts[name].sum(axis=1, skipna=False),
            results.fractions[name],
            rtol=1e-14,
        )


def test_a_study_of_rings_has_no_names(done):
    cube = build_cube(done.plan, *gather(done.plan))
    names = {"collapse_place", "collapse_part", "lost_contact_place", "spans"}
    assert not names & {*cube.variables}


class TestCommands:
    def test_onset_names_the_places_of_hinges(self, finished, arches):
        given = "onset", "--study", finished[0], "--arch", "viaduct"
        text = command(*given).output
        start = af.onset(arches["viaduct"])
        assert f"{start.plus:.4f} g: {start.places('+x')}\n" in text
        assert start.places("+x").startswith(
            "pier 1, base left; span 1, joint 0 extrados; "
        )
        facts = json.loads(command(*given, "--json").output)
        assert facts["places"] == arches["viaduct"].places
        alone = command("onset", "--study", finished[0], "--arch", "ring", "--json")
        assert "places" not in json.loads(alone.output)

    def test_simulate_names_the_joint(self, finished, arches):
        path, _ = finished
        given = "simulate", "--study", path, "--arch", "viaduct", "--pga", "1.5"
        record = path.parent / "records" / "wave0.AT2"
        options = "--method", "time_stepping", "--mechanism"
        facts = json.loads(command(*given, record, *options, "--json").output)
        joint = facts["collapse_joint"]
        assert facts["collapse_place"] == facts["places"][joint]
        assert facts["places"] == arches["viaduct"].places
        assert "places" not in facts["mechanism"][0]
        text = command(*given, record, *options).output
        assert f"collapse place: {facts['collapse_place']}\n" in text
        assert "hinges pier 1 base left, span 1 joint " in text
        many = af.simulate_many(
            arches["viaduct"], af.read_motions(record), [0.1, 5.0, 8.0], "time_stepping"
        )
        assert isinstance(many, xr.Dataset)
        for joint, place in zip(many.collapse_joint.values, many.collapse_place.values):
            assert place == (arches["viaduct"].place(joint) if joint >= 0 else "")
