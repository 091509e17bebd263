"""Verdicts of other programs and experiments: the curve of a study's own runs, and bad tables."""

import io
import json

import numpy as np
import pandas as pd
import pytest

import archfrag as af
from archfrag.errors import FitError, InputError
from archfrag.report.inputs import runs_in_words
from archfrag.study.answer.cube import write_cube
from archfrag.study.answer.fits import fit_cube
from archfrag.study.answer.tables import runs_table
from archfrag.study.file.prepared import prepare_motions
from archfrag.study.file.schema import load_study
from tests.study.small import command, make_runs, small_study, write_at2

BAKER = {
    0.2: 0,
    0.3: 0,
    0.4: 0,
    0.6: 4,
    0.7: 6,
    0.8: 13,
    0.9: 12,
    1.0: 16,
}  # collapses of 40 runs
HAZARD = np.array([[0.05, 0.03], [0.1, 0.01], [0.5, 2e-4], [2.0, 2e-6], [4.0, 2e-7]])
STATES = ["none", "light", "moderate", "collapse"]


def stripes(n_record=24, per_event=1, seed=3):
    """Runs of records at seven levels, with the damage that each shows."""
    generator = np.random.default_rng(seed)
    rows = []
    shared = np.repeat(generator.standard_normal(n_record // per_event), per_event)
    own = generator.standard_normal(n_record) * (0.3 if per_event > 1 else 1.0)
    for i, capacity in enumerate(
        0.4 * np.exp(0.4 * (shared + own) / np.hypot(1.0, own.std()))
    ):
        for level in (0.1, 0.2, 0.3, 0.4, 0.6, 0.8, 1.0):
            state = STATES[sum(level > part * capacity for part in (0.4, 0.7, 1.0))]
            rows.append(
                {
                    "record": f"r{i}",
                    "event": f"e{i // per_event}",
                    "PGA [g]": level,
                    "verdict": level > capacity,
                    "state": state,
                }
            )
    return pd.DataFrame(rows)


def bits(curve):
    """All numbers of a curve with its band and intervals."""
    plain = curve.to_dict()
    plain["likelihood"].pop(
        "none", None
    )  # a reason, with levels in the unit of the table
    parts = (
        "curve",
        "likelihood",
        "theta",
        "beta",
        "im",
        "lower",
        "upper",
        "n_independent",
    )
    return json.dumps({name: plain[name] for name in parts})


@pytest.mark.parametrize("design", ["stripes", "ida", "cloud"])
def test_the_runs_of_a_study_give_its_own_curve_to_the_last_bit(tmp_path, design):
    path = small_study(tmp_path)
    time = np.arange(150) * 0.01
    for n, peak in enumerate((0.2, 0.5, 0.7, 0.9, 1.3, 2.0)):
        wave = (
            peak
            * np.sin(2 * np.pi * (0.9 + 0.1 * n) * time)
            * np.sin(np.pi * time / 1.5)
        )
        write_at2(tmp_path / "records" / f"more{n}.AT2", wave, 0.01)
    levels = "intensity.levels={start: 0.1, stop: 2.0, count: 8}"
    study = load_study(path, [f"design={{kind: {design}}}", levels])
    prepare_motions(study)
    make_runs(study)
    write_cube(study)
    fitted = fit_cube(study)
    assert any(curve.fitted for curve in fitted.arches.values())
    words = pd.concat(
        runs_in_words(fitted.cube, "PGA [g]", 1.0 / study.intensity.factor)
    )
    words.to_csv(tmp_path / "runs.csv", index=False)
    tables = [(tmp_path / "runs.csv", {})]
    _, pieces = runs_table(fitted.cube)
    tables.append((pd.concat(pieces), {"measure": "PGA", "unit": "m/s2"}))
    for table, given in tables:
        found = af.fit(table, **given)
        # A table does not say whether verdicts chose the levels of its runs.
        assert found._study.design.kind == ("stripes" if design == "ida" else design)
        for name, curve in fitted.arches.items():
            mine = found._fitted.arches[name]
            assert mine.theta == pytest.approx(curve.theta, rel=1e-13)
            if (
                design != "cloud" or given
            ):  # its levels in g are not to the last bit those in m/s2
                assert bits(mine) == bits(curve)


def test_levels_of_runs_csv_are_those_of_the_study(tmp_path):
    level = float(f"{0.1 + 1.9 / 7:.12g}")  # as a range in a study file gives it
    made = f"{level * 9.80665 / 9.80665:.12g}"
    table = tmp_path / "runs.csv"
    table.write_text(
        f"record,PGA [g],verdict\na,{made},1\na,0.1,0\nb,{made},0\nb,1,1\n"
    )
    assert level in af.fit(table)._study.intensity.given


def test_published_stripes_give_the_published_maximum_and_a_band():
    rows = [(im, n < k) for im, k in BAKER.items() for n in range(40)]
    curve = af.fit(pd.DataFrame(rows, columns=["Sa(1.0) [g]", "collapse"])).curve
    likeliest = curve.likelihood
    assert likeliest.theta == pytest.approx(1.0761, abs=5e-5)
    assert likeliest.beta == pytest.approx(0.4292, abs=5e-5)
    assert curve.theta_interval[0] < likeliest.theta < curve.theta_interval[1]
    low, high = curve.band(0.8)
    assert low < curve(0.8) < high
    assert (curve.measure, curve.unit) == ("Sa(1.0)", "g")


def test_records_of_one_earthquake_count_as_fewer():
    table = stripes(per_event=4)
    shared = af.fit(table).curve
    alone = af.fit(table.drop(columns="event")).curve
    assert shared.n_independent < 0.7 * alone.n_independent == 0.7 * 24
    assert np.ptp(shared.theta_interval) > 1.2 * np.ptp(alone.theta_interval)


def test_brackets_give_the_posterior_of_their_runs():
    table = stripes()
    both = table.groupby(["record", "verdict"])["PGA [g]"].agg(["min", "max"]).unstack()
    brackets = pd.DataFrame(
        {"lower [g]": both["max"][False], "upper [g]": both["min"][True]}
    )
    found = af.fit(brackets.reset_index(), measure="PGA")
    assert found._study.design.kind == "ida"
    capacities = found.capacities.set_index("record")
    whole = af.fit(table).capacities
    whole = whole.set_index("record").loc[capacities.index]
    assert np.allclose(capacities[["lower", "upper"]], whole[["lower", "upper"]])
    assert found.curve.theta == pytest.approx(af.fit(table).curve.theta, rel=1e-9)


@pytest.mark.parametrize(
    "kept",
    [
        lambda table: table.index != 40,
        lambda table: np.random.default_rng(1).random(len(table)) > 0.25,
        lambda table: (
            ~table.groupby("record")["verdict"].cumsum().gt(1)
        ),  # up to a collapse
        lambda table: table["record"].isin(["r1", "r2"]) <= table["PGA [g]"].gt(0.2),
    ],
    ids=["a run", "a quarter", "beyond collapse", "low levels of two records"],
)
def test_runs_that_were_not_made_leave_stripes_with_damage_states(kept):
    table = stripes()
    table["verdict"] = table["state"].eq(STATES[-1])
    whole, own = (
        af.fit(each.drop(columns="verdict"), states=STATES)
        for each in (table, table[kept(table)])
    )
    assert own._study.design.kind == "stripes"
    assert not any(
        "together" in curve.method for curve in own.curve.limit_states.values()
    )
    assert list(own.curve.limit_states) == ["light", "moderate", "collapse"]
    for name, curve in own.curve.limit_states.items():
        other = whole.curve.limit_states[name]
        assert curve.theta == pytest.approx(other.theta, rel=0.12)
        assert other.theta_interval[0] < curve.theta < other.theta_interval[1]
    assert own.curve.likelihood.theta == pytest.approx(
        whole.curve.likelihood.theta, rel=0.05
    )
    fractions = [each.fractions["structure"].to_numpy() for each in (own, whole)]
    np.testing.assert_allclose(*fractions, atol=0.1)


def test_damage_states_of_levels_that_a_search_for_collapse_chose_are_not_too_low():
    """The marginal likelihood of the state has a median that is some 20 % too low."""
    table = stripes()
    kept = []
    for _, own in table.groupby("record"):
        first = own["verdict"].argmax() if own["verdict"].any() else len(own)
        kept.append(own.iloc[max(first - 2, 0) : first + 1])
    whole, found = (
        af.fit(each.drop(columns="verdict"), states=STATES)
        for each in (table, pd.concat(kept))
    )
    state = found.curve.limit_states["moderate"]
    assert "capacities for it and for collapse together" in state.method
    assert state.theta == pytest.approx(
        whole.curve.limit_states["moderate"].theta, rel=0.1
    )


def test_single_runs_of_one_earthquake_count_as_fewer():
    generator = np.random.default_rng(7)
    shared, own = generator.standard_normal((2, 8, 3))
    im = 0.4 * np.exp(0.5 * generator.standard_normal(24))
    capacity = 0.4 * np.exp(0.4 * (shared[:, :1] + own).ravel() / np.sqrt(2.0))
    table = pd.DataFrame(
        {
            "PGA [g]": im,
            "verdict": im > capacity,
            "event": [f"e{n // 3}" for n in range(24)],
        }
    )
    alike = af.fit(table).curve
    alone = af.fit(table.drop(columns="event")).curve
    assert alone.n_independent == 24.0
    assert 8.0 <= alike.n_independent < 20.0
    assert np.ptp(alike.theta_interval) > 1.1 * np.ptp(alone.theta_interval)
    assert f"24 single runs count as {alike.n_independent:.3g}" in alike.assumptions
    assert "runs are independent" not in alike.assumptions
    # A motion on several specimens is one earthquake too, as one record on several arches is.
    arches = table.assign(arch=[f"a{n % 3}" for n in range(24)], record=table["event"])
    arches["class"] = "rings"
    of_class = af.fit(arches.drop(columns="event")).curve
    assert "within records" in of_class.assumptions
    assert of_class.n_independent < 24.0


def test_rows_with_one_end_are_single_runs():
    im = [0.1, 0.2, 0.31, 0.3, 0.4, 0.5]
    stood = [True, True, False, True, False, False]
    lower = [level if held else None for level, held in zip(im, stood)]
    upper = [None if held else level for level, held in zip(im, stood)]
    found = af.fit({"lower [g]": lower, "upper [g]": upper}, measure="PGA")
    runs = af.fit({"PGA [g]": im, "verdict": np.logical_not(stood)})
    assert found._study.design.kind == "cloud"
    assert bits(found.curve) == bits(runs.curve)
    assert "0.00" not in repr(found.curve)


def test_runs_without_a_verdict_count_as_neither():
    table = stripes()
    lost = table["verdict"].astype(str)
    lost[(table["PGA [g]"] == 0.4) & (table.index % 3 == 0)] = "unfinished"
    lost[(table["PGA [g]"] == 0.3) & (table.index % 5 == 0)] = "failed"
    found = af.fit(table.assign(verdict=lost))
    n_lost = int(lost.isin(["unfinished", "failed"]).sum())
    assert f"{n_lost} runs have no verdict" in found.curve.undecided()
    assert any("unfinished or failed" in each for each in found.cautions)
    without = af.fit(table[~lost.isin(["unfinished", "failed"])]).curve
    assert found.curve.theta == without.theta


def test_words_for_verdicts_and_a_mapping_of_columns():
    table = stripes()
    whole = af.fit(stripes()).curve
    lower = table.rename(columns={"PGA [g]": "pga (g)"})
    assert bits(af.fit(lower).curve) == bits(whole)
    for words in (
        ("fell", "stood"),
        ("yes", "no"),
        (1, 0),
        (1.0, 0.0),
        ("TRUE", "FALSE"),
    ):
        own = pd.DataFrame(
            {
                "motion": table["record"],
                "event": table["event"],
                "peak": table["PGA [g]"],
                "what happened": np.where(table["verdict"], *words),
            }
        )
        columns = {"intensity": "peak", "verdict": "what happened"}
        assert bits(af.fit(own, columns, "PGA", "g").curve) == bits(whole)


@pytest.mark.parametrize("name", ["survived", "Stood"])
def test_in_a_column_of_survivals_one_means_that_it_stood(name):
    table = stripes()
    whole = af.fit(stripes()).curve
    own = table.assign(verdict=~table["verdict"]).rename(
        columns={"verdict": name, "PGA [g]": "pga_g"}
    )
    for words in ((True, False), (1, 0), ("yes", "no"), ("survived", "collapsed")):
        own[name] = np.where(table["verdict"], words[1], words[0])
        assert bits(af.fit(own).curve) == bits(whole)
        named = own.rename(columns={"pga_g": "peak"})
        columns = {"intensity": "peak", "verdict": name}
        assert bits(af.fit(named, columns, "PGA", "g").curve) == bits(whole)


def test_damage_states_are_limit_states_and_the_last_is_collapse():
    table = stripes().drop(columns="verdict")
    found = af.fit(table, states=STATES)
    states = found.curve.limit_states
    assert list(states) == ["light", "moderate", "collapse"]
    medians = [each.theta for each in states.values()]
    assert medians == sorted(medians)
    assert bits(found.curve) == bits(af.fit(stripes()).curve)
    numbers = table.assign(state=table["state"].map(STATES.index))
    again = af.fit(numbers, states=STATES).curve.limit_states
    assert again["light"].theta == states["light"].theta


def test_structures_of_a_class_share_a_curve_and_lose():
    tables = [
        stripes(seed=n).assign(arch=f"a{n}", **{"class": "bridges"}) for n in (3, 4, 5)
    ]
    found = af.fit(pd.concat(tables))
    own = [af.fit(each.drop(columns="class")).curve for each in tables]
    assert (
        min(each.theta for each in own)
        < found.curve.theta
        < max(each.theta for each in own)
    )
    assert np.ptp(np.log(found.curve.theta_interval)) < np.ptp(
        np.log(own[0].theta_interval)
    )
    stock = af.fit(pd.concat(tables).rename(columns={"class": "stock"}))
    assert np.ptp(np.log(stock.curve.theta_interval)) > np.ptp(
        np.log(found.curve.theta_interval)
    )
    assert stock.curve.assumptions.startswith(
        "Its 3 arches are a sample of a larger stock"
    )
    found = af.fit(tables[0].drop(columns=["verdict", "class"]), states=STATES)
    losses = [
        found.losses(HAZARD, consequence={"light": light, "collapse": 1.0})
        for light in (0.0, 0.5)
    ]
    assert losses[0]["aal"].item() == pytest.approx(
        found.risk(HAZARD)["rate"].item(), rel=1e-9
    )
    assert losses[1]["aal"].item() > 1.5 * losses[0]["aal"].item()


def test_risk_exports_and_report_need_no_arch(tmp_path):
    found = af.fit(stripes(), states=(), output=tmp_path / "out")
    assert 0.0 < found.risk(HAZARD).loc["structure", "rate"] < 0.03
    assert "structure" in found.to_nrml(tmp_path / "curve.xml").read_text("utf-8")
    assert "commit none: of a table" in (tmp_path / "curve.xml").read_text("utf-8")
    names = {path.name for path in found.to_csv(tmp_path / "csv")}
    assert "fit-runs.csv" in names
    assert "collapse_joint" not in pd.read_csv(tmp_path / "csv" / "fit-runs.csv")
    page = found.report().read_text("utf-8")
    assert "fitted curves and simulated nothing" in page
    assert "shown one by one" not in page
    assert "24 ground motions" in page
    summary = json.loads((tmp_path / "out" / "summary.json").read_text("utf-8"))
    assert summary["arches"][0]["curve"]["theta"] == pytest.approx(found.curve.theta)
    with pytest.raises(InputError, match="no arch and no motions"):
        found.film()
    with pytest.raises(FitError, match="no other"):
        found.plane()


def test_results_of_a_study_are_not_overwritten(tmp_path):
    path = small_study(tmp_path)
    assert command("run", path, "--quiet").exit_code == 0
    folder = load_study(path).folder
    before = {each: each.read_bytes() for each in folder.iterdir() if each.is_file()}
    stripes().to_csv(tmp_path / "frame.csv", index=False)
    done = command("fit", tmp_path / "frame.csv", "--output", folder, "--format", "csv")
    assert done.exit_code == 4
    assert "holds the results of a study; give another output" in " ".join(
        done.stderr.split()
    )
    assert before == {
        each: each.read_bytes() for each in folder.iterdir() if each.is_file()
    }
    assert not (folder / "export").exists()


def test_no_curve_is_said_with_the_reason():
    found = af.fit({"PGA [g]": [0.1, 0.2, 0.3], "verdict": [0, 0, 0]})
    with pytest.raises(
        FitError, match=r"structure: there is no curve: nothing bounds theta"
    ):
        _ = found.curve


HEAD = "record,event,PGA [g],verdict\n"
GOOD = "a,e,0.1,0\na,e,0.4,1\nb,f,0.2,0\n"
BAD = {
    "runs and brackets": (
        "record,PGA [g],verdict,lower [g],upper [g]\na,0.1,0,1,2\na,0.4,1,1,2\n",
        r"has runs and brackets \(lower \[g\] and upper \[g\] beside PGA \[g\]\); say which",
    ),
    "a verdict that is none": (
        HEAD + GOOD + "b,f,0.5,maybe\n",
        r"line 5, column 'verdict': 'maybe' is no verdict",
    ),
    "an empty verdict": (
        HEAD + GOOD + "b,f,0.5,\n",
        r"line 5, column 'verdict': '' is no verdict",
    ),
    "a code beyond": (
        HEAD + GOOD + "b,f,0.5,7\n",
        r"line 5, column 'verdict': '7' is no verdict",
    ),
    "an intensity that is a word": (
        HEAD + GOOD + "b,f,high,1\n",
        r"line 5, column 'PGA \[g\]': 'high' is no intensity",
    ),
    "a negative intensity": (
        HEAD + GOOD + "b,f,-0.5,1\n",
        r"line 5, column 'PGA \[g\]': '-0.5' is no intensity",
    ),
    "an intensity of nothing": (
        HEAD + GOOD + "b,f,0,1\n",
        r"'0' is no intensity; it must be a number above 0",
    ),
    "an empty intensity": (
        HEAD + GOOD + "b,f,,1\n",
        r"line 5, column 'PGA \[g\]': '' is no intensity",
    ),
    "an infinite intensity": (HEAD + GOOD + "b,f,inf,1\n", r"'inf' is no intensity"),
    "no name of a record": (
        HEAD + GOOD + ",f,0.5,1\n",
        r"line 5, column 'record': '' is no name",
    ),
    "a run twice": (
        HEAD + GOOD + "a,e,0.4,0\n",
        r"line 5, column 'PGA \[g\]': '0.4' is there twice for a, see line 3",
    ),
    "two events of a record": (
        HEAD + GOOD + "b,e,0.5,1\n",
        r"line 5, column 'event': 'e' differs from 'f' in another row of b",
    ),
    "a row that is cut": (HEAD + GOOD + "b,f,0.5\n", r"line 5 has 3 of 4 cells"),
    "a decimal comma": (
        HEAD + GOOD + 'b,f,"0,5",1\n',
        r"line 5: '0,5' has a comma within a number",
    ),
    "no row": (HEAD, r"has no run"),
    "nothing at all": ("", r"is not a table in CSV"),
    "no column of verdicts": (
        "record,PGA [g],peak drift\na,0.1,0.2\n",
        r"needs a column intensity .* it has record, PGA \[g\], peak drift",
    ),
    "no unit": (
        "record,PGA,verdict\na,0.1,0\n",
        r"column 'PGA' states no unit; name it as `PGA \[g\]`, or give unit",
    ),
    "no measure": (
        "record,im [g],verdict\na,0.1,0\n",
        r"column 'im \[g\]' states no measure",
    ),
    "two measures": (
        "PGA [g],PGV [m/s],verdict\n0.1,0.2,0\n",
        r"PGA \[g\] and PGV \[m/s\] may both be the intensity",
    ),
    "two columns of verdicts": (
        "record,PGA [g],verdict,collapsed\na,0.1,0,1\n",
        r"verdict and collapsed may both be the verdict; say which by columns",
    ),
    "a column twice": (
        "record,record,PGA [g],verdict\na,b,0.1,0\n",
        r"column 'record' is there twice",
    ),
    "a bracket upside down": (
        "record,lower [g],upper [g]\na,0.4,0.3\n",
        r"line 2, column 'upper \[g\]': '0.3' is not above 0.4",
    ),
    "a bracket without ends": (
        "record,lower [g],upper [g]\na,0,inf\n",
        r"line 2, column 'upper \[g\]': 'inf' leaves the row without a level",
    ),
    "damage without its states": (
        "record,PGA [g],damage\na,0.1,light\n",
        r"column 'damage' is of damage: states must list all",
    ),
}


@pytest.mark.parametrize(("text", "message"), BAD.values(), ids=BAD)
def test_a_damaged_table_gets_one_sentence(tmp_path, text, message):
    path = tmp_path / "verdicts.csv"
    path.write_text(text)
    measure = "PGA" if "lower" in text else None
    with pytest.raises(InputError, match=message) as caught:
        af.fit(path, measure=measure)
    assert "verdicts.csv" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_verdicts_that_fall_with_intensity_and_few_ones_get_a_caution(tmp_path):
    table = stripes()
    assert af.fit(table).cautions == []
    reversed_ = af.fit(table.assign(verdict=~table["verdict"])).cautions
    assert any("does 1 mean survived here?" in each for each in reversed_)
    few = af.fit(
        {"record": ["a", "b"], "lower [g]": [0.3, 0.3], "upper [g]": [0.4, 0.4]},
        measure="PGA",
    )
    assert any("is from 2 records: the prior" in each for each in few.cautions)
    assert af.fit(table[table["record"].isin([f"r{n}" for n in range(9)])]).cautions
    assert not af.fit(
        table[table["record"].isin([f"r{n}" for n in range(10)])]
    ).cautions
    (tmp_path / "two.csv").write_text("PGA [g],verdict\n0.3,0\n0.4,1\n")
    done = command("fit", tmp_path / "two.csv", "--output", tmp_path / "out")
    assert "the curve is from 2 records" in " ".join(done.stdout.split())


def test_the_results_have_the_cautions_of_the_terminal(tmp_path):
    fell = {"PGA [g]": [0.1, 0.2, 0.3], "verdict": [1, 1, 1]}
    (first, *_), (second, *_) = (
        af.fit(table).cautions
        for table in (
            fell,
            {"PGA [g]": [0.3, 0.3], "record": ["a", "b"], "verdict": [0, 1]},
        )
    )
    assert first.startswith("structure: no curve: nothing bounds theta")
    assert second.startswith("structure: no curve: ") or "records" in second
    path = small_study(tmp_path)
    done = command("run", path)
    assert done.exit_code == 0
    printed = " ".join(done.stdout.split())
    for each in af.open(path).cautions:
        assert " ".join(each.split()) in printed or ": no curve: " in each


def test_columns_may_choose_runs_or_brackets():
    table = stripes().assign(lower=1.0, upper=2.0)
    by = {"intensity": "PGA [g]", "verdict": "verdict"}
    assert bits(af.fit(table, by).curve) == bits(af.fit(stripes()).curve)
    chosen = table.groupby("record").first().reset_index()
    found = af.fit(chosen, {"lower": "lower", "upper": "upper"}, "PGA", "g")
    assert 1.0 < found.curve.theta < 2.0


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            {"columns": {"intensity": 0, "verdict": 1}, "confidence": "0.9"},
            "confidence is '0.9'",
        ),
        ({"columns": ["PGA", "verdict"]}, "columns is .* it must be a mapping"),
        ({"columns": {"intensity": 5}}, "has no column '5', but 0, 1"),
        ({"states": "ab"}, "states are 'ab'; they must be a list of different names"),
        ({"states": ["none", "none", "collapse"]}, "list of different names"),
        ({"states": ["None ", "none", "collapse"]}, "list of different names"),
        ({"states": ["none", "collapse"]}, "no column of damage states"),
    ],
)
def test_odd_arguments_get_one_sentence(given, message):
    table = pd.DataFrame([[0.1, 0], [0.3, 1], [0.5, 1]])
    mapping = {"columns": {"intensity": 0, "verdict": 1}, "measure": "PGA", "unit": "g"}
    assert af.fit(table, **mapping).curve.theta == pytest.approx(0.2, rel=0.3)
    with pytest.raises(InputError, match=message):
        af.fit(table, **mapping | given)


