"""Surfaces of a movement of a springing and shaking: corners, border, tables, and refusals."""

import numpy as np
import pandas as pd
import pytest
import scipy

import archfrag as af
from archfrag.errors import InputError, StabilityError
from tests.study.small import TEXT, command, small_study

RING = "profile: segmental, span: 6.0, rise: 2.0, thickness: 0.6, friction: 0.6, voussoirs: 5"
ROWS = "id,springings.settlement [m]\nmore,0.2\nnone,0\nlittle,0.1\n"


def study_of(folder, arches, rows=ROWS):
    head, _, rest = TEXT.partition("arches:")
    (folder / "rows.csv").write_text(rows)
    text = f"{head}arches:\n{arches}\nmotions:{rest.partition('motions:')[2]}"
    return small_study(folder, text.replace("[0.1, 0.6, 1.2]", "[0.3, 0.6, 1.2, 2.4]"))


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    arches = f"""
  - {{id: set, table: rows.csv, {RING}}}
  - {{id: as built, {RING}}}
  - {{id: settled, {RING}, springings: {{settlement: 0.2}}}}""".replace(
        "as built", "built"
    )
    path = study_of(tmp_path_factory.mktemp("surface"), arches)
    done = command("run", path)
    assert done.exit_code == 0, done.output
    return af.open(path)


@pytest.fixture(scope="module")
def surface(results):
    return results.surface("set")


def test_corners_equal_single_studies(results, surface):
    im = np.array([0.0, 0.3, 0.8, 2.0])
    assert surface.movements.tolist() == [0.0, 0.1, 0.2]
    for movement, alone in ((0.0, "built"), (0.2, "settled")):
        np.testing.assert_array_equal(
            surface.at(movement, im), results.curves[alone](im)
        )
        table = surface.to_dataframe(im)
        own = table[table["settlement [m]"] == movement]
        single = results.curves[alone].to_dataframe(im)
        for name in ("probability", "lower", "upper"):
            np.testing.assert_array_equal(own[name], single[name])


def test_between_arches_ln_theta_and_beta_are_linear(results, surface):
    one, two = (results.curves[name] for name in ("none", "little"))
    theta = one.theta**0.7 * two.theta**0.3
    beta = 0.7 * one.beta + 0.3 * two.beta
    expected = scipy.stats.norm.cdf(np.log(np.array([0.5, 1.5]) / theta) / beta)
    np.testing.assert_allclose(surface.at(0.03, [0.5, 1.5]), expected, rtol=1e-12)
    assert np.isnan(surface.at([-0.01, 0.21], 0.5)).all()
    contours = surface.contours([0.1, 0.5])
    np.testing.assert_allclose(
        surface.at(contours.index, contours[0.1]), 0.1, rtol=1e-12
    )
    assert contours[0.5].loc[0.1] == pytest.approx(two.theta)


def test_the_border_is_where_the_arch_falls_without_an_earthquake(surface):
    (border,) = surface.border
    ring = af.Arch.segmental(6.0, 2.0, 0.6, voussoirs=5, friction=0.6)
    assert af.move_springing(ring, settlement=border - 1e-3).n_voussoir == 5
    with pytest.raises(StabilityError, match="the arch falls at settlement"):
        af.move_springing(ring, settlement=border + 1e-3)
    path = af.springing_path(ring, settlement=1.5 * border)
    assert abs(path.limit * 1.5 * border - border) < 1e-3


def test_report_and_export(results, surface, tmp_path):
    page = (results.folder / "report.html").read_text("utf-8")
    assert page.count("Movement of a springing, and shaking") == 1
    files = {each.stem.rpartition("-")[2]: each for each in results.to_csv(tmp_path)}
    table = pd.read_csv(files["surface"])
    assert {*table.movement} == {"settlement"}
    np.testing.assert_allclose(table.falls_at, surface.border[0], rtol=1e-9)
    found = surface.at(table.moved, table.im)
    np.testing.assert_allclose(table.probability, found, rtol=1e-8, atol=1e-12)
    assert (table.lower <= table.probability).all()


def test_what_has_no_surface(results):
    for name in (None, "settled", "nowhere"):
        with pytest.raises(InputError, match="must differ in one movement of one"):
            results.surface(name)


def test_movements_that_vary_are_sampled_and_checked(tmp_path):
    law = "{distribution: uniform, start: 0.0, stop: %s}"
    vary = f"vary: {{samples: 2, of: {{springings.settlement: {law}}}}}"
    path = study_of(tmp_path, f"  - {{id: set, {RING}, {vary % '0.1'}}}")
    assert command("validate", path).exit_code == 0
    path = study_of(tmp_path, f"  - {{id: set, {RING}, {vary % '1000'}}}")
    done = command("validate", path)
    assert done.exit_code != 0
    assert "settlement" in done.stderr
    assert len(done.stderr.splitlines()) < 5


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("id,springings.settlement\na,3\nb,0\n", "falls at settlement"),
        ("id,springings.settlement [cm]\na,3\nb,0\n", "springings.settlement is in m"),
        ("id,springings.sinking\na,3\nb,0\n", "springings.sinking is not a key"),
    ],
    ids=["beyond the border", "other unit", "no key"],
)
def test_wrong_tables_are_refused_before_a_run(tmp_path, rows, message):
    path = study_of(tmp_path, f"  - {{id: set, table: rows.csv, {RING}}}", rows)
    done = command("validate", path)
    assert done.exit_code != 0
    assert message in done.stderr


def test_a_block_has_no_springings(tmp_path):
    block = "profile: block, width: 0.4, height: 2.0, friction: 0.7"
    path = study_of(tmp_path, f"  - {{id: set, table: rows.csv, {block}}}")
    done = command("validate", path)
    assert done.exit_code != 0
    assert "springings" in done.stderr
