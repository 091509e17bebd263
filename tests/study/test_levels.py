"""Records at levels of their own (hazard-consistent stripes): an index with the column level."""

import csv

import numpy as np
import pytest

import archfrag as af
from archfrag.errors import InputError
from archfrag.fragility.verdicts import Verdict, find_brackets
from archfrag.motions.index import load_index
from archfrag.study.answer.cube import open_cube, write_cube
from archfrag.study.answer.curves import runs_of_cube
from archfrag.study.answer.rates import mechanisms_of
from archfrag.study.designs import Stripes
from archfrag.study.file.prepared import prepare_motions
from archfrag.study.file.schema import load_study
from archfrag.study.runs.execute import run_batch
from archfrag.study.validate import check_study
from tests.study.small import changed, command, cube_of, write_at2

LEVELS = [0.3, 0.5, 0.8, 1.3]
TEXT = """\
id: own
title: Records at levels of their own
output: out
arches:
  - {id: slab, profile: block, width: 0.4, height: 1.5, friction: .inf}
motions:
  index: index.csv
intensity: {measure: PGA, unit: g, levels: [0.3, 0.5, 0.8, 1.3]}
method: {name: time_stepping, dt: 2.0e-3, follow: 2.0}
"""
COUNT = 16


def rows_of(again=0, per_event=1):
    """Rows of an index: a record at each level in turn, every `again`-th at the next one too."""
    rows = []
    for n in range(COUNT):
        row = {
            "id": f"w{n:02}",
            "file": f"w{n:02}.AT2",
            "unit": "",
            "level": LEVELS[n % 4],
        }
        rows.append(row | {"event": f"e{n // per_event}", "scale": f"{1 + n}"})
        if again and n % again == 0:
            rows.append(rows[-1] | {"level": LEVELS[(n + 1) % 4], "scale": "9"})
    return rows


