"""Hazard curves of files, and rates of collapse of a study: of all designs, by the command."""

import json
import re

import numpy as np
import pandas as pd
import pytest

import archfrag
from archfrag.errors import InputError
from archfrag.fragility.curve import Curve
from archfrag.fragility.risk import HazardCurve
from archfrag.study.answer.fits import FITS
from archfrag.study.answer.rates import risk_of
from archfrag.study.hazard import _COLUMNS, Hazard, load_hazard
from archfrag.study.provenance import write_stamp
from tests.report.synthetic import answers_of, cube, motions
from tests.study.small import ROOT, command, made, small_study

G = 9.80665
SITE = {"site": (13.4, 42.3)}
OPENQUAKE = """\
#,,,,,,"generated_by='OpenQuake engine 3.26.0-gitabc', start_date='2026-05-04T12:20:05', \
checksum=42, kind='{kind}', investigation_time=50.0, imt='{imt}'"
lon,lat,depth,poe-0.0050000,poe-0.1000000,poe-0.4000000,poe-1.0000000
13.40000,42.30000,0.00000,9.999000E-01,{p},5.000000E-03,0.000000E+00
14.00000,42.30000,0.00000,8.000000E-01,5.000000E-02,2.000000E-03,1.000000E-04
"""


def openquake(kind="mean", imt="PGA", p="1.000000E-01"):
    return OPENQUAKE.format(kind=kind, imt=imt, p=p)


@pytest.fixture
def load(tmp_path):
    def load_texts(*texts, measure="PGA", unit=None, site=None):
        paths = [tmp_path / f"hazard{i}" for i in range(len(texts))]
        for path, text in zip(paths, texts):
            path.write_text(text, encoding="utf-8")
        return load_hazard(paths, measure, unit, site)

    return load_texts


def test_plain_tables(load):
    found = load("# a site\nPGA [g],rate_0.84,rate\n0.1,2e-2,1e-2\n\n0.4,8e-4,4e-4\n")
    assert list(found.curves) == ["mean", "0.84"]
    np.testing.assert_allclose(found.main.im, [0.1 * G, 0.4 * G])
    np.testing.assert_array_equal(found.main.rate, [1e-2, 4e-4])
    assert found.messages == ()
    found = load("im,poe_50\n0.1,0.1\n0.4,0.02\n", unit="g")
    assert 1.0 / found.main.rate[0] == pytest.approx(474.561, rel=1e-5)
    assert "taken to be PGA" in found.messages[0]
    for measure, head in (
        ("Sa(0.5)", "SA(0.50) [gal]"),
        ("PGV", "PGV [cm/s]"),
        ("Sa(0.5)", "sa(0.5) (GAL)"),
        ("PGV", "pgv (cm/s)"),
        ("Sa_avg2(0.5)", "SA_avg2(0.50) [gal]"),
        ("FIV3(1)", "fiv3(1) [cm/s]"),
    ):
        found = load(f"{head},rate\n10,1e-2\n100,1e-3\n", measure=measure)
        np.testing.assert_allclose(found.main.im, [0.1, 1.0])
        assert found.messages == ()
    averaged = '"AvgSA(0.2,2) [g]";rate\n0,1;0,01\n0,4;0,001\n'
    np.testing.assert_allclose(
        load(averaged, measure="AvgSA(0.2,2)").main.im, [0.1 * G, 0.4 * G]
    )
    named = load("sa(0.5),rate\n1,1e-2\n2,1e-3\n", measure="Sa(0.5)", unit="g")
    np.testing.assert_allclose(named.main.im, [G, 2 * G])


def test_openquake_has_names_and_units_of_averages_and_of_filtered_velocity(load):
    for measure, unit in (
        ("Sa_avg2(0.5)", G),
        ("Sa_avg3(0.5)", G),
        ("FIV3(0.5)", 0.01),
    ):
        found = load(openquake(imt=measure), measure=measure, **SITE)
        np.testing.assert_allclose(found.main.im, unit * np.array([0.005, 0.1, 0.4]))