def test_the_command_prints_the_curve_and_writes_the_report(tmp_path):
    stripes().to_csv(tmp_path / "frame.csv", index=False)
    pd.DataFrame(HAZARD, columns=["PGA [g]", "rate"]).to_csv(
        tmp_path / "hazard.csv", index=False
    )
    options = "--output", tmp_path / "out", "--hazard", tmp_path / "hazard.csv"
    done = command("fit", tmp_path / "frame.csv", *options, "--format", "nrml-discrete")
    assert done.exit_code == 0, done.output
    curve = af.fit(tmp_path / "frame.csv").curve
    assert curve.words()[0] in " ".join(done.stdout.split())
    assert "a year" in done.stdout
    assert (tmp_path / "out" / "export" / "frame-fragility-discrete.xml").is_file()
    made = {
        "report.html",
        "summary.json",
        "fits.json",
        "curve.csv",
        "runs.csv",
        "export",
    }
    assert made <= {path.name for path in (tmp_path / "out").iterdir()}
    stored = json.loads((tmp_path / "out" / "fits.json").read_text("utf-8"))
    assert stored["fits"]["structure"]["theta"] == pytest.approx(
        9.80665 * curve.theta, rel=1e-12
    )


def test_the_command_takes_a_mapping_and_names_a_bad_row(tmp_path):
    path = tmp_path / "tests.csv"
    path.write_text("peak;fell\n0,2;no\n0,3;yes\n0,25;perhaps\n")
    options = (
        "--columns",
        "intensity=peak,verdict=fell",
        "--measure",
        "PGA",
        "--unit",
        "g",
    )
    done = command("fit", path, *options)
    assert done.exit_code == 2
    assert "line 4, column 'fell': 'perhaps' is no verdict" in done.stderr
    done = command("fit", path, "--columns", "peak")
    assert done.exit_code == 2
    assert "--columns peak: write it as WHAT=NAME" in done.stderr


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (
            {"PGA [g]": [0.1, 0.2], "verdict": [1]},
            "is no table .*; give a file, a DataFrame",
        ),
        (5, "is no table"),
        (
            pd.DataFrame({("a", "PGA [g]"): [0.1], ("b", "verdict"): [0]}),
            "needs a column",
        ),
        (
            pd.DataFrame([[0.1, 0, 1]], columns=["PGA [g]", "verdict", "verdict"]),
            "is there twice",
        ),
    ],
    ids=["lengths", "number", "levels", "twice"],
)
def test_what_is_no_table(table, message):
    with pytest.raises(InputError, match=message):
        af.fit(table)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            {"columns": {"verdikt": "x"}},
            "columns: 'verdikt' is not known; allowed are arch",
        ),
        ({"columns": {"verdict": "x"}}, r"columns: .* has no column 'x', but record"),
        ({"measure": "PGV"}, r"states PGA, but measure is PGV"),
        ({"unit": "m/s2"}, r"states g, but unit is m/s2"),
        ({"confidence": 90}, "confidence is 90; it lies between 0 and 1"),
        ({"columns": {"state": "verdict"}, "states": STATES}, "'0' is no damage"),
    ],
    ids=["what", "column", "measure", "unit", "confidence", "state"],
)
def test_an_option_that_cannot_be_used(given, message):
    if "states" in given:
        given["columns"] = {"state": "verdict"}
        table = io.StringIO((HEAD + GOOD).replace(",0\n", ",broken\n"))
        message = (
            "'broken' is no damage state; they are none, light, moderate, collapse"
        )
    else:
        table = io.StringIO(HEAD + GOOD)
    with pytest.raises(InputError, match=message):
        af.fit(pd.read_csv(table), **given)


