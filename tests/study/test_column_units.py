"""Units in the names of columns of every table, each read or refused; and what is no number."""

from pathlib import Path

import numpy as np
import pytest

import archfrag as af
from archfrag.errors import InputError
from archfrag.fragility.several import checked_ratios
from archfrag.motions.formats.columns import parse_columns
from archfrag.motions.index import load_index
from archfrag.motions.measures import parse_measure
from archfrag.motions.selection import read_flatfile, read_targets
from archfrag.study.file.arches import ArchEntry
from archfrag.study.file.members import expand
from archfrag.study.file.schema import load_study
from archfrag.study.hazard import load_hazard
from archfrag.study.yaml_text import parse_value, yaml_of
from tests.study.small import command, small_study

LOWER = np.array([0.2, 0.3, 0.25, 0.4])
UPPER = np.array([0.3, 0.4, 0.35, 0.5])
G = 9.80665
RUNS = "record,{},verdict\n" + "".join(
    f"r{n},{level * 0.1:g},{int(level > 2 + n % 3)}\n"
    for n in range(8)
    for level in range(1, 6)
)
ARCH = {
    "id": "all",
    "profile": "circular",
    "radius": 10.0,
    "thickness": 1.5,
    "embrace": 157.5,
    "voussoirs": 7,
    "friction": 0.7,
}


def bracket(lower, upper, factors=(1.0, 1.0), **given):
    """Fit brackets that are in g, each end times a factor."""
    rows = {
        "record": list("abcd"),
        lower: factors[0] * LOWER,
        upper: factors[1] * UPPER,
    }
    return af.fit(rows, measure="PGA", **given).curve.theta


def rows_of(head, cell=2000.0, **more):
    """List the arches of a table with one column."""
    Path("arches.csv").write_text(f"id,{head}\none,{cell}\n")
    return expand([ArchEntry.model_validate({**ARCH, **more, "table": "arches.csv"})])


def runs(head, **given):
    Path("runs.csv").write_text(RUNS.format(head))
    return af.fit("runs.csv", **given).curve


def hazard(head, measure="PGA", unit=None, site=None):
    Path("hazard.csv").write_text(f"{head}\n0.1,0.1\n0.5,0.05\n")
    return load_hazard([Path("hazard.csv")], measure, unit, site)


def index(column, cell=1):
    Path("index.csv").write_text(f"id,file,unit,{column}\na,a.txt,g,{cell}\n")
    return load_index("index.csv")


def target(head):
    Path("target.csv").write_text(f"{head}\n0.5,0.3,0.1\n1.0,0.2,0.1\n")
    return read_targets("target.csv")[None]


def flatfile(column):
    Path("flat.csv").write_text(f"record,{column}\na,0.1\n")
    return read_flatfile("flat.csv")


