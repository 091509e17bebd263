"""Receivers' own parsers find the same probabilities; each runs in its own environment.

ARCHFRAG_OPENQUAKE_PYTHON, ARCHFRAG_PELICUN_PYTHON and ARCHFRAG_INCORE_PYTHON name interpreters
that have openquake.engine, pelicun and pyincore. Measured with 3.26.2, 3.10.0 and 1.22.0: see
the changelog.
"""

import json
import math
import os
import subprocess
from pathlib import Path

import pytest

from archfrag.export.formats import (
    in_core_sets,
    nrml_continuous,
    nrml_discrete,
    pelicun_table,
)
from archfrag.export.receivers import named_measure
from tests.export.made import curve_set, lognormal

SCRIPTS = Path(__file__).parent / "receivers"
AT = (1.0, 0.5, 1.7)  # times the median of collapse
TOLERANCE = 1e-6


def ask(receiver, script, *arguments):
    """What a receiver reads; skips if its interpreter is not named."""
    variable = f"ARCHFRAG_{receiver}_PYTHON"
    if variable not in os.environ:
        pytest.skip(f"{variable} names no interpreter that has the receiver")
    command = [os.environ[variable], str(SCRIPTS / script), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr[-2000:]
    found = json.loads(done.stdout.splitlines()[-1])
    print(receiver, found["version"])
    return found


def asked(curves):
    """Intensities by arch [SI]: the median of collapse and two others."""
    fits = {arch: states["collapse"] for arch, states in curves.complete.items()}
    return {arch: [times * fit.theta for times in AT] for arch, fit in fits.items()}


def compare(found, curves, levels):
    """Largest difference from the law; `found` by arch and state."""
    worst = max(
        abs(value - lognormal(im, fit.theta, fit.beta))
        for arch, states in curves.complete.items()
        for (_, fit), values in zip(states.items(), found[arch], strict=True)
        for im, value in zip(levels[arch], values, strict=True)
    )
    print(f"largest difference {worst:.1e}")
    assert worst < TOLERANCE


def in_unit(levels, factor):
    return {arch: [factor * im for im in values] for arch, values in levels.items()}


@pytest.mark.parametrize(
    "measure", ["PGA", "PGV", "PGD", "Sa(0.5)", "AvgSA(0.2,1.0)", "FIV3(0.7)", "CAV", "Arias"]
)
def test_openquake_continuous(tmp_path, measure):
    curves = curve_set(measure)
    path, levels = tmp_path / "model.xml", asked(curves)
    path.write_text(nrml_continuous(curves), encoding="utf-8")
    named = named_measure("OpenQuake", measure)
    found = ask("OPENQUAKE", "read_openquake.py", path, json.dumps(in_unit(levels, named.factor)))
    assert found["measures"] == [named.name]
    assert "0" * 64 in found["description"]
    compare({a: s.values() for a, s in found["probabilities"].items()}, curves, levels)


def test_openquake_discrete(tmp_path):
    """At levels of the file: the median, and 25 steps of the grid below and above it."""
    curves = curve_set("PGV", states=("collapse",))
    fits = {arch: states["collapse"] for arch, states in curves.complete.items()}
    levels = {a: [f.theta * math.exp(z * f.beta) for z in (0, -1, 1)] for a, f in fits.items()}
    path = tmp_path / "model.xml"
    path.write_text(nrml_discrete(curves), encoding="utf-8")
    found = ask("OPENQUAKE", "read_openquake.py", path, json.dumps(in_unit(levels, 100.0)))
    compare({a: s.values() for a, s in found["probabilities"].items()}, curves, levels)


@pytest.mark.parametrize("measure", ["PGA", "PGV", "PGD", "Sa(0.5)"])
@pytest.mark.parametrize("states", [("rocking", "damage", "collapse"), ("collapse",)])
def test_in_core(tmp_path, measure, states):
    curves = curve_set(measure, states=states)
    levels = asked(curves)
    for arch, text in in_core_sets(curves).items():
        path = tmp_path / f"{arch}.json"
        path.write_text(text, encoding="utf-8")
        named = named_measure("IN-CORE", measure)
        given = in_unit(levels, named.factor)[arch]
        found = ask("INCORE", "read_in_core.py", path, json.dumps(given))
        assert (found["measures"], found["units"]) == ([named.name], [named.unit])
        rows = [[each[f"LS_{n}"] for each in found["probabilities"]] for n in range(len(states))]
        one = curve_set(measure, states=states)
        one.curves.pop(next(other for other in curves.curves if other != arch))
        compare({arch: rows}, one, levels)
        severest = one.curves[arch]["collapse"]
        for im, damage in zip(levels[arch], found["damage"]):
            expected = lognormal(im, severest.theta, severest.beta)
            assert damage["DS_4"] == pytest.approx(expected, abs=TOLERANCE)
            assert sum(damage.values()) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize(
    ("measure", "demand"), [("PGA", "PGA"), ("PGV", "PGV"), ("Sa(0.5)", "SA_0.5")]
)
def test_pelicun(tmp_path, measure, demand):
    curves = curve_set(measure)
    path, levels = tmp_path / "damage.csv", asked(curves)
    path.write_text(pelicun_table(curves), encoding="utf-8")
    ids = {"ring-7": "ring_7", "wall+2": "wall_2"}
    given = {ids[arch]: values for arch, values in levels.items()}
    found = ask("PELICUN", "read_pelicun.py", path, json.dumps(given), demand)
    compare({a: found["probabilities"][i].values() for a, i in ids.items()}, curves, levels)
    for name in ids.values():  # at the median of collapse; 1.2 times it would give 0.66
        assert found["damage"][name]["3"] == pytest.approx(0.5, abs=4 * 0.5 / 20_000**0.5)
