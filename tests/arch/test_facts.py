"""What an arch can be checked by, and cautions on values that are in another unit."""

import re
import warnings

import numpy as np
import pytest

import archfrag as af
from archfrag.arch.facts import facts_of, facts_text, unit_cautions
from archfrag.errors import StabilityError, UnitWarning
from archfrag.study.file.arches import ArchEntry
from archfrag.study.yaml_text import parse_value
from tests.arch.test_arch import CHAINS
from tests.piers import on_piers
from tests.study.small import ROOT, TEXT, command, small_study

RING = {"span": 8.0, "rise": 2.0, "thickness": 0.5, "voussoirs": 9, "friction": 0.7}
FILL = {"height_over_crown": 0.5, "unit_weight": 18e3}
PIERS = {"height": 4.0, "width": 2.0}
TIE = {"level": 0.5, "area": 8e-4}


def ring(**given):
    return af.Arch.segmental(**{**RING, **given})


class TestFacts:
    def test_weights_forces_and_places_are_those_of_a_hand_calculation(self):
        bare = ring(depth=2.0)
        radius = (4.0**2 + 2.0**2) / (2 * 2.0)
        length = 2 * radius * np.arcsin(4.0 / radius)
        weight = 2000 * 9.80665 * length * 0.5 * 2.0
        loaded = on_piers(ring(depth=2.0, dead_load=1e3), **PIERS).filled(**FILL)
        tied = loaded.tied(**TIE, prestress=2e4, strength=1.88e5)
        facts = facts_of(tied)
        assert facts_of(bare)["weights"]["ring"] == pytest.approx(weight, rel=1e-12)
        assert facts["weights"]["ring"] == pytest.approx(weight, rel=1e-12)
        assert facts["weights"]["dead_load"] == 9e3
        piers = facts_of(on_piers(bare, **PIERS))["weights"]["piers"]
        assert facts["weights"]["piers"] == pytest.approx(piers, rel=1e-12)
        total = tied.chain.mass.sum() * 9.80665
        assert sum(facts["weights"].values()) == pytest.approx(total, rel=1e-12)
        ((tie,),) = [facts["ties"]]
        assert (tie["prestress"], tie["strength"]) == (2e4, 1.88e5)
        ends = np.array(facts["springings"])
        np.testing.assert_allclose(ends[:, 0], tied.intrados[[1, -2]])
        text = facts_text(tied)
        assert "the ring weighs 182 kN, piers " in text
        assert (
            "the tie pulls with 20 kN and yields at 188 kN; springings at (-3.8, -0.15)"
            in text
        )

    @pytest.mark.parametrize("name", CHAINS)
    def test_of_any_arch_weights_are_those_of_its_bodies(self, name):
        arch = CHAINS[name]
        total = arch.chain.mass.sum() * arch.chain.gravity
        assert sum(facts_of(arch)["weights"].values()) == pytest.approx(
            total, rel=1e-12
        )
        assert ("it stands from" in facts_text(arch)) == arch.free_end
        assert unit_cautions(arch) == []

    def test_of_ties_they_say_each(self):
        tied = ring().tied(**TIE, prestress=2e4).tied(**{**TIE, "level": 0.8})
        assert "; tie 1 pulls with 20 kN; tie 2 is not tight; springings" in facts_text(
            tied
        )

    def test_of_a_block_they_are_its_weight_and_base(self):
        text = facts_text(af.Block(width=0.4, height=2.0, friction=0.8))
        assert (
            text == "the blocks weigh 15.7 kN; it stands from (-0.2, 0) to (0.2, 0) m"
        )