def write_rows(folder, rows):
    with open(folder / "index.csv", "w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, list(rows[0]))
        table.writeheader()
        table.writerows(rows)


def study_in(folder, rows, text=TEXT):
    folder.mkdir(parents=True, exist_ok=True)
    time = np.arange(300) * 0.01
    generator = np.random.default_rng(3)
    for n in range(COUNT):
        phase = 2.0 * np.pi * generator.uniform(0.5, 2.0) * time + generator.uniform(
            0, 6
        )
        write_at2(
            folder / f"w{n:02}.AT2",
            np.sin(phase) * np.sin(np.pi * time / 3.0) ** 2,
            0.01,
        )
    write_rows(folder, rows)
    path = folder / "own.yaml"
    path.write_text(text, encoding="utf-8")
    return path


VARIED = TEXT.replace(
    "friction: .inf}",
    "friction: .inf,\n     vary: {samples: 2, of: {width: {distribution: uniform, start: 0.35, "
    "stop: 0.45}}}}",
)
KINDS = {
    "one level each": (rows_of(), TEXT),
    "two an event": (rows_of(per_event=2), TEXT),
    "some at two levels": (rows_of(again=3, per_event=2), TEXT),
    "all at two levels": (rows_of(again=1), TEXT),
    "both senses": (
        rows_of(),
        TEXT.replace("index.csv", "index.csv\n  both_senses: true"),
    ),
    "a class": (rows_of(), VARIED),
}


@pytest.mark.parametrize("kind", KINDS)
def test_the_curve_is_that_of_the_table_of_its_runs(tmp_path, kind):
    path = study_in(tmp_path, *KINDS[kind])
    study = af.Study.from_file(path)
    results = study.run(progress=False)
    results.report()
    other = af.fit(study.folder / "runs.csv")
    own, table = results._fitted, other._fitted
    assert own.curves.keys() == table.curves.keys()
    fitted = 0
    for name, curve in own.curves.items():
        same = table.curves[name]
        fitted += curve.fitted
        assert curve.reason == same.reason
        for fact in (
            "intervals",
            "lower",
            "upper",
            "im",
            "n_independent",
            "assumptions",
        ):
            assert getattr(curve, fact) == getattr(same, fact), (name, fact)
        for one, two in ((curve, same), (curve.likelihood, same.likelihood)):
            if one is not None and two is not None:
                np.testing.assert_array_equal(
                    [one.theta, one.beta], [two.theta, two.beta]
                )
    assert fitted


@pytest.mark.parametrize("each", [(1,), (2,), (2, 1, 1)])
def test_brackets_without_what_is_not_asked_for_are_the_same(each):
    generator = np.random.default_rng(2)
    levels = np.geomspace(0.3, 3.0, 6)
    capacity = np.exp(0.5 * generator.standard_normal((40, 1)))
    place = np.arange(40)[:, None]
    asked = (np.arange(6) - place) % 6 < np.resize(each, (40, 1))
    verdict = np.where(asked, capacity <= levels, Verdict.NOT_RUN)
    whole = find_brackets(verdict, levels)
    for one, two in zip(
        (whole.lower, whole.upper), (whole.packed.lower, whole.packed.upper)
    ):
        np.testing.assert_array_equal(one, two)
    assert whole.packed.verdict.shape == (40, max(each))
    if max(each) > 1:
        both = [Stripes().likelihood(found) for found in (whole, whole.packed)]
        assert both[0].theta == both[1].theta == pytest.approx(1.0, rel=0.4)
        assert both[0].beta == both[1].beta
    own = whole.packed.at_levels(filled=True)
    for values, expected in zip(own, whole.at_levels()):
        np.testing.assert_array_equal(values, expected)


def test_runs_fractions_and_mechanisms_are_of_the_records_of_each_level(tmp_path):
    path = study_in(tmp_path, rows_of(again=4))
    study = load_study(path)
    assert check_study(study)["runs"] == COUNT + COUNT // 4
    results = af.Study.from_file(path).run(progress=False)
    cube = open_cube(study)
    verdict = cube["verdict"].isel(arch=0).transpose("record", "level").values
    expected = np.zeros(verdict.shape, bool)
    for n in range(COUNT):
        expected[n, n % 4] = True
        expected[n, (n + 1) % 4] |= n % 4 == 0
    np.testing.assert_array_equal(verdict != Verdict.NOT_RUN, expected)
    collapsed = (verdict == Verdict.COLLAPSED).sum(axis=0)
    decided = np.isin(verdict, (Verdict.COLLAPSED, Verdict.SURVIVED)).sum(axis=0)
    np.testing.assert_array_equal(results.fractions["slab"], collapsed / decided)
    runs = runs_of_cube(cube)["slab"]
    assert runs.by_level
    assert not runs.gaps
    assert not runs.searched
    _, fell, *_ = mechanisms_of(runs)
    np.testing.assert_array_equal(fell.sum(axis=0), collapsed)
    # A record is used at its levels alone: no verdict is filled in from another level.
    isotonic = runs.brackets.at_levels(filled=True)
    np.testing.assert_array_equal(isotonic[2].sum(axis=0), decided)


def test_batches_make_the_same_runs_and_a_study_that_grows_keeps_them(tmp_path):
    path = study_in(tmp_path, rows_of()[:-2])
    study = load_study(path)
    log, before = cube_of(study)
    assert log["runs"] == COUNT - 2
    write_rows(tmp_path, rows_of(again=5))
    log, whole = cube_of(load_study(path))
    assert log["kept"] == COUNT - 2
    shared = whole["verdict"].sel(record=before["record"])
    known = before["verdict"].notnull()
    np.testing.assert_array_equal(shared.where(known), before["verdict"])
    apart = load_study(study_in(tmp_path / "apart", rows_of(again=5)))
    apart = changed(apart, "execution", batches=3)

    prepare_motions(apart)
    made = [
        run_batch(apart, batch, workers=1, quiet=True)[0]["runs"] for batch in range(3)
    ]
    assert sum(made) == log["runs"]
    write_cube(apart)
    both = (open_cube(each)["verdict"] for each in (apart, load_study(path)))
    np.testing.assert_array_equal(*both)


def without(name):
    return [row if row["id"] != name else row | {"level": ""} for row in rows_of()]


@pytest.mark.parametrize(
    ("rows", "change", "words"),
    [
        (
            rows_of(),
            ("method:", "design: {kind: ida}\nmethod:"),
            "design: stripes, not ida",
        ),
        (
            rows_of(),
            ("method:", "design: cloud\nmethod:"),
            "design: stripes, not cloud",
        ),
        (rows_of(), ("0.5, ", ""), "0.5 of record w01 is none of intensity.levels"),
        (rows_of(), ("1.3]", "1.3, 2]"), "no record has the level 2"),
        (without("w03"), ("", ""), "record w03 has no level, but others have"),
    ],
)
def test_levels_that_do_not_agree_are_refused_by_validate(
    tmp_path, rows, change, words
):
    path = study_in(tmp_path, rows, TEXT.replace(*change, 1))
    found = command("validate", path)
    assert found.exit_code == 2
    assert words in found.stderr
    assert "Traceback" not in found.stderr


@pytest.mark.parametrize(
    ("level", "words"),
    [
        ({"level": "-1"}, "level = -1 is impossible"),
        ({"level": "raw"}, "level = 'raw' is not a number"),
        ({"level": "0.3"}, "'w00' occurs twice"),
        ({"level": ""}, "'w00' occurs twice"),
        ({"level": "0.5", "event": "other"}, "'w00' occurs twice"),
    ],
)
def test_rows_of_one_record_may_differ_in_level_only(tmp_path, level, words):
    rows = rows_of()[:1]
    write_rows(tmp_path, [*rows, rows[0] | level])
    with pytest.raises(InputError, match=r"index\.csv, line 3") as caught:
        load_index(tmp_path)
    assert words in str(caught.value)


def test_an_index_has_an_entry_for_each_record(tmp_path):
    write_rows(tmp_path, rows_of(again=3))
    entries = load_index(tmp_path)
    assert [entry.id for entry in entries] == [f"w{n:02}" for n in range(COUNT)]
    assert entries[0].levels == (0.3, 0.5)
    assert entries[1].levels == (0.5,)
    text = (tmp_path / "index.csv").read_text().replace("level", "Level [g]", 1)
    (tmp_path / "index.csv").write_text(text)
    with pytest.raises(InputError, match="write level, with numbers"):
        load_index(tmp_path)