@pytest.mark.parametrize(
    ("head", "value"),
    [
        ("Annual Rate of Exceedance (1/year)", "1e-2"),
        ("annual frequency of exceedance [1/yr]", "1e-2"),
        ("AFE", "1e-2"),
        ("annual rate", "1e-2"),
        ("rate [1/year]", "1e-2"),
        ("MAFE (1/a)", "1e-2"),
        ("Lambda", "1e-2"),
        ("RATE", "1e-2"),
        ("PoE_50", "0.3934693402873666"),
        ("Return period (years)", "100"),
        ("return_period", "100"),
    ],
)
@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_names_that_others_give_their_columns(load, head, value, separator):
    rows = ("# a site, made up", f"pga (g){separator}{head}", f"0.1{separator}{value}")
    rarer = float(value) * (4.0 if float(value) > 1.0 else 0.25)
    text = "\n".join((*rows, f"0.4{separator}{rarer}"))
    if separator != ",":
        text = text.replace(
            ".", ","
        )  # as a spreadsheet writes where the comma is decimal
    (found,) = load(text).curves.items()
    assert found[0] == "mean"
    np.testing.assert_allclose(found[1].im, [0.1 * G, 0.4 * G])
    assert found[1].rate[0] == pytest.approx(1e-2)
    named = load(
        text.replace(head, head.partition(" (")[0].partition(" [")[0] + "_0.84")
    )
    assert list(named.curves) == ["0.84"]


def test_the_page_on_risk_lists_all_names():
    page = (ROOT / "docs" / "howto" / "risk.md").read_text("utf-8")
    for name in _COLUMNS["rate"]["names"] + _COLUMNS["return period"]["names"]:
        assert f"`{name}`" in page, name


class TestOpenQuakeCsv:
    def test_nearest_site_in_g(self, load):
        found = load(openquake(), site=(13.41, 42.31))
        np.testing.assert_allclose(found.main.im, [0.005 * G, 0.1 * G, 0.4 * G])
        assert found.main.rate[1] == pytest.approx(-np.log(0.9) / 50.0)
        named = (
            openquake()
            .replace("lon,", "custom_site_id,lon,")
            .replace("\n1", "\nsite,1")
        )
        again = load(named, site=(13.4, 42.3))
        np.testing.assert_array_equal(again.main.rate, found.main.rate)

        found = load(openquake(), measure="RotD50(PGA)", site=(14.0, 42.3))
        assert "no component" in found.messages[0]

    def test_mean_comes_first_and_quantiles_follow(self, load):
        found = load(openquake("quantile-0.84", p="2.000000E-01"), openquake(), **SITE)
        assert list(found.curves) == ["mean", "quantile-0.84"]
        assert found.curves["quantile-0.84"].rate[1] > found.main.rate[1]
        with pytest.raises(InputError, match="hazard1: has a second curve 'mean'"):
            load(openquake(), openquake(), **SITE)


