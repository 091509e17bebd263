"""An arch that is given to a study is the arch that the study runs, whatever made it."""

import warnings

import numpy as np
import pytest

import archfrag as af
from archfrag.errors import ArchfragError, InputError
from archfrag.study.designs import CASE
from archfrag.study.file.prepared import prepare_motions
from archfrag.study.file.schema import load_study
from archfrag.study.runs.store import make_plan
from archfrag.study.runs.workers import make_runs
from tests.piers import on_piers

RING = af.Arch.segmental(8.0, 3.0, 0.9, voussoirs=6, friction=0.7)
TWICE = "was changed twice in one way, or in an order that a study file cannot state"
TIE = {"level": 1.6, "area": 3e-4, "prestress": 8e3}
WAVE = np.sin(np.arange(100) / 6.0) * np.hanning(100)
HEIGHT = np.linspace(0.0, 6.0, 6)
SIDE = np.column_stack([np.linspace(0.55, 0.45, 6), HEIGHT])
DRAWN = [
    np.array(
        [RING.intrados[i], RING.intrados[i + 1], RING.extrados[i + 1], RING.extrados[i]]
    )
    for i in range(6)
]
COLUMN = [
    [(-0.2, 0.3), (0.2, 0.3), (0.2, 2.3), (-0.2, 2.3)],
    [(-0.5, 0.0), (0.5, 0.0), (0.5, 0.3), (-0.5, 0.3)],
]
BASES = (
    lambda: RING,
    lambda: af.Arch.circular(5.0, 0.9, 150.0, 7, [0.6, *[0.7] * 7], dead_load=2e3),
    lambda: af.Arch.pointed(
        6.0, 4.0, 0.8, 6, friction=np.inf, density=[1900.0] * 3 + [2200.0] * 3
    ),
    lambda: af.Arch.from_joints(SIDE, SIDE * [-1, 1], 0.7, free_end=True),
    lambda: af.Block(0.5, 2.0, 0.8),
    lambda: af.Arch.from_polygons(
        DRAWN[::-1], 0.8, thickness_factor=1.1, tolerance=1e-3
    ),
    lambda: af.Arch.from_polygons(COLUMN, 0.8, ground=[[(-0.5, 0.0), (0.5, 0.0)]]),
)
METHODS = {
    "recessed": lambda arch, x: arch.recessed(0.06 * x, [0.03 * x] * arch.n_joint),
    "tied": lambda arch, x: arch.tied(
        level=1.0 + x, area=3e-4, prestress=9e3 * round(x)
    ),
    "on_piers": lambda arch, x: on_piers(arch, height=1.0 + x, width=[2.0, 2.0 + x]),
    "filled": lambda arch, x: arch.filled(
        0.5, 15e3, backing_height=x, backing_unit_weight=2e4
    ),
    "spread": lambda arch, x: af.move_springing(arch, spread=0.01 * x),
    "settled": lambda arch, x: af.move_springing(
        arch, settlement=0.01 * x, springing="left"
    ),
    "crushed": lambda arch, x: af.crushed(arch, 1e6 * (1.0 + x)),
    "inset": lambda arch, x: af.jointed(arch, 1e10 * (1.0 + x)),
    "face": lambda arch, x: af.jointed(
        arch, 1e10 * (1.0 + x), model="face", damping=0.1 * x
    ),
}


def drawn(seed):
    """Draw an arch changed by up to four methods; None if they refuse it, and their names."""
    random = np.random.default_rng(seed)
    arch = BASES[random.choice(len(BASES), p=[0.4, *[0.1] * 6])]()
    names = []
    for name in random.choice([*METHODS], random.integers(1, 5)):
        names.append(str(name))
        try:
            arch = METHODS[name](arch, random.random())
        except ArchfragError:
            return None, names
    return arch, names


def outcome(arch, folder):
    """Return why a study refuses an arch; empty if object and file give the same bits."""
    motion = af.Motion(WAVE, 0.01, id="wave")
    try:
        study = af.Study(
            {"arch": arch},
            [motion],
            levels=[0.4],
            id="order",
            method={"follow": 1.0},
            output=str(folder / "out"),
        )
    except InputError as error:
        return str(error)
    keys = load_study(study.to_file(folder / "study.yaml"))
    prepare_motions(keys)
    plan = make_plan(keys)
    case = np.zeros(1, CASE)
    case["level"] = plan.levels[0]
    start = af.onset(arch)
    again = af.onset(plan.arch(0))
    np.testing.assert_equal([start.plus, start.minus], [again.plus, again.minus])
    try:
        run = af.simulate(arch, motion, plan.factors(case)[0], follow=1.0)
    except ArchfragError as error:  # it does not stand
        with pytest.raises(type(error)):
            make_runs(plan, case)
        return ""
    for name in (
        "peak_displacement",
        "residual_displacement",
        "peak_rotation",
        "end_time",
    ):
        np.testing.assert_equal(
            make_runs(plan, case)[name][0], getattr(run, name), name
        )
    return ""


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("seeds", [range(10), range(10, 330)], ids=["few", "many"])
def test_methods_in_any_order(tmp_path, seeds):
    kept = 0
    refused = 0
    for seed in seeds:
        arch, names = drawn(seed)
        if arch is None:
            continue
        why = outcome(arch, tmp_path)
        rules = f"arch arch {TWICE}", "is not a known key"
        assert not why or any(rule in why for rule in rules), (seed, names, why)
        kept = kept + (not why)
        refused = refused + bool(why)
    assert kept > len(seeds) / 8
    assert refused >= len(seeds) // 24


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("number", range(len(BASES)))
def test_any_shape_is_kept(tmp_path, number):
    assert outcome(BASES[number](), tmp_path) == ""


CHANGED = {
    "recessed twice": lambda: RING.recessed(0.05, 0.02).recessed(0.04, 0.0),
    "two springings moved": lambda: af.move_springing(
        af.move_springing(RING, spread=0.02), settlement=0.02, springing="left"
    ),
    "moved in two steps": lambda: af.move_springing(
        af.move_springing(RING, spread=0.01), spread=0.01
    ),
    "tied, then moved": lambda: af.move_springing(
        on_piers(RING, height=2.0, width=2.5).tied(**TIE), spread=0.005
    ),
    "crushed, then recessed": lambda: af.crushed(RING, 1e6).recessed(0.08, 0.0),
    "crushed twice": lambda: af.crushed(af.crushed(RING, 1e6), 2e6),
    "tied, then recessed": lambda: RING.tied(**TIE).recessed(0.05),
    "by hand": lambda: RING.changed(
        chain=RING.chain._replace(friction=0.5 * RING.chain.friction)
    ),
}


@pytest.mark.parametrize("name", CHANGED)
def test_an_arch_that_a_file_cannot_state_is_refused(name, tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        arch = CHANGED[name]()
        why = outcome(arch, tmp_path)
    if name == "tied, then recessed":
        assert not why  # a tie goes from outer face to outer face
    else:
        assert f"arch arch {TWICE}" in why


def test_depths_of_recesses_add_up():
    twice = RING.recessed(0.05, 0.02).recessed(0.04, [0.01] * 7)
    assert twice.parameters["recess"] == {"intrados": 0.09, "extrados": [0.03] * 7}
    once = RING.recessed(0.09, 0.03)
    assert af.onset(twice).plus == pytest.approx(af.onset(once).plus, rel=1e-12)
