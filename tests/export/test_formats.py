"""Files for receivers: their structure, and the lognormal law found again in them.

The receivers' own parsers find it too, each in its own environment, to 1e-10. uv makes it, or
ARCHFRAG_OPENQUAKE_PYTHON, ARCHFRAG_PELICUN_PYTHON and ARCHFRAG_INCORE_PYTHON name interpreters
that have them.
"""

import csv
import functools
import io
import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import lxml.etree
import numpy as np
import pytest
import scipy.stats

from archfrag.errors import InputError
from archfrag.export import writers
from tests.export.made import STATES, curve_set, fragility, lognormal

G = 9.80665
NONE = {"tower": "all runs survived & nothing fell"}


def parsed(text):
    root = lxml.etree.fromstring(text.encode("utf-8"))
    (model,) = root
    assert root.tag == f"{{{writers.NAMESPACE}}}nrml"
    return model


@pytest.mark.parametrize(
    ("receiver", "measure", "name", "unit", "si", "note"),
    [
        ("OpenQuake", "PGA", "PGA", "g", G, ""),
        ("OpenQuake", "SA(0.50)", "SA(0.5)", "g", G, ""),
        ("OpenQuake", "RotD50(Sa(0.5))", "SA(0.5)", "g", G, "RotD50 of two horizontal"),
        ("OpenQuake", "AvgSA(0.2,1)", "AvgSA", "g", G, "from 0.2 to 1 s"),
        ("OpenQuake", "Sa_avg3(1)", "Sa_avg3(1.0)", "g", G, ""),
        ("OpenQuake", "RotD50(FIV3(0.5))", "FIV3(0.5)", "cm/s", 0.01, "RotD50 of two"),
        ("OpenQuake", "Arias", "IA", "m/s", 1.0, ""),
        ("OpenQuake", "PGV", "PGV", "cm/s", 0.01, "OpenQuake 3.26 and later"),
        ("pelicun", "PGV", "Peak Ground Velocity", "cmps", 0.01, ""),
        ("IN-CORE", "Sa(0.5)", "0.5 Sec Sa", "g", G, ""),
    ],
)
def test_names_of_measures(receiver, measure, name, unit, si, note):
    named = writers.named_measure(receiver, measure)
    assert named[:2] == (name, unit)
    assert named.factor * si == pytest.approx(1.0, rel=1e-15)
    assert note in named.condition
    assert bool(note) == bool(named.condition)


@pytest.mark.parametrize(
    ("receiver", "measure", "message"),
    [
        ("OpenQuake", "HI", "no name for the intensity measure HI"),
        ("pelicun", "PGD", "its PGD is permanent ground deformation"),
    ],
)
def test_measures_that_a_receiver_does_not_know(receiver, measure, message):
    with pytest.raises(InputError, match=message):
        writers.named_measure(receiver, measure)


class TestNrml:
    @pytest.mark.parametrize("write", [writers.nrml_continuous, writers.nrml_discrete])
    def test_structure(self, write):
        description, states, *functions = parsed(write(curve_set(left_out=NONE)))
        assert "PGA in g" in description.text
        assert (
            "No curve for tower: all runs survived & nothing fell" in description.text
        )
        assert "0" * 64 in description.text
        assert states.text == "rocking damage collapse"
        assert [each.get("id") for each in functions] == ["ring-7", "wall+2"]
        for each in functions:
            assert each[0].get("imt") == "PGA"
            assert [child.get("ls") for child in each[1:]] == list(STATES)

    @pytest.mark.parametrize("beta", [0.05, 1.0])
    def test_levels_hold_the_curve_and_are_close_enough_between(self, beta):
        states = {name: fragility(f, beta) for name, f in zip(STATES, (2.0, 3.0, 4.0))}
        curves = curve_set(**{"ring-7": states})
        imls, *rows = parsed(writers.nrml_discrete(curves))[2]
        levels = np.array(imls.text.split(), dtype=float) * G
        assert (np.diff(levels) > 0).all()
        assert levels[0] <= curves.levels[0] < curves.levels[1] <= levels[-1]
        between = np.geomspace(levels[0], levels[-1], 5000)
        for row in rows:
            theta = states[row.get("ls")].theta
            poes = np.array(row.text.split(), dtype=float)
            exact = [lognormal(im, theta, beta) for im in levels]
            np.testing.assert_allclose(poes, exact, rtol=0, atol=1e-12)
            assert np.isclose(levels, theta, rtol=1e-14, atol=0).any()
            assert poes[-1] > 0.9999
            exact = [lognormal(im, theta, beta) for im in between]
            assert np.abs(np.interp(between, levels, poes) - exact).max() < 1e-4