def test_runs_of_a_class_without_a_verdict_bound_its_own_median():
    """The curve of a class is the mean of those of its arches, also if the runs had collapsed."""
    tables = [stripes(seed=n).assign(arch=f"a{n}", **{"class": "c"}) for n in (3, 4, 5)]
    strong = tables[2]
    first = strong[strong["verdict"]].groupby("record")["PGA [g]"].min()
    strong["verdict"] = strong["PGA [g]"] > 2.97 * strong["record"].map(first).fillna(
        9.0
    )
    table = pd.concat(tables, ignore_index=True).astype({"verdict": str})
    table.loc[[3, 60], "verdict"] = "unfinished"
    found = af.fit(table)
    collapsed, survived = found.curve.extremes
    assert collapsed.theta < found.curve.theta < survived.theta
    assert "2 runs have no verdict" in found.curve.undecided()


def test_the_report_of_a_table_opens_with_a_sentence_and_has_no_unknown_mechanism(
    tmp_path,
):
    levels = (0.1, 0.2, 0.2, 0.3, 0.3, 0.4, 0.4, 0.5, 0.6)
    verdicts = ("survived " * 2 + "collapsed survived " * 3 + "collapsed").split()
    rows = [f"{level},{verdict}" for level, verdict in zip(levels, verdicts)]
    (tmp_path / "t.csv").write_text("\n".join(["PGA [g],verdict", *rows]) + "\n")
    (tmp_path / "h.csv").write_text("PGA [g],rate\n0.1,0.02\n0.3,0.004\n1.0,0.0003\n")
    given = "fit", tmp_path / "t.csv", "--columns", "intensity=PGA [g],verdict=verdict"
    done = command(*given, "--hazard", tmp_path / "h.csv", "--output", tmp_path / "out")
    assert done.exit_code == 0, done.stderr
    page = (tmp_path / "out" / "report.html").read_text()
    assert "collapses with probability <strong>" in page
    assert "not known 100" not in page