@pytest.mark.parametrize(
    ("text", "options", "part"),
    [
        ("", {}, "is not a table in CSV (No columns"),
        (
            "PGA,rate\n0.1,1e-2\n0.4,1e-3\n",
            {},
            "only the unit of PGA is missing: write `PGA [g]` "
            "in the header, or give --unit or risk.unit; allowed are g, m/s2",
        ),
        (
            "PGA [ft],rate\n0.1,1e-2\n0.4,1e-3\n",
            {},
            "'ft' is not a unit of PGA; allowed are g,",
        ),
        (
            "PGA [g],rate [1/day]\n0.1,1\n0.4,1\n",
            {},
            "has a column 'rate [1/day]'; the header is",
        ),
        (
            "PGA [g],often\n0.1,1\n0.4,1\n",
            {},
            "of rate of exceedance, rate, annual rate of",
        ),
        (
            "PGV [m/s],rate\n1,1\n2,0.5\n",
            {},
            "hazard of PGV, but the study's levels are of PGA",
        ),
        (
            "strength\n1\n",
            {},
            "has 'strength' as its first of 1 columns; the header is `im [g]`",
        ),
        ("PGA [g],poe_0\n0.1,0.1\n0.2,0.05\n", {}, "is for 0 years"),
        (
            "PGA [g],rate\n0.1,much\n",
            {},
            "must hold numbers, but: could not convert string to",
        ),
        (
            "PGA [g],rate\n0.1,1e-3\n0.2,1e-2\n",
            {},
            "rises from 0.001 to 0.01 at im = 0.2",
        ),
        (
            openquake(),
            {},
            "has 2 sites; choose one by longitude and latitude, such as 13.4,42.3",
        ),
        (
            openquake(),
            {"site": (12.0, 42.3)},
            "no site within 10 km of longitude 12, latitude 42",
        ),
        (openquake(), {"unit": "m/s2", **SITE}, "gives PGA in g, not in m/s2"),
        (openquake(imt="SA(0.3)"), SITE, "hazard of SA(0.3), but the study's"),
        (openquake(p="1.5"), SITE, "the hazard curve's probability holds 1.5"),
        (
            openquake().replace("imt=", "im="),
            SITE,
            "does not state imt and investigation_time",
        ),
        (
            '<?xml version="1.0"?>\n<nrml/>',
            {},
            "as its first of 1 columns; the header is",
        ),
    ],
)
def test_refusals_name_the_file(load, text, options, part):
    with pytest.raises(InputError, match=r"^[^\n]*hazard0: [^\n]*$") as found:
        load(text, **options)
    assert part in str(found.value)


IM = np.geomspace(0.2, 20.0, 12)
CURVE = HazardCurve(IM, 2e-3 * IM**-2.0)
HAZARD = Hazard(
    "PGA", "made up", {"mean": CURVE, "0.84": HazardCurve(IM, 4e-3 * IM**-2.0)}
)
FIT = Curve(4.0, 0.4, np.diag([0.005, 0.003]), 0.0, 9, 270, "stripes")


@pytest.fixture(scope="module")
def data():
    return cube(items=motions(30))


def with_verdicts(data, verdict, joint):
    """The cube with other verdicts, (n_record, n_level), and joints where the arch collapsed."""
    dims = data["verdict"].dims
    fell = verdict == 1
    return data.assign(
        verdict=(dims, verdict[None].astype(np.int8)),
        collapse_joint=(dims, np.where(fell, joint, -1)[None]),
        collapse_mode=(dims, fell[None].astype(np.int8)),
    )