def test_pelicun():
    curves = curve_set("Sa(0.5)", left_out=NONE)
    rows = list(csv.DictReader(io.StringIO(writers.pelicun_table(curves))))
    assert [row["ID"] for row in rows] == ["ring_7", "wall_2"]
    fixed = {
        "Demand-Type": "Spectral Acceleration|0.5",
        "Demand-Unit": "g",
        "Demand-Offset": "0",
        "Demand-Directional": "1",
        "Incomplete": "0",
    }
    for row, states in zip(rows, curves.curves.values()):
        assert row.items() >= fixed.items()
        for number, fit in enumerate(states.values(), start=1):
            assert row[f"LS{number}-Family"] == "lognormal"
            assert float(row[f"LS{number}-Theta_0"]) == pytest.approx(
                fit.theta / G, rel=1e-14
            )
            assert float(row[f"LS{number}-Theta_1"]) == fit.beta
    about = json.loads(writers.pelicun_description(curves))
    assert about["_GeneralInformation"]["archfrag"]["cube_sha256"] == "0" * 64
    assert list(about["_GeneralInformation"]["LeftOut"]) == ["tower"]
    assert about["ring_7"]["LimitStates"]["LS3"]["DS3"]["Description"] == "collapse"
    with pytest.raises(InputError, match="arch 'ring_7' would have the id 'ring_7'"):
        writers.pelicun_table(curve_set(ring_7=curves.curves["ring-7"]))


def test_in_core():
    curves = curve_set("Sa(0.2)", left_out=NONE)
    sets = writers.in_core_sets(curves)
    assert list(sets) == ["ring-7", "wall+2"]
    for arch, text in zip(curves.curves, sets.values(), strict=True):
        content = json.loads(text)
        assert content["demandTypes"] == ["0.2 Sec Sa"]
        assert "0" * 64 in content["description"]
        fits = [*curves.curves[arch].values()]
        for curve, fit in zip(
            content["fragilityCurves"], [*fits, fits[-1]], strict=True
        ):
            (rule,) = curve["rules"]
            assert rule["condition"] == ["sa > 0"]
            for im in (0.1, 0.5, 2.0):
                value = eval(
                    rule["expression"], {"math": math, "scipy": scipy, "sa": im}
                )
                expected = lognormal(im * G, fit.theta, fit.beta)
                assert value == pytest.approx(expected, abs=1e-12)
    states = {f"s{n}": fragility(n + 1.0, 0.4) for n in range(5)}
    (text, _) = writers.in_core_sets(
        curve_set(**{"ring-7": states, "wall+2": states})
    ).values()
    named = [each["description"] for each in json.loads(text)["fragilityCurves"]]
    assert named == ["LS_0: s1", "LS_1: s2", "LS_2: s3", "LS_3: s4"]


SCRIPT = Path(__file__).parent / "receivers.py"
AT = (1.0, 0.5, 1.7)  # times the median of collapse


# The newest of each. OpenQuake's parsers need no GDAL, whose wheels are not everywhere.
PACKAGES = {
    "OPENQUAKE": ("openquake.engine", "3.26.2"),
    "PELICUN": ("pelicun", "3.10.0"),
    "INCORE": ("pyincore", "1.22.0"),
}
WITHOUT = "gdal ; python_version < '3'"


@functools.cache
def interpreter(receiver):
    """The interpreter of a receiver, and what keeps it; a text that says why there is none."""
    named = os.environ.get(f"ARCHFRAG_{receiver}_PYTHON")
    if named:
        return named, ""
    beside = Path(sys.executable).with_name("uv")
    uv = str(beside) if beside.exists() else shutil.which("uv")
    if uv is None:
        return "", "there is no uv to make an environment with"
    folder = Path(tempfile.mkdtemp(prefix="archfrag-receiver-"))
    (folder / "without.txt").write_text(WITHOUT)
    python = folder / "venv" / "bin" / "python"
    packages = ["==".join(PACKAGES[receiver]), "requests"]  # pyincore does not name it
    for command in (
        ("venv", "--python", sys.executable, str(folder / "venv")),
        (
            "pip",
            "install",
            "--override",
            folder / "without.txt",
            "--python",
            python,
            *packages,
        ),
    ):
        done = subprocess.run(
            [uv, "-q", *command], capture_output=True, text=True, timeout=900
        )
        if done.returncode:
            return (
                "",
                f"{packages[0]} cannot be installed: {done.stderr.strip()[-300:]}",
            )
    return str(python), ""


