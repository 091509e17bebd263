"""Shocks one after another: each arch after a first shock is an arch of its own in the study."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import archfrag as af
from archfrag.errors import InputError
from archfrag.export.scenes import export_arches
from archfrag.fragility.verdicts import Verdict, find_brackets
from archfrag.motions.index import write_index
from archfrag.report.film import repeat
from archfrag.report.first_page import first_page, leading
from archfrag.report.inputs import report_inputs, runs_in_words, summary
from archfrag.study.answer.cube import attributes, open_cube
from archfrag.study.answer.curves import Fitted, runs_of_cube
from archfrag.study.answer.fits import cautions_of, load_fits
from archfrag.study.designs import CASE
from archfrag.study.file.prepared import load_prepared, prepare_motions, read_manifest
from archfrag.study.file.schema import load_study
from archfrag.study.file.sources import read_sources
from archfrag.study.runs.execute import run_batch
from archfrag.study.runs.store import gather, make_plan
from archfrag.study.runs.workers import make_runs
from tests.study.small import (
    TEXT,
    changed,
    command,
    cube_of,
    made,
    small_study,
    write_at2,
)

SLIDES = TEXT.replace("friction: 0.7", "friction: 0.35").replace(
    "thickness: 1.5", "thickness: 2.4"
)
FEW = SLIDES.replace("[0.1, 0.6, 1.2]", "[0.6, 0.9, 1.2, 1.6, 2.0]").replace(
    "2.0}", "20.0}"
)


def shaken(levels="[0.6, 3.0]", more="", text=FEW, motions="records: [wave1]"):
    """The small study with first shocks."""
    before = f"motions:\n  before: {{{motions}, level: {levels}{more}}}\n"
    return text.replace("motions:\n", before)


@pytest.fixture(scope="module")
def shocks(tmp_path_factory):
    return made(small_study(tmp_path_factory.mktemp("shocks"), shaken()))


def test_levels_make_arches_and_classes(tmp_path):
    text = shaken(0.3).replace(
        "friction: .inf}",
        "friction: .inf, vary: {samples: 2, of: {width: "
        "{distribution: uniform, start: 0.4, stop: 0.5}}}}",
    )
    members = load_study(small_study(tmp_path, text)).members
    assert [(each.id, each.arch_class) for each in members] == [
        ("ring", "ring"),
        ("ring-after-0.3", "ring-after-0.3"),
        ("slab-0001", "slab"),
        ("slab-0002", "slab"),
        ("slab-0001-after-0.3", "slab-after-0.3"),
        ("slab-0002-after-0.3", "slab-after-0.3"),
    ]
    assert members[0].chain == members[1].chain
    assert [each.shock for each in members[:2]] == [(), (0.3 * 9.80665, 20.0)]


def test_a_level_of_zero_is_the_intact_study_to_the_bit(tmp_path, shocks):
    plain = made(small_study(tmp_path / "plain", FEW))
    zero = made(small_study(tmp_path / "zero", shaken(0)))
    xr.testing.assert_equal(zero.cube.drop_vars("first_shock"), plain.cube)
    plans = [make_plan(each.study) for each in (plain, zero, shocks)]
    kept = [gather(plan)[0] for plan in plans[:2]]
    assert np.array_equal(plans[0].keys(kept[0]), plans[1].keys(kept[1]))
    # The intact arches of a study with shocks have the same runs too.
    own = shocks.cube.sel(arch=plain.cube["arch"].values).drop_vars(
        ["first_shock", "first_record", "first_event"]
    )
    xr.testing.assert_equal(own, plain.cube)


def test_a_run_is_of_both_motions(shocks):
    plan = make_plan(shocks.study)
    cube = shocks.cube
    assert [each.first.id for each in plan.records] == ["wave1", "wave1"]
    b, a = map(plan.motion, plan.records)
    both = a.scaled(0.6 * 9.80665 / a.pga).then(b.scaled(0.9 * 9.80665 / b.pga), 20.0)
    run = af.simulate(plan.arch(0), both, method="time_stepping", dt=2e-3)
    row = cube.sel(arch="ring-after-0.6", record="wave0").isel(intensity=1)
    for name in (
        "peak_displacement",
        "residual_displacement",
        "end_time",
        "collapse_time",
    ):
        assert np.array_equal(float(row[name]), getattr(run, name), equal_nan=True)
    assert cube["first_shock"].attrs["units"] == "m s-2"
    assert cube["first_shock"].values.tolist() == pytest.approx(
        [0.0, 0.6 * 9.80665, 3.0 * 9.80665] * 2
    )
    facts = json.loads(cube.attrs["archfrag_first_shocks"])
    pairs = {"wave0": "wave1", "wave1": "wave1"}
    assert facts == {"gap": 20.0, "records": ["wave1"], "before": pairs}


def test_workers_without_the_folder_have_the_same_motions(shocks):
    plan = make_plan(shocks.study)
    far = plan.with_motions()
    for each in (plan.ground(1, 0, 2.0), far.ground(1, 0, 2.0)):
        motion, factor = each
        assert (factor, motion.record_start) == (1.0, 21.5)
        assert np.array_equal(
            motion.acceleration, plan.ground(1, 0, 2.0)[0].acceleration
        )
    motion, factor = plan.ground(0, 0, 2.0)
    assert (factor, motion.record_start) == (2.0, 0.0)


def test_first_motions_come_in_turn(tmp_path):
    study = load_study(
        small_study(tmp_path, shaken(0.3, motions="records: [wave1, wave0]"))
    )
    prepare_motions(study)
    plan = make_plan(study)
    assert [each.first.id for each in plan.records] == ["wave1", "wave0"]


def test_the_identity_of_a_run_has_its_first_shock(tmp_path):
    texts = [
        shaken(0.3),
        shaken(0.4),
        shaken(0.3, ", gap: 5.0"),
        shaken(0.3, motions="records: [wave1-rev]"),
    ]
    keys = []
    for number, text in enumerate(texts):
        text = text.replace(
            "motions:\n", "motions:\n  both_senses: true\n"
        )  # of equal factors
        study = load_study(small_study(tmp_path / str(number), text))
        prepare_motions(study)
        plan = make_plan(study)
        case = np.zeros(1, CASE)
        case["arch"] = 1
        case["level"] = 3.0
        keys.append(plan.keys(case)[0])
    assert len({*keys}) == 4


def test_chunks_and_threads_change_no_bit(tmp_path):
    study = load_study(small_study(tmp_path, shaken(0.6)))
    prepare_motions(study)
    tables = []
    for number, (chunk, workers) in enumerate(((None, 1), (1, 2), (3, 2))):
        own = changed(study, "execution", chunk=chunk, workers=workers)
        if number:
            for path in make_plan(study).parts.glob("*.npy"):
                path.unlink()
        assert run_batch(own, quiet=True)[0]["kept"] == 0
        tables.append(gather(make_plan(study))[1])
    for table in tables[1:]:
        for name in set(table.dtype.names) - {"wall_time"}:
            np.testing.assert_array_equal(table[name], tables[0][name])


class TestCollapseInTheFirstShock:
    """The slab falls in a first shock of 3 g."""

    def test_has_its_verdict_and_counts_for_nothing(self, shocks):
        verdict = shocks.cube["verdict"].sel(arch="slab-after-3")
        assert (verdict == Verdict.COLLAPSED_BEFORE).all()
        assert (
            "collapsed_before" in shocks.cube["verdict"].attrs["flag_meanings"].split()
        )
        assert (shocks.cube["collapse_time"].sel(arch="slab-after-3") < 21.5).all()
        fitted = load_fits(shocks.study)
        assert not fitted.arches["slab-after-3"].fitted
        assert not fitted.runs["slab-after-3"].decided.any()
        assert fitted.arches["slab-after-3"].n_undecided == 0

    def test_is_told(self, shocks):
        cautions = cautions_of(shocks.study, load_fits(shocks.study))
        (own,) = (
            each
            for each in cautions
            if each.startswith("slab-after-3: the first shock")
        )
        assert "before 2 of 2 records" in own
        assert not any("unfinished or failed" in each for each in cautions)

    def test_it_is_no_part_of_the_curve_of_the_others(self):
        codes = np.array([[0, 0, 1], [0, 1, 1], [5, 5, 5]])
        found = find_brackets(codes, [1.0, 2.0, 3.0]).of_records()
        assert found.lower.tolist() == [2.0, 1.0]

    def test_a_search_tries_no_other_level(self, tmp_path):
        text = shaken(3.0) + "design: {kind: ida, checks: 0}\n"
        _, cube = cube_of(load_study(small_study(tmp_path, text)))
        runs = cube["verdict"].sel(arch="slab-after-3").values
        assert (
            runs == Verdict.COLLAPSED_BEFORE
        ).sum() == 2  # of two records, one run each
        assert np.isnan(runs).sum() == 8


def test_records_that_follow_one_first_shock_are_alike(tmp_path):
    """Four records follow two shocks in turn: they count as fewer, of the intact arch not."""
    text = shaken(0.6, motions="records: [wave1]").replace(
        "motions:\n", "motions:\n  both_senses: true\n"
    )
    study = load_study(small_study(tmp_path, text))
    _, cube = cube_of(study)
    plan = make_plan(study)
    before = [plan.shock(1, record)[0].id for record in range(4)]
    assert cube["first_record"].values.astype(str).tolist() == before
    runs = runs_of_cube(open_cube(study))
    assert "first shock" not in runs["ring"].groups
    groups = runs["ring-after-0.6"].groups
    assert {*groups} == {"first shock"}  # all are of one earthquake
    shared = groups["first shock"][:, None] == groups["first shock"]
    assert np.array_equal(shared, np.equal.outer(before, before))
    told = [
        each
        for each in cautions_of(study, Fitted({}, {}, open_cube(study)))
        if "first shocks" in each
    ]
    assert len(told) == 1
    assert told[0].startswith("the 4 records follow 2 first shocks (")


def test_one_first_shock_is_told(shocks):
    cautions = cautions_of(shocks.study, load_fits(shocks.study))
    (own,) = (each for each in cautions if "1 first shock (wave1)" in each)
    assert own.endswith("add other first shocks")


def test_what_is_known_of_the_intact_arch_only_is_not_told(shocks):
    fitted = load_fits(shocks.study)
    runs = fitted.runs
    curves = fitted.arches
    assert runs["ring"].onset(curves["ring"]) == 0.0  # its mechanism slides
    assert runs["slab"].onset(curves["slab"]) > 0.0
    assert runs["slab-after-0.6"].onset(curves["slab-after-0.6"]) == 0.0
    states = curves["ring-after-0.6"].states
    reasons = [each.reason for each in states if each.state != "collapse"]
    assert reasons
    assert all("of the first shock too" in each for each in reasons)


@pytest.fixture(scope="module")
def reported(tmp_path_factory):
    path = small_study(tmp_path_factory.mktemp("reported"), shaken("[0.6, 3.0]"))
    assert command("run", path, "--quiet").exit_code == 0
    return load_study(path)


def test_report_tells_of_first_shocks(reported):
    inputs = report_inputs(reported)
    page = (reported.folder / "report.html").read_text()
    assert "A first shock comes before each record (" in page
    assert leading(inputs)[0] in ("ring", "slab")
    assert "the weakest of 2 arches or classes" in str(first_page(inputs, None))
    (own,) = (
        each for each in summary(inputs)["arches"] if each["id"] == "slab-after-3"
    )
    assert own["counts"]["collapsed_before"] == own["counts"]["runs"] == 10
    runs = pd.read_csv(reported.folder / "runs.csv")
    assert (runs["verdict"] == "collapsed before").sum() == 10


def test_runs_in_words_are_read_again(reported):
    again = af.fit(reported.folder / "runs.csv")
    for name, curve in load_fits(reported).arches.items():
        found = again._fitted.arches[name]
        assert found.to_dict()["curve"] == curve.to_dict()["curve"]


def test_scenes_have_the_intact_arches(reported, tmp_path):
    made = export_arches(reported, ["scene"], tmp_path)
    (file,) = (each["file"] for each in made["files"])
    arches = [
        each["id"] for each in json.loads(Path(file).read_text("utf-8"))["arches"]
    ]
    assert arches
    assert not [name for name in arches if "after" in name]
    assert made["notes"] == [
        "scene and dxf have the intact arches and the records, no first shocks"
    ]


def test_a_film_is_of_both_motions(reported):
    inputs = report_inputs(reported)
    example = repeat(inputs, "ring-after-0.6", (0, 1, "any"))
    assert example.same
    assert example.motion.duration > 20.0


def test_first_motions_of_another_index(tmp_path):
    folder = tmp_path / "others"
    folder.mkdir()
    wave = 0.2 * np.sin(np.arange(100) / 5.0)
    for name in ("main1", "main2"):
        write_at2(folder / f"{name}.AT2", wave, 0.02)
    write_index(
        folder, [{"id": n, "file": f"{n}.AT2", "unit": "g"} for n in ("main1", "main2")]
    )
    text = shaken(0.6, motions="index: others/index.csv")
    path = small_study(tmp_path, text)
    study = load_study(path)
    records = prepare_motions(study)
    assert [each.first.id for each in load_prepared(study)] == ["main1", "main2"]
    assert [each.id for each in records] == ["wave0", "wave1"]
    plan = make_plan(study)
    cases = np.zeros(1, CASE)
    cases["arch"] = 1
    cases["level"] = 3.0
    assert make_runs(plan, cases)["verdict"][0] in (0, 1)
    assert plan.ground(1, 0, 1.0)[0].dt == 0.01
    assert any("main1" in name for name in read_manifest(study)["inputs"]["record"])
    chosen = load_study(path, ["motions.before.records=[main2]"])
    prepare_motions(chosen)
    assert [each.first.id for each in load_prepared(chosen)] == ["main2", "main2"]
    assert command("run", path, "--quiet").exit_code == 0
    (lost, _) = (study.work / each.first.stored for each in load_prepared(study))
    lost.unlink()
    assert command("run", path, "--quiet").exit_code == 0
    assert lost.is_file()


SHOCKS = ("f1", "f2", "f3")
WAVES = ("a", "b", "c")


def recorded(folder, names, parts=("0",), seed=0):
    """Write records of a second, no two alike, and their index; components differ too."""
    folder.mkdir(parents=True)
    random = np.random.default_rng(seed)
    rows = []
    for name in names:
        for part in parts:
            wave = (
                0.2 * np.convolve(random.normal(size=130), np.hanning(9), "same") / 4.0
            )
            file = write_at2(folder / f"{name}-{part}.AT2", wave, 0.01, part)
            facts = {"event": name, "station": "X", "component": part, "unit": "g"}
            rows.append(
                {"id": name + part.removeprefix("0"), "file": file.name, **facts}
            )
    write_index(folder, rows)


def by_hand(both=False, parts=("",), first=SHOCKS, records=WAVES):
    """Each record, and what comes before it."""
    senses = ("", "-rev") if both else ("",)
    return {
        f"{record}{part}{sense}": f"{first[place % len(first)]}{part}{sense}"
        for place, record in enumerate(records)
        for part in parts
        for sense in senses
    }


@pytest.mark.parametrize(
    ("motions", "before", "parts", "pairs"),
    [
        (
            "index: motions/index.csv, both_senses: true",
            "index: fore/index.csv",
            ("0",),
            by_hand(both=True),
        ),
        (
            "index: motions/index.csv, both_senses: true",
            "index: fore/index.csv, records: [f2, f1-rev]",
            ("0",),
            {
                "a": "f2",
                "a-rev": "f2-rev",
                "b": "f1-rev",
                "b-rev": "f1",
                "c": "f2",
                "c-rev": "f2-rev",
            },
        ),
        (
            "index: motions/index.csv, both_senses: true, select: [c, a, b]",
            "records: [b, c]",
            ("0",),
            by_hand(both=True, first=("b", "c"), records=("c", "a", "b")),
        ),
        (
            "index: motions/index.csv",
            "index: fore/index.csv, records: [f3, f1]",
            ("0",),
            by_hand(first=("f3", "f1")),
        ),
        (
            "index: motions/index.csv, both_senses: true",
            "index: fore/index.csv",
            ("E", "N"),
            by_hand(both=True, parts=("E", "N")),
        ),
        (
            "index: motions/index.csv, both_senses: true, vertical: true",
            "index: fore/index.csv",
            ("0", "UP"),
            by_hand(both=True),
        ),
        (
            "index: motions/index.csv, both_senses: true, processing: [{taper: {fraction: 0.1}}]",
            "index: fore/index.csv",
            ("0",),
            by_hand(both=True),
        ),
    ],
    ids=["senses", "named", "selected", "fewer", "components", "vertical", "processed"],
)
def test_each_record_follows_its_own_first_shock(
    tmp_path, motions, before, parts, pairs
):
    """Every run is, to the last bit, that of `first.then(second)` by hand."""
    recorded(tmp_path / "motions", WAVES, parts, 1)
    recorded(tmp_path / "fore", SHOCKS, parts, 2)
    start = SLIDES.partition("motions:\n")[0]
    end = SLIDES.partition("intensity:\n")[2]
    block = f"{{{motions}, before: {{{before}, level: 0.4, gap: 1.0}}}}"
    path = tmp_path / "study.yaml"
    path.write_text(f"{start}motions: {block}\nintensity:\n{end}")
    shown = command("validate", path)
    study = load_study(path)
    prepare_motions(study)
    plan = make_plan(study)
    asked = study.motions
    own, other = (
        {motion.id: motion for motion in read_sources(each, "PGA")}
        for each in (asked, asked.first or asked)
    )
    assert [record.id for record in plan.records] == [*pairs]
    level = 0.4 * 9.80665
    for number, (name, first) in enumerate(pairs.items()):
        one = other[first]
        two = own[name]
        factors = 1.0 / one.pga * level, 1.0 / two.pga * (1.5 * level)
        both = one.scaled(factors[0]).then(two.scaled(factors[1]), 1.0)
        run = af.simulate(
            plan.arch(1), both, method="time_stepping", dt=2e-3, follow=2.0
        )
        case = np.zeros(1, CASE)
        case["arch"] = 1
        case["record"] = number
        case["level"] = 1.5 * level
        made_here = make_runs(plan, case)
        assert made_here["peak_displacement"][0] == run.peak_displacement > 0.0
        assert made_here["end_time"][0] == run.end_time
        assert number >= 12 or f"{first} before {name}" in shown.output
    facts = attributes(study, plan)["archfrag_first_shocks"]
    assert json.loads(facts)["before"] == pairs


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            shaken(0.3, motions="records: [wave2]"),
            "motions.before.records: 'wave2' is not a record of the study; did you mean wave",
        ),
        (
            shaken("[0.3, -0.1]"),
            "motions.before.level[1] = -0.1 must be greater than or equal",
        ),
        (shaken("[]"), "motions.before.level"),
        (
            shaken("[0.3, 0.9, 0.3]"),
            "motions.before.level = [0.3, 0.9, 0.3] must differ in their",
        ),
        (
            shaken("[0.3, 0.30000000000001]"),
            "must differ in their first 12 digits, by which",
        ),
        (shaken("'0.3'"), "motions.before.level[0] = '0.3' must be a valid number"),
        (
            shaken(0.3, ", gap: -2"),
            "motions.before.gap = -2 must be greater than or equal to 0",
        ),
        (shaken(0.3, ", levels2: 3"), "motions.before.levels2 is not a known key"),
        (
            TEXT.replace("motions:\n", "motions:\n  before: {records: [wave0]}\n"),
            "motions.before.level must be given",
        ),
        (
            TEXT.replace("motions:\n", "motions:\n  before: {level: 0.3}\n"),
            "motions.before.records must be given",
        ),
        (
            shaken(0.3).replace("id: slab", "id: ring-after-0.3"),
            "the id 'ring-after-0.3' already belongs to arches[0] (ring)",
        ),
    ],
)
def test_what_is_wrong_is_named(tmp_path, text, message):
    path = small_study(tmp_path, text)
    result = command("validate", path)
    assert result.exit_code == 2
    assert message in result.output.replace("\n", " ")
    if "wave2" in text:
        with pytest.raises(InputError, match=r"before\.records"):
            prepare_motions(load_study(path))


def test_runs_that_still_move_as_the_record_begins_are_counted_and_said(
    tmp_path, shocks
):
    assert "moving_before" not in shocks.cube  # they rest in 20 s
    soon = made(small_study(tmp_path, shaken(0.6, ", gap: 0.1")))
    moving = soon.cube["moving_before"]
    assert set(moving.sel(arch=["ring", "slab"]).values.ravel().tolist()) <= {0, -1}
    plan = make_plan(soon.study)
    first, factor, _ = plan.shock(1, 0)
    shock = plan.motion(first).scaled(factor)
    for name in ("ring", "slab"):
        arch = plan.arch(soon.cube["arch"].values.tolist().index(name))
        quiet = shock.then(af.Motion(np.zeros(2), shock.dt), 0.1)
        alone = af.simulate(arch, quiet, method="time_stepping", dt=2e-3, follow=0.0)
        after = moving.sel(arch=f"{name}-after-0.6")
        assert set(after.values.ravel().tolist()) - {-1} == {
            int(alone.status.name != "STANDING")
        }
    fits = load_fits(soon.study)
    said = [each for each in cautions_of(soon.study, fits) if "still moved" in each]
    names = ["ring-after-0.6", "slab-after-0.6"]
    assert [each.partition(": ")[0] for each in said] == names
    for name, caution in zip(names, said):
        decided = (
            soon.cube["verdict"]
            .sel(arch=name)
            .isin([Verdict.COLLAPSED, Verdict.SURVIVED])
        )
        assert f"when the record began in {int(decided.sum())} of " in caution
    words = pd.concat(runs_in_words(fits.cube, "PGA [g]", 1.0 / 9.80665))
    assert (words["moving_before"] == "moving").sum() == (moving.values == 1).sum() > 0