# Slips of unit: how the arch is made in Python, and the key that is named.
SLIPS = {
    "fill in kN/m3": (lambda: ring().filled(0.5, 18.0), "fill.unit_weight = 18 N/m3"),
    "fill in kg/m3": (lambda: ring().filled(0.5, 1800.0), "fill.unit_weight = 1800"),
    "fill in t/m3": (lambda: ring().filled(0.5, 1.8), "fill.unit_weight = 1.8"),
    "backing in kN/m3": (
        lambda: ring().filled(**FILL, backing_height=0.5, backing_unit_weight=22.0),
        "fill.backing_unit_weight = 22",
    ),
    "fill in cm": (lambda: ring().filled(50.0, 18e3), "fill.height_over_crown = 50 m"),
    "fill without end": (
        lambda: ring().filled(1e6, 18e3),
        "fill.height_over_crown = 1e+06",
    ),
    "density in t/m3": (lambda: ring(density=2.0), "density = 2 kg/m3"),
    "density in kN/m3": (lambda: ring(density=20.0), "density = 20 kg/m3"),
    "density in N/m3": (lambda: ring(density=20e3), "density = 2e+04 kg/m3"),
    "density of one": (lambda: ring(density=[2000.0] * 8 + [2.0]), "density = 2 kg/m3"),
    "depth in cm": (lambda: ring(depth=450.0), "depth = 450 m"),
    "all in mm": (
        lambda: ring(span=8000.0, rise=2000.0, thickness=500.0),
        "span = 7600 m: usual are 0.3",
    ),
    "all in km": (
        lambda: ring(span=8e-3, rise=2e-3, thickness=5e-4),
        "span = 0.0076 m",
    ),
    "radius in mm": (
        lambda: af.Arch.circular(1e4, 1500.0, 157.5, 7, 0.7),
        "thickness = 1500",
    ),
    "block in cm": (lambda: af.Block(40.0, 300.0, friction=0.7), "height = 300 m"),
    "polygons in mm": (
        lambda: af.Arch.from_polygons(
            [[(0, 0), (900, 0), (900, 900), (0, 900)]], 0.7, ground=[[(0, 0), (900, 0)]]
        ),
        "height = 900 m",
    ),
    "piers in t/m3": (
        lambda: af.Bridge([ring()], ends={**PIERS, "density": 2.2}),
        "ends.density = 2.2",
    ),
    "one pier too deep": (
        lambda: af.Bridge([ring()], ends=[PIERS, {**PIERS, "depth": 1e6}]),
        "ends.depth = 1e+06 m",
    ),
    "dead load in MN": (
        lambda: ring(dead_load=5e-3),
        "dead_load is 0.045 N on a ring of 90.9 kN",
    ),
    "modulus in GPa": (
        lambda: ring().tied(**TIE, modulus=210.0),
        "ties[0].modulus = 210 N/m2",
    ),
    "modulus in MPa": (
        lambda: ring().tied(**TIE, modulus=210e3),
        "ties[0].modulus = 2.1e+05",
    ),
    "area in mm2": (lambda: ring().tied(0.5, area=800.0), "ties[0].area = 800 m2"),
    "area of nothing": (lambda: ring().tied(0.5, area=1e-300), "ties[0].area = 1e-300"),
    "prestress in kN": (
        lambda: ring().tied(**TIE, prestress=20.0),
        "ties[0].prestress = 20 N on",
    ),
    "prestress in MPa": (
        lambda: ring().tied(**TIE, prestress=100.0),
        "ties[0].prestress = 100 N",
    ),
    "tie's strength in kN": (
        lambda: ring().tied(**TIE, strength=188.0),
        "ties[0].strength = 188",
    ),
    "tie's strength in Pa": (
        lambda: ring().tied(**TIE, strength=235e6),
        "ties[0].strength = 2.3",
    ),
    "rupture in mm": (
        lambda: ring().tied(**TIE, rupture=80.0),
        "ties[0].rupture = 80 m is that",
    ),
    "strength in kPa": (
        lambda: af.crushed(ring(), 1.5e5),
        "strength = 1.5e+05 N/m2: usual",
    ),
    "strength in Pa twice": (lambda: af.crushed(ring(), 5e11), "strength = 5e+11 N/m2"),
}


@pytest.mark.parametrize(("make", "named"), SLIPS.values(), ids=SLIPS)
def test_a_slip_of_unit_is_named_in_python_and_in_a_study(make, named):
    with pytest.warns(UnitWarning, match=re.escape(named)) as caught:
        arch = make()
    assert caught[0].filename == __file__
    assert any(named in text for text in unit_cautions(arch))


def test_a_strength_in_mpa_is_refused_with_its_unit():
    with pytest.raises(
        StabilityError, match=r"strength of 5 N/m2; masonry has 200000 .* N/m2"
    ):
        af.crushed(ring(), 5.0)


def test_usual_values_give_no_caution_and_each_slip_is_told_once():
    with warnings.catch_warnings():
        warnings.simplefilter("error", UnitWarning)
        arch = on_piers(
            ring(density=[2000.0] * 9, dead_load=2e3), **PIERS, density=2300.0
        )
        arch = arch.filled(**FILL).tied(
            **TIE, prestress=2e4, strength=1.88e5, rupture=0.1
        )
        horseshoe = af.Arch.circular(10.0, 1.5, 350.0, voussoirs=40, friction=2.0)
    assert unit_cautions(arch) == unit_cautions(horseshoe) == []
    with pytest.warns(UnitWarning, match="density") as caught:
        weak = ring(density=2.0)
    assert len(caught) == 1
    weak = weak.filled(**FILL)  # no further warning of its density
    assert len(unit_cautions(weak)) == 1


def test_in_a_study_it_is_a_caution_and_no_warning(tmp_path):
    text = TEXT.replace(
        "friction: 0.7}",
        "friction: 0.7, fill: {height_over_crown: 1.0, unit_weight: 18}}",
    )
    path = small_study(tmp_path, text)
    found = command("validate", path)
    caution = "archfrag: caution: ring: fill.unit_weight = 18 N/m3: usual are 5000 to 40000 N/m3"
    assert caution in found.stderr
    assert "  ring: the ring weighs 809 kN, fill " in found.stdout
    told = command("onset", "--study", path, "--arch", "ring")
    assert "caution: fill.unit_weight = 18 N/m3" in told.stderr
    assert "the ring weighs 809 kN, fill " in told.stdout


YAML = r"^(?:```yaml|%%writefile \S+\.yaml)\n(.*?)^```"


def entries_of_documents():
    """Arches of all study files that are shipped or shown."""
    texts = [
        path.read_text("utf-8") for path in sorted((ROOT / "configs").glob("*.yaml"))
    ]
    for path in sorted((ROOT / "docs").rglob("*.md")):
        texts += re.findall(YAML, path.read_text("utf-8"), re.M | re.S)
    for text in texts:
        given = parse_value(text, "a page")
        for entry in given.get("arches", []) if isinstance(given, dict) else []:
            if not {"drawing", "table"} & entry.keys() and len(entry) > 3:
                yield {key: value for key, value in entry.items() if key != "vary"}


def test_shipped_and_documented_studies_give_no_caution():
    entries = list(entries_of_documents())
    assert len(entries) > 15
    found = {
        str(each): unit_cautions(ArchEntry.model_validate(each).build())
        for each in entries
    }
    assert {arch: texts for arch, texts in found.items() if texts} == {}