def ask(receiver, calls):
    """What a receiver reads from each file; skips if the receiver cannot be installed."""
    python, why_none = interpreter(receiver)
    if why_none:
        pytest.skip(why_none)
    done = subprocess.run(
        [python, str(SCRIPT), receiver],
        input=json.dumps(calls),
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    found = json.loads(done.stdout.splitlines()[-1])
    assert found["version"] == PACKAGES[receiver][1]
    return found["answers"]


def written(path, text):
    path.write_text(text, encoding="utf-8")
    return str(path)


def asked(curves, factor=1.0):
    """Intensities by arch: the median of collapse and two others, times a factor."""
    fits = {arch: states["collapse"] for arch, states in curves.curves.items()}
    return {
        arch: [factor * times * fit.theta for times in AT] for arch, fit in fits.items()
    }


def compare(found, curves):
    """What is found, by arch and state, is the law."""
    for (arch, states), levels in zip(curves.curves.items(), asked(curves).values()):
        for fit, values in zip(states.values(), found[arch], strict=True):
            expected = [lognormal(im, fit.theta, fit.beta) for im in levels]
            assert values == pytest.approx(expected, abs=1e-10)


def test_parser_of_openquake(tmp_path):
    measures = ["PGA", "PGV", "PGD", "Sa(0.5)", "AvgSA(0.2,1.0)", "CAV", "Arias"]
    measures += ["Sa_avg2(0.5)", "Sa_avg3(0.5)", "FIV3(1)"]
    calls = []
    for n, measure in enumerate(measures):
        curves = curve_set(measure)
        levels = asked(curves, writers.named_measure("OpenQuake", measure).factor)
        for kind in (writers.nrml_continuous, writers.nrml_discrete):
            path = written(tmp_path / f"{n}-{kind.__name__}.xml", kind(curves))
            calls.append((path, levels))
    found = iter(ask("OPENQUAKE", calls))
    for measure, continuous, discrete in zip(measures, found, found):
        assert continuous["measures"] == [
            writers.named_measure("OpenQuake", measure).name
        ]
        assert "0" * 64 in continuous["description"]
        assert ("OpenQuake 3.26" in continuous["description"]) == (measure == "PGV")
        states = {a: s.values() for a, s in continuous["probabilities"].items()}
        compare(states, curve_set(measure))
        # A discrete curve is exact at its levels, the median among them; a line lies between.
        for arch, states in discrete["probabilities"].items():
            assert states["collapse"][0] == pytest.approx(0.5, abs=1e-10), arch


def test_parser_of_in_core(tmp_path):
    cases = [
        (measure, states)
        for measure in ("PGA", "PGV", "PGD", "Sa(0.5)")
        for states in (STATES, STATES[-1:])
    ]
    calls = []
    for n, (measure, states) in enumerate(cases):
        curves = curve_set(measure, states=states)
        factor = writers.named_measure("IN-CORE", measure).factor
        for arch, text in writers.in_core_sets(curves).items():
            path = written(tmp_path / f"{n}-{arch}.json", text)
            calls.append((path, asked(curves, factor)[arch]))
    answers = iter(ask("INCORE", calls))
    for measure, states in cases:
        curves = curve_set(measure, states=states)
        named = writers.named_measure("IN-CORE", measure)
        found = {}
        for arch, read in zip(curves.curves, answers):
            assert (read["measures"], read["units"]) == ([named.name], [named.unit])
            found[arch] = [
                [at[f"LS_{n}"] for at in read["probabilities"]]
                for n in range(len(states))
            ]
        compare(found, curves)


def test_parser_of_pelicun(tmp_path):
    ids = {"ring-7": "ring_7", "wall+2": "wall_2"}
    demands = {"PGA": "PGA", "PGV": "PGV", "Sa(0.5)": "SA_0.5"}
    calls = []
    for measure, demand in demands.items():
        curves = curve_set(measure)
        path = written(tmp_path / f"{demand}.csv", writers.pelicun_table(curves))
        levels = {ids[arch]: values for arch, values in asked(curves).items()}
        calls.append((path, levels, demand))
    for measure, found in zip(demands, ask("PELICUN", calls), strict=True):
        states = {a: found["probabilities"][i].values() for a, i in ids.items()}
        compare(states, curve_set(measure))
