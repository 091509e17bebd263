"""Designs on made-up verdicts and on real runs: what they ask for, find, and keep as they grow."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from scipy.special import ndtri

import archfrag as af
from archfrag.fragility.quoted import capacity_posterior, quoted_band
from archfrag.fragility.verdicts import Verdict, find_brackets
from archfrag.physics.status import CollapseMode
from archfrag.study.answer.cube import open_cube
from archfrag.study.answer.fits import fit_cube
from archfrag.study.designs import CASE, NEAR, Grid, Ida, ask, drive, order_of
from archfrag.study.file.prepared import load_record, prepare_motions
from archfrag.study.file.schema import load_study
from archfrag.study.runs.execute import run_batch
from archfrag.study.runs.store import COLUMNS, Plan
from tests.study.small import (
    TEXT,
    assert_compliant,
    changed,
    command,
    cube_of,
    small_study,
    write_at2,
)

LEVELS = np.linspace(0.05, 0.75, 15)
FINE = np.exp(0.3 * np.linspace(-2.5, 2.5, 15))


def driven(design, table, levels=LEVELS):
    """What a design returns, all cells that it asked for, none twice, and their verdicts."""
    n, n_level = table.shape
    grid = Grid(0, np.arange(n), levels[:n_level], np.ones(n), 1.0)
    cases, notes = ask(
        {0: design.requests(grid)},
        lambda cases: table[cases["record"], cases["place"]].astype(np.int8),
    )
    asked = np.column_stack([cases["record"], cases["place"]])
    assert len(asked) == len(np.unique(asked, axis=0)), "a cell was asked for twice"
    seen = np.full_like(table, Verdict.NOT_RUN)
    cells = tuple(asked.T)
    seen[cells] = table[cells]
    return notes[0], asked, seen


def bracketed(seen):
    """The highest standing and the lowest collapsing level among the runs made, by record."""
    place = np.arange(seen.shape[1])
    low = np.where(seen == Verdict.SURVIVED, place, -1).max(axis=1)
    return low, np.where(seen == Verdict.COLLAPSED, place, place.size).min(axis=1)


class TestIda:
    @pytest.mark.parametrize("n_level", [1, 2, 3, 15])
    def test_brackets_end_at_the_borders_or_at_failures_beside_them(self, n_level):
        generator = np.random.default_rng(3)
        first = generator.integers(0, n_level + 1, 200)  # n_level: it stands everywhere
        table = (np.arange(n_level) >= first[:, None]).astype(np.int8)
        low, high = bracketed(driven(Ida(kind="ida", checks=0), table)[2])
        np.testing.assert_array_equal([low, high], [first - 1, first])
        table[generator.random(table.shape) < 0.3] = Verdict.FAILED
        low, high = bracketed(driven(Ida(kind="ida", checks=0), table)[2])
        assert np.all((low < first) & (first <= high))
        for row, start, end in zip(table, low + 1, high):
            assert (row[start:end] == Verdict.FAILED).all()

    def test_thirty_records_on_fifteen_levels_take_150_runs(self):
        runs = []
        for seed in range(60):
            capacity = 0.3 * np.exp(
                0.4 * np.random.default_rng(seed).standard_normal(30)
            )
            table = (capacity[:, None] <= LEVELS).astype(np.int8)
            note, asked, seen = driven(Ida(kind="ida"), table)
            assert note["runs"] == len(asked)
            assert (note["records"], note["checked"], note["contradictions"]) == (
                30,
                30,
                0,
            )
            low, high = bracketed(seen)
            np.testing.assert_array_equal(high - low, 1)
            runs.append(note["runs"])
        assert np.mean(runs) <= 150

    def test_checks_find_contradictions_near_the_borders_at_their_rate(self):
        """A tenth of the cells are flipped, which also misleads the search."""
        rates = []
        for seed in range(12):
            capacity = 0.3 * np.exp(
                0.4 * np.random.default_rng(seed).standard_normal((100, 1))
            )
            table = (capacity <= LEVELS).astype(np.int8)
            near = np.abs(np.arange(15) - np.searchsorted(LEVELS, capacity) + 0.5) < 1
            flipped = np.random.default_rng([seed, 2]).random(table.shape) < 0.1
            spoilt = np.where(flipped & ~near, 1 - table, table)
            for checks in (10**6, 100):
                note, asked, _ = driven(
                    Ida(kind="ida", checks=checks, seed=seed), spoilt
                )
                assert note["checked"] == checks or checks > 100
                rates.append(note["contradictions"] / note["checked"])
        searched, (rows, places) = np.full_like(spoilt, Verdict.NOT_RUN), asked[:-100].T
        searched[rows, places] = spoilt[rows, places]
        low, high = bracketed(searched)
        rows, places = asked[-100:].T
        assert np.all((places >= low[rows] - NEAR) & (places <= high[rows] + NEAR))
        assert 0.08 < np.mean(rates[::2]) < 0.2
        assert np.mean(rates[1::2]) == pytest.approx(np.mean(rates[::2]), abs=0.02)

    def test_curve_is_that_of_stripes_where_single_runs_scatter(self):
        """The same verdicts, half of the records not monotone: theta to 1 %, beta to 5 %."""
        off = []
        for seed in range(40):
            generator = np.random.default_rng(seed)
            capacity = 0.4 * generator.standard_normal((30, 1))
            capacity = 0.3 * np.exp(
                capacity + 0.2 * generator.standard_normal((30, 15))
            )
            table = (capacity <= LEVELS).astype(np.int8)
            one, other = (
                capacity_posterior(find_brackets(verdict, LEVELS))[0].curve
                for verdict in (driven(Ida(kind="ida", seed=seed), table)[2], table)
            )
            pairs = (
                one.theta / other.theta,
                one.beta / other.beta,
                one.beta / np.sqrt(0.2),
            )
            off.append(np.log(pairs))
        assert np.all(np.abs(np.mean(off, axis=0)) < [0.01, 0.05, 0.05])


def test_ida_asks_for_the_same_runs_whatever_other_measures_the_records_have(done):
    """Levels chosen with knowledge that the likelihood has not would make beta too large."""
    capacity = np.exp(0.4 * np.random.default_rng(1).standard_normal(30))
    levels = np.linspace(0.2, 3.0, 15)
    one = done.plan.records[0]
    study = done.study.model_copy(update={"design": Ida(kind="ida")})
    asked = []
    for known in (capacity, capacity[::-1]):
        records = [
            replace(one, id=f"r{i}", measures={**one.measures, "PGV": float(value)})
            for i, value in enumerate(known)
        ]
        plan = Plan(study, done.study.members[:1], tuple(records))
        plan.__dict__["levels"] = levels
        cases, _ = ask(
            plan.requests(),
            lambda own: (capacity[own["record"]] <= levels[own["place"]]).astype(
                np.int8
            ),
        )
        asked.append(cases.tolist())
    assert asked[0] == asked[1]


@pytest.mark.parametrize("seed", range(3))
def test_the_order_in_which_runs_are_made_changes_nothing_that_ida_asks_for(seed):
    generator = np.random.default_rng(seed)
    table = (0.4 * np.exp(0.5 * generator.standard_normal((40, 15))) <= LEVELS).astype(
        np.int8
    )
    table[generator.random(table.shape) < 0.1] = Verdict.FAILED
    waiting = np.empty(0, CASE)

    def some(cases):
        nonlocal waiting
        waiting = generator.permutation(np.concatenate([waiting, cases]))
        made, waiting = np.split(waiting, [generator.integers(1, len(waiting) + 1)])
        return made, table[made["record"], made["place"]].astype(np.int8)

    def requests():
        grid = Grid(0, np.arange(40), LEVELS, np.ones(40), 1.0)
        return {0: Ida(kind="ida", seed=seed).requests(grid)}

    every = ask(
        requests(), lambda cases: table[cases["record"], cases["place"]].astype(np.int8)
    )
    asked = drive(requests(), some)
    np.testing.assert_array_equal(
        *(cases[order_of(cases)] for cases in (asked[0], every[0]))
    )
    assert asked[1] == every[1]


def test_a_record_does_not_wait_for_the_runs_of_another():
    """The runs of the first record are made last: meanwhile the nine others are searched."""
    waiting = np.empty(0, CASE)
    order = []

    def last(cases):
        nonlocal waiting
        waiting = np.concatenate([waiting, cases])
        chosen = waiting["record"] != 0
        if not chosen.any():
            chosen = ~chosen
        made = waiting[chosen]
        waiting = waiting[~chosen]
        order.extend(made["record"].tolist())
        return made, (made["place"] >= 7).astype(np.int8)

    grid = Grid(0, np.arange(10), LEVELS, np.ones(10), 1.0)
    _, facts = drive({0: Ida(kind="ida", checks=0).requests(grid)}, last)
    alone = order.count(0)
    assert (facts[0]["runs"], order.count(9), order[-alone:]) == (
        10 * alone,
        alone,
        [0] * alone,
    )
    assert alone > 2


DESIGNS = {
    "stripes": "{kind: stripes}",
    "ida": "{kind: ida, checks: 2}",
    "cloud": "{kind: cloud, factor: 2.0}",
}
THIRD = (
    "  - {id: plate, profile: block, width: 0.5, height: 2.0, friction: .inf}\nmotions:"
)
GROWN = {
    "level": TEXT.replace("0.6, 1.2]", "0.6, 0.9, 1.2]"),
    "arch": TEXT.replace("motions:", THIRD),
    "record": TEXT,
}


def study_of(folder, design, text=TEXT, records=2):
    path = small_study(folder, text + f"design: {DESIGNS[design]}\n")
    time = np.arange(150) * 0.01
    for number in range(2, records):
        wave = 0.2 * np.sin(3 * number * time) * np.sin(np.pi * time / 1.5)
        write_at2(folder / "records" / f"wave{number}.AT2", wave, 0.01)
    return load_study(path)


@pytest.mark.parametrize("grown", GROWN)
@pytest.mark.parametrize("design", DESIGNS)
def test_a_study_that_grows_and_goes_back_makes_only_the_new_runs(
    tmp_path, design, grown
):
    before, _ = cube_of(study_of(tmp_path / "grown", design))
    given = design, GROWN[grown], 3 if grown == "record" else 2
    log, second = cube_of(study_of(tmp_path / "grown", *given))
    full, third = cube_of(study_of(tmp_path / "full", *given))
    assert (before["kept"], full["kept"], log["runs"]) == (0, 0, full["runs"])
    xr.testing.assert_identical(second, third)
    if design in ("stripes", "cloud") or grown == "arch":
        assert log["kept"] == before["runs"]
    else:
        assert log["kept"] >= before["runs"] - 4  # checks may be elsewhere
    if grown != "record":
        back, _ = cube_of(study_of(tmp_path / "grown", design))
        assert back["kept"] == back["runs"] == before["runs"]


def test_ida_asks_for_the_same_runs_whatever_the_order_of_arches_and_records(tmp_path):
    """Names decide: other places, and other arches before them, change nothing."""
    study = study_of(tmp_path, "ida").model_copy(update={"design": Ida(kind="ida")})
    levels = study.intensity.model_copy(update={"levels": LEVELS.tolist()})
    study = study.model_copy(update={"intensity": levels})
    ring, slab = study.members
    arches = (
        ring,
        slab,
        replace(ring, entry=ring.entry.model_copy(update={"id": "other"})),
    )
    records = [
        SimpleNamespace(id=f"r{number}", factor=1.0, levels=[]) for number in range(24)
    ]
    border = {
        record.id: place for record, place in zip(records, 2 + 3 * np.arange(24) % 11)
    }

    def asked(arches, records):
        plan = Plan(study, tuple(arches), tuple(records), identity="")

        def verdicts(cases):
            names = [records[record].id for record in cases["record"]]
            borders = np.array([border[name] for name in names])
            # Every fifth run contradicts the border of its record.
            noise = (7 * borders + 3 * cases["place"]) % 5 == 0
            return ((cases["place"] >= borders) ^ noise).astype(np.int8)

        cases, facts = ask(plan.requests(), verdicts)
        found = {}
        for case in cases:
            own = found.setdefault(arches[case["arch"]].id, set())
            own.add((records[case["record"]].id, int(case["place"])))
        return {name: sorted(own) for name, own in found.items()}, {
            arches[arch].id: each for arch, each in facts.items()
        }

    runs, facts = asked(arches, records)
    assert runs["ring"] != runs["slab"]  # each arch has checks of its own
    assert facts["ring"]["contradictions"] > 0
    for order in (arches[::-1], arches[:1]):
        for turned in (records[::-1], records[12:] + records[:12]):
            again = asked(order, turned)
            assert again == tuple(
                {each.id: whole[each.id] for each in order} for whole in (runs, facts)
            )


def known_of(response):
    known = vars(response) | response.work | response.events
    known |= {"contact_residual": response.residual, "fallbacks": response.fallbacks}
    for name in ("collapse_mode", "lost_contact_mode"):
        known[name] = CollapseMode[known[name].upper()]
    return known | {"model_time": list(response.model_time.values())}


@pytest.mark.parametrize("design", DESIGNS)
def test_cube_of_each_design_made_in_batches(tmp_path, design):
    study = study_of(tmp_path, design, records=3)
    prepare_motions(study)
    shared = changed(study, "execution", batches=3)
    logs = [run_batch(shared, number, quiet=True)[0] for number in range(3)]
    log, cube = cube_of(study)
    assert log["runs"] == log["kept"] == sum(each["runs"] for each in logs)
    assert sum(each["kept"] for each in logs) == 0
    stored = cube
    cube = open_cube(study)
    assert stored["verdict"].dims[2] == ("level" if design == "cloud" else "intensity")
    assert stored["intensity"].attrs["unit"] == "g"
    np.testing.assert_allclose(
        stored["intensity"] * 9.80665, stored["intensity_si"], rtol=1e-15
    )
    made = cube["verdict"].values != 4
    note = json.loads(cube.attrs["archfrag_design"])
    assert note["kind"] == design
    assert set(note["arches"]) == {"ring", "slab"}
    assert made.sum() == log["runs"]
    assert design != "ida" or made.sum() == sum(
        each["runs"] for each in note["arches"].values()
    )
    assert ((cube["status"].values == -1) == ~made).all()
    assert (np.isnan(cube["peak_rotation"].values) == ~made).all()
    assert (cube["steps"].values[~made] == -1).all()
    own = design == "cloud"
    assert cube["verdict"].shape == (2, 3, 1 if own else 3)
    assert cube["intensity"].dims == (
        ("arch", "record", "level") if own else ("level",)
    )
    assert cube["scale_factor"].dims == (("arch",) if own else ()) + ("record", "level")
    if design == "cloud":
        np.testing.assert_allclose(cube["scale_factor"], 2.0, rtol=1e-14)
    pga = cube["record_measure"].sel(measure="PGA")
    reached = (cube["scale_factor"] * pga).broadcast_like(cube["verdict"])
    levels = cube["intensity"].broadcast_like(cube["verdict"])
    np.testing.assert_allclose(reached.values[made], levels.values[made], rtol=1e-12)
    records = prepare_motions(study)
    for arch, record, level in np.argwhere(made)[[0, 1, -1]]:
        place = {"arch": arch, "record": record, "level": level}
        factor = cube["scale_factor"].isel(
            {k: place[k] for k in cube["scale_factor"].dims}
        )
        response = af.simulate(
            study.arches[arch].build(),
            load_record(study.work, records[record]),
            scale=factor.item(),
            method="time_stepping",
            dt=2e-3,
            follow=2.0,
        )
        known = known_of(response)
        assert {column.name for column in COLUMNS} - set(known) == {
            "verdict",
            "moving_before",
        }
        for name in set(known) & set(cube):
            np.testing.assert_array_equal(
                cube[name].isel(place), known[name], err_msg=name
            )
    if design == "cloud":
        assert set(fit_cube(study).arches["ring"].cloud) == {"logistic"}
    assert_compliant(study.folder / "cube.nc", tmp_path)


@pytest.mark.parametrize("design", ["{kind: cloud, factor: 1.9}", "{kind: stripes}"])
def test_a_study_of_which_no_run_was_decided_says_what_to_change(tmp_path, design):
    """At the end of these records both arches move, and nobody waits for them."""
    text = TEXT.replace("follow: 2.0", "follow: 0.0").replace(
        "[0.1, 0.6, 1.2]", "[0.8]"
    )
    path = small_study(tmp_path, f"{text}design: {design}\n")
    result = command("run", path)
    assert result.exit_code == 0, result.output
    found = json.loads((tmp_path / "out" / "fits.json").read_text())
    for name in ("ring", "slab"):
        assert found["arches"][name]["curve"]["none"] == (
            "no run collapsed or survived, so there is nothing to fit: if arches still moved at "
            "the end, raise method.follow; if they failed, try another method.name"
        )
    assert "raise method.follow" in " ".join(result.stdout.split())


def test_single_runs_that_share_events_count_as_fewer():
    """8 events with 3 runs each: 90 % bands that ignore this hold in 79 to 87 %."""
    generator = np.random.default_rng(4)
    held = []
    probability = np.array([0.1, 0.25, 0.5, 0.75, 0.9])
    event = np.arange(24) // 3
    number = []
    for _ in range(80):
        im = np.exp(0.5 * generator.standard_normal((24, 1)))
        z = generator.standard_normal((8, 1)) + generator.standard_normal((8, 3))
        found = find_brackets(np.exp(0.4 * z.reshape(-1, 1) / np.sqrt(2.0)) <= im, im)
        known = quoted_band(
            found,
            np.exp(0.4 * ndtri(probability)),
            confidence=0.9,
            groups=event,
            unit="event",
        )
        held.append(
            np.mean((known.lower <= probability) & (known.upper >= probability))
        )
        number.append(known.n_independent)
    assert 0.87 < np.mean(held) < 0.97
    assert 12.0 < np.median(number) < 19.0
    assert capacity_posterior(found)[1] == 24.0
