"""Receivers' own parsers find the same probabilities; each runs in its own environment.

ARCHFRAG_OPENQUAKE_PYTHON, ARCHFRAG_PELICUN_PYTHON and ARCHFRAG_INCORE_PYTHON name interpreters
that have openquake.engine, pelicun and pyincore. Measured with 3.26.2, 3.10.0 and 1.22.0: see
the changelog.
"""

import json
import os
import subprocess
from pathlib import Path

import pytest

from archfrag.export.formats import (
    in_core_sets,
    named_measure,
    nrml_continuous,
    nrml_discrete,
    pelicun_table,
)
from tests.export.made import curve_set, lognormal

SCRIPT = Path(__file__).parent / "receivers.py"
AT = (1.0, 0.5, 1.7)  # times the median of collapse
TOLERANCE = 1e-6


def ask(receiver, *arguments):
    """What a receiver reads; skips if its interpreter is not named."""
    variable = f"ARCHFRAG_{receiver}_PYTHON"
    if variable not in os.environ:
        pytest.skip(f"{variable} names no interpreter that has the receiver")
    command = [os.environ[variable], str(SCRIPT), receiver, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout.splitlines()[-1])


def asked(curves, factor=1.0):
    """Intensities by arch: the median of collapse and two others, times a factor."""
    fits = {arch: states["collapse"] for arch, states in curves.complete.items()}
    return {arch: [factor * times * fit.theta for times in AT] for arch, fit in fits.items()}


def compare(found, curves):
    """What is found, by arch and state, is the law."""
    for (arch, states), levels in zip(curves.complete.items(), asked(curves).values()):
        for fit, values in zip(states.values(), found[arch], strict=True):
            expected = [lognormal(im, fit.theta, fit.beta) for im in levels]
            assert values == pytest.approx(expected, abs=TOLERANCE)


@pytest.mark.parametrize(
    "measure", ["PGA", "PGV", "PGD", "Sa(0.5)", "AvgSA(0.2,1.0)", "CAV", "Arias"]
)
def test_openquake(tmp_path, measure):
    curves, named = curve_set(measure), named_measure("OpenQuake", measure)
    path, levels = tmp_path / "model.xml", json.dumps(asked(curves, named.factor))
    path.write_text(nrml_continuous(curves), encoding="utf-8")
    found = ask("OPENQUAKE", path, levels)
    assert found["measures"] == [named.name]
    assert "0" * 64 in found["description"]
    compare({a: s.values() for a, s in found["probabilities"].items()}, curves)
    # A discrete curve is exact at its levels, the median among them; a line lies between.
    path.write_text(nrml_discrete(curves), encoding="utf-8")
    found = ask("OPENQUAKE", path, levels)
    for arch, states in found["probabilities"].items():
        assert states["collapse"][0] == pytest.approx(0.5, abs=TOLERANCE), arch


@pytest.mark.parametrize("measure", ["PGA", "PGV", "PGD", "Sa(0.5)"])
@pytest.mark.parametrize("states", [("rocking", "damage", "collapse"), ("collapse",)])
def test_in_core(tmp_path, measure, states):
    curves, named = curve_set(measure, states=states), named_measure("IN-CORE", measure)
    found = {}
    for arch, text in in_core_sets(curves).items():
        path = tmp_path / f"{arch}.json"
        path.write_text(text, encoding="utf-8")
        levels = json.dumps(asked(curves, named.factor)[arch])
        read = ask("INCORE", path, levels)
        assert (read["measures"], read["units"]) == ([named.name], [named.unit])
        found[arch] = [[at[f"LS_{n}"] for at in read["probabilities"]] for n in range(len(states))]
        severest = curves.curves[arch]["collapse"]
        for im, damage in zip(asked(curves)[arch], read["damage"]):
            expected = lognormal(im, severest.theta, severest.beta)
            assert damage["DS_4"] == pytest.approx(expected, abs=TOLERANCE)
            assert sum(damage.values()) == pytest.approx(1.0, abs=1e-9)
    compare(found, curves)


@pytest.mark.parametrize(
    ("measure", "demand"), [("PGA", "PGA"), ("PGV", "PGV"), ("Sa(0.5)", "SA_0.5")]
)
def test_pelicun(tmp_path, measure, demand):
    curves = curve_set(measure)
    path, ids = tmp_path / "damage.csv", {"ring-7": "ring_7", "wall+2": "wall_2"}
    path.write_text(pelicun_table(curves), encoding="utf-8")
    levels = json.dumps({ids[arch]: values for arch, values in asked(curves).items()})
    found = ask("PELICUN", path, levels, demand)
    compare({a: found["probabilities"][i].values() for a, i in ids.items()}, curves)
    for name in ids.values():  # at the median of collapse; 1.2 times it would give 0.66
        assert found["damage"][name]["3"] == pytest.approx(0.5, abs=4 * 0.5 / 20_000**0.5)