REFUSED = {
    "a bracket with one unit": lambda: bracket("lower [g]", "upper"),
    "--unit over one of two": lambda: bracket("lower", "upper [m/s2]", unit="g"),
    "a bracket of another quantity": lambda: bracket("lower [g]", "upper [m]"),
    "a bracket in mm/s2": lambda: bracket("lower [g]", "upper [mm/s2]"),
    "brackets named by hand": lambda: bracket(
        "PGA stood [g]",
        "fell [mg]",
        columns={"lower": "PGA stood [g]", "upper": "fell [mg]"},
    ),
    "brackets of two measures": lambda: bracket(
        "PGA [g]", "Sa(0.5) [g]", columns={"lower": "PGA [g]", "upper": "Sa(0.5) [g]"}
    ),
    "runs in s": lambda: runs("PGA [s]"),
    "runs in mm/s2": lambda: runs("PGA [mm/s2]"),
    "runs in mm/s2 with --unit": lambda: runs("PGA [mm/s2]", unit="g"),
    "runs in m/s2 with --unit g": lambda: runs("PGA [m/s2]", unit="g"),
    "runs in g_ with --unit": lambda: runs("PGA_g", unit="m/s2"),
    "a velocity in g": lambda: runs("PGV [g]"),
    "a spectral acceleration in cm": lambda: runs("Sa(0.5) [cm]"),
    "an intensity in %": lambda: runs("im [%]", measure="PGA", unit="g"),
    "named by hand, in percent of g": lambda: runs(
        "PGA [%g]", columns={"intensity": "PGA [%g]", "verdict": "verdict"}, unit="g"
    ),
    "another measure than asked": lambda: runs("PGV [m/s]", measure="PGA"),
    "a hazard in cm/s with PGA": lambda: hazard("PGA [cm/s],rate"),
    "a hazard in m/s2 with --unit g": lambda: hazard("PGA [m/s2],rate", unit="g"),
    "a hazard in mm/s2": lambda: hazard("im (mm/s2),rate", unit="g"),
    "rates by month": lambda: hazard("PGA [g],rate [1/month]"),
    "probabilities in percent": lambda: hazard("PGA [g],poe_50 [%]"),
    "return periods in days": lambda: hazard("PGA [g],return period [days]"),
    "a hazard of PGV": lambda: hazard("PGV [m/s],rate"),
    "density in t/m3": lambda: rows_of("density [t/m3]", 2.0),
    "density in N/m3": lambda: rows_of("density (N/m3)"),
    "span in mm": lambda: rows_of("radius [mm]", 10000),
    "radius in ft": lambda: rows_of("radius (ft)", 30),
    "embrace in rad": lambda: rows_of("embrace [rad]", 2.7),
    "friction as an angle": lambda: rows_of("friction [deg]", 35),
    "joints in GPa/m": lambda: rows_of("joints.stiffness [GPa/m]", 20),
    "strength in MPa": lambda: rows_of("strength [MPa]", 5),
    "a dead load in kN": lambda: rows_of("dead_load [kN]", 5),
    "a number of voussoirs in m": lambda: rows_of("voussoirs [m]", 7),
    "joints": lambda: rows_of("joints", 2e10),
    "fill.unit_weight": lambda: rows_of("fill.unit_weight", 18000),
    "Density (kg/m3)": lambda: rows_of("Density (kg/m3)"),
    "an attribute with a unit": lambda: rows_of("height above sea [m]", 7),
    "a distance in m": lambda: index("distance [m]"),
    "a distance_m": lambda: index("distance_m"),
    "Vs30 in km/s": lambda: index("Vs30 [km/s]"),
    "dt in ms": lambda: index("dt_ms"),
    "a target in m/s2": lambda: target("period_s,Sa_g [m/s2],sd"),
    "a scatter in percent": lambda: target("period_s,Sa_g,sd [%]"),
    "a flatfile in m/s2": lambda: flatfile("T0.500S [m/s2]"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_another_unit_is_refused_with_the_column(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError) as caught:
        REFUSED[name]()
    assert "\n" not in str(caught.value)


READ = {
    "upper in m/s2": lambda: bracket("lower [g]", "upper [m/s2]", (1.0, G)),
    "lower in m/s2": lambda: bracket("lower [m/s2]", "upper [g]", (G, 1.0)) / G,
    "both in gal": lambda: (
        bracket("lower [gal]", "upper (cm/s2)", (100 * G, 100 * G)) / (100 * G)
    ),
    "the same unit given": lambda: bracket("lower [g]", "upper [g]", unit="g"),
    "none stated": lambda: bracket("lower", "upper", unit="g"),
}


@pytest.mark.parametrize("name", READ)
def test_each_column_is_read_in_its_own_unit(name):
    assert READ[name]() == pytest.approx(bracket("lower [g]", "upper [g]"), rel=1e-9)


@pytest.mark.parametrize(
    "head", ["density [kg/m3]", "density (kg/m^3)", "density [kg/m³]", "density"]
)
def test_a_key_of_an_arch_may_state_its_own_unit(head, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (member,) = rows_of(head, 1800)
    assert (member.entry.density, member.values) == (1800.0, {"density": 1800.0})


def test_attributes_are_named(tmp_path):
    """They change no arch, which somebody who means a key should read."""
    text = "id,height,county\none,2.0,Kent\ntwo,2.5,Kent\n"
    (tmp_path / "walls.csv").write_text(text)
    path = small_study(tmp_path)
    row = (
        "  - {id: walls, profile: block, width: 0.5, friction: 0.7, table: walls.csv}\n"
    )
    path.write_text(path.read_text().replace("arches:\n", f"arches:\n{row}"))
    done = command("validate", path)
    assert done.exit_code == 0, done.output
    assert "columns that change no arch: county" in " ".join(done.stdout.split())


NO_NUMBERS = [
    "1_0",
    "010",
    "1:30",
    "0x10",
    "0b1",
    "0o7",
    "1_0.5",
    "00.5",
    "١",
    "1e1_0",
    "nan",
    "+010",
]


@pytest.mark.parametrize("text", NO_NUMBERS)
def test_what_is_no_number_is_none_in_any_table_key_or_option(
    text, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    refused = [
        lambda: rows_of("thickness", text),
        lambda: hazard(f"PGA [g],rate\n{text},0.2"),
        lambda: hazard(f"PGA [g],rate\n0.05,{text}"),
        lambda: af.fit({"PGA [g]": ["0.1", text, "0.3"], "verdict": [0, 1, 1]}),
        lambda: index("Mw", text),
        lambda: target(f"period_s,Sa_g,sd\n0.2,{text},0.1"),
        lambda: load_study(small_study(tmp_path), [f"arches.0.thickness={text}"]),
        lambda: parse_measure(f"Sa({text})"),
        lambda: parse_columns(f"acceleration=1,dt={text}"),
        lambda: checked_ratios({"collapse": text}),
    ]
    for each in refused:
        with pytest.raises(InputError):
            each()
    for option in (
        ["onset", "--radius", text],
        ["risk", "s.yaml", "--hazard", "h", "--years", text],
        ["risk", "s.yaml", "--hazard", "h", "--site", f"{text},42"],
        ["records", "make", "--out", "o", "--magnitude", f"{text}:90"],
        ["records", "select", "f.csv", "--out", "o", "--count", text],
    ):
        done = command(*option)
        assert done.exit_code == 2
        assert "could not convert string" in done.stderr or "must be" in done.stderr


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("10", 10),
        ("-0.5", -0.5),
        ("2e-3", 2e-3),
        ("1.", 1.0),
        (".5", 0.5),
        ("+3", 3),
        ("0", 0),
        (".inf", float("inf")),
        ("true", True),
        ("null", None),
        ("~", None),
        ("", None),
        ("010", "010"),
        ("1_0", "1_0"),
        ("1:30", "1:30"),
        ("0x10", "0x10"),
        ("no", "no"),
        ("yes", "yes"),
        ("2020-01-01", "2020-01-01"),
        ("on", "on"),
    ],
)
def test_yaml_is_that_of_version_1_2(text, value):
    found = parse_value(text, "here")
    assert (found, type(found)) == (value, type(value))
    assert parse_value(yaml_of([found]), "here") == [value]