class TestGridOfRuns:
    def test_rate_is_the_closed_form_to_which_all_parts_add_up(self, data):
        fit = answers_of(data)["ring"]
        found = risk_of(data, {"ring": fit}, HAZARD).arches["ring"]
        rate = found.rate.rate
        assert rate == pytest.approx(
            2e-3 * fit.theta**-2 * np.exp(2 * fit.beta**2), rel=1e-9
        )
        assert found.by_curve["0.84"] == pytest.approx(2.0 * rate, rel=1e-12)
        assert found.rate.lower < rate < found.rate.mean < found.rate.upper
        assert found.rate.below + found.rate.above < 0.05
        assert found.level_rate.sum() == pytest.approx(rate, rel=1e-12)
        parts = found.by_mechanism
        assert parts.rate.sum() + parts.unassigned.sum() == pytest.approx(
            rate, rel=1e-12
        )
        assert parts.counts.sum() == (data["verdict"].values == 1).sum()

    def test_the_rate_leaves_out_what_is_below_the_onset_of_motion(self, data):
        moving = data.assign(onset_plus=("arch", [0.3]), onset_minus=("arch", [0.2]))
        whole, found = (
            risk_of(each, {"ring": FIT}, HAZARD).arches["ring"]
            for each in (data, moving)
        )
        assert float(found.onset) == pytest.approx(0.2 * G)
        assert found.rate.below_onset > 0.0 == whole.rate.below_onset
        assert found.rate.rate + found.rate.below_onset == pytest.approx(
            whole.rate.rate
        )
        assert found.level_rate.sum() == pytest.approx(found.rate.rate, rel=1e-12)
        assert found.by_curve["0.84"] == pytest.approx(2.0 * found.rate.rate, rel=1e-12)
        vertical = moving.assign(record_vertical=0 * moving["record_vertical"] + 1)
        delayed, waved = (
            moving.assign_attrs(archfrag_config=f'{{"method": {method}}}')
            for method in ('{"bases": {"right": 0.05}}', '{"wave_speed": 400.0}')
        )
        other = moving.assign(intensity=moving["intensity"].assign_attrs(measure="PGV"))
        slides = moving.assign(static_limit=("arch", [np.nan]))
        for each in (vertical, delayed, waved, other, slides):
            assert (
                risk_of(each, {"ring": FIT}, HAZARD).arches["ring"].rate == whole.rate
            )

    def test_a_rate_from_below_the_lowest_collapse_is_cautioned(self, data):
        def cautions(first):
            verdict = np.zeros((30, 9), np.int8)
            verdict[:, first:] = 1
            found = risk_of(
                with_verdicts(data, verdict, 3), {"ring": FIT}, HAZARD
            ).arches["ring"]
            return [
                each for each in found.cautions if "lowest level at which a run" in each
            ]

        assert cautions(0) == []
        (found,) = cautions(8)
        assert re.match(
            r"\d+ % of the rate is from intensities below the lowest level", found
        )

    @pytest.mark.parametrize(("n_record", "cautioned"), [(30, False), (4, True)])
    def test_a_mean_rate_far_above_that_of_the_medians_is_cautioned(
        self, data, n_record, cautioned
    ):
        few = data.isel(record=slice(n_record))
        found = risk_of(few, answers_of(few), HAZARD).arches["ring"]
        assert (found.rate.mean > 2.0 * found.rate.rate) == cautioned
        words = [
            each for each in found.cautions if each.startswith("the mean rate over")
        ]
        assert len(words) == cautioned
        if cautioned:
            more = found.rate.mean / found.rate.rate
            assert f"is {more:.2g} times that of the median curve" in words[0]

    def test_short_hazard_curve_is_cautioned(self, data):
        short = Hazard(
            "PGA", "made up", {"mean": HazardCurve([0.2, 1.0], [0.05, 2e-3])}
        )
        found = risk_of(data, {"ring": FIT}, short).arches["ring"]
        assert found.rate.above > 0.9
        assert found.rate.quoted == pytest.approx(
            found.rate.rate * (1.0 - found.rate.above)
        )
        assert np.isnan([found.rate.mean, found.rate.lower, found.rate.upper]).all()
        assert found.cautions[0].startswith(
            "most of the rate is from outside the hazard curve"
        )
        assert any(
            "above the last point of the hazard curve" in each
            for each in found.cautions
        )


class TestDesigns:
    def test_bisected_records_give_the_fractions_of_the_full_grid(self, data):
        """A study of monotone records: what the bisection leaves out follows from the others."""
        generator = np.random.default_rng(5)
        levels = data["intensity"].values
        capacity = 4.0 * np.exp(0.4 * generator.standard_normal((30, 1)))
        full = (capacity < levels).astype(int)
        joint = np.broadcast_to(generator.integers(0, 8, (30, 1)), full.shape)
        first = np.argmax(full, axis=1)[:, None]
        place = np.arange(levels.size)
        seen = (
            (place == first) | (place == first - 1) | ((full == 0) & (place % 3 == 0))
        )
        assert not seen.all()
        one, other = (
            risk_of(with_verdicts(data, verdict, joint), {"ring": FIT}, HAZARD)
            for verdict in (full, np.where(seen, full, 4))
        )
        one, other = (found.arches["ring"].by_mechanism for found in (one, other))
        assert one.categories == other.categories
        np.testing.assert_array_equal(one.rate, other.rate)

    def test_runs_each_at_an_intensity_of_its_own(self, data):
        generator = np.random.default_rng(6)
        at = np.exp(generator.uniform(0.0, 2.0, (30, 1)))
        verdict = (4.0 * np.exp(0.4 * generator.standard_normal(at.shape)) < at).astype(
            int
        )
        one = with_verdicts(data.isel(level=[4]).drop_vars("intensity"), verdict, 2)
        units = {"units": "m s-2", "measure": "PGA"}
        one = one.assign(intensity=(data["verdict"].dims, at[None], units))
        found = risk_of(one, {"ring": FIT}, HAZARD).arches["ring"]
        assert found.by_mechanism.counts.sum() == verdict.sum()
        assert found.level_rate.sum() == pytest.approx(found.rate.rate, rel=1e-12)
        assert at.min() < found.levels[0] < found.levels[-1] < at.max()


def test_by_the_command(tmp_path):
    study = made(small_study(tmp_path)).study
    hazard = tmp_path / "hazard.csv"
    hazard.write_text(
        "PGA [g],rate,rate_0.84\n0.01,0.1,0.2\n0.1,1e-2,2e-2\n3,1e-5,2e-5\n"
    )
    asked = ("risk", tmp_path / "small.yaml", "--hazard", hazard)

    def with_curves(**curves):
        """Put other curves of arches into the fits of the study, which stay up to date."""
        made_up = json.loads((study.folder / FITS).read_text())
        for name, curve in curves.items():
            made_up["arches"][name]["curve"] = curve
        (study.folder / FITS).write_text(json.dumps(made_up))
        write_stamp(study, "fit")

    with_curves(ring=FIT.fit_dict())
    result = command(*asked, "--json", "--years", 100)
    assert result.exit_code == 0, result.output
    for option, value in (("years", 0), ("confidence", 2), ("confidence", "nan")):
        assert command(*asked, f"--{option}", value).exit_code == 2
    facts = json.loads(result.stdout)
    ring = facts["arches"]["ring"]
    assert ring["probability"] == pytest.approx(1.0 - np.exp(-100.0 * ring["rate"]))
    assert ring["theta"] == pytest.approx(FIT.theta / 9.80665)
    assert ring["rate_by_hazard_curve"]["0.84"] == pytest.approx(2.0 * ring["rate"])
    assert sum(ring["rate_by_level"]) == pytest.approx(ring["rate"])
    assert facts["hazard"]["curves"]["mean"]["im"] == pytest.approx([0.01, 0.1, 3.0])
    table = tmp_path / "loss.csv"
    model = tmp_path / "loss.xml"
    for path in (table, model):
        result = command(
            *asked, "--json", "--consequence", "collapse=0.5", "--vulnerability", path
        )
        assert result.exit_code == 0, result.output
    losses = json.loads(result.stdout)["losses"]["ring"]
    assert losses["aal"] == pytest.approx(0.5 * ring["rate"])
    assert losses["aal_lower"] == pytest.approx(0.5 * ring["rate_band"][0])
    points = pd.read_csv(table).query("arch == 'ring'")
    np.testing.assert_allclose(
        points["loss_ratio"], 0.5 * FIT(points["im"] * G), rtol=1e-9
    )
    text = model.read_text()
    (im,) = re.findall(r'id="ring" dist="LN">\s*<imls imt="PGA">([^<]*)<', text)
    np.testing.assert_allclose(
        np.array(im.split(), float), points["im"][1:], rtol=1e-12
    )
    assert (
        "average annual loss" in command(*asked, "--consequence", "collapse=0.5").stdout
    )
    by_python = archfrag.open(tmp_path / "small.yaml").losses(
        hazard, consequence={"collapse": 0.5}
    )
    assert by_python.loc["ring", "aal"] == losses["aal"]
    for options, message in (
        (["--vulnerability", table], "--vulnerability needs --consequence"),
        (["--consequence", "collapse"], "write it as NAME=RATIO"),
        (
            ["--consequence", "collapse=1", "--vulnerability", "a.txt"],
            "written as .csv or .xml",
        ),
    ):
        result = command(*asked, *options)
        assert result.exit_code == 2
        assert message in result.stderr
    with_curves(ring={"none": "nothing fell"}, slab={"none": "nothing fell"})
    result = command(*asked)
    assert result.exit_code == 6
    assert "ring: no rate, since there is no curve: nothing fell" in result.stdout
    assert (
        result.stderr == "archfrag: error: no arch has a curve, so there is no rate\n"
    )
