"""Hazard curves of files: read as they are meant, refused with one message otherwise."""

import numpy as np
import pytest

from archfrag.errors import InputError
from archfrag.study.file.hazard import load_hazard

G = 9.80665
OPENQUAKE = """\
#,,,,,,"generated_by='OpenQuake engine 3.26.0-gitabc', start_date='2026-05-04T12:20:05', \
checksum=42, kind='{kind}', investigation_time=50.0, imt='{imt}'"
lon,lat,depth,poe-0.0050000,poe-0.1000000,poe-0.4000000,poe-1.0000000
13.40000,42.30000,0.00000,9.999000E-01,{p},5.000000E-03,0.000000E+00
14.00000,42.30000,0.00000,8.000000E-01,5.000000E-02,2.000000E-03,1.000000E-04
"""
NRML = """\
<?xml version="1.0" encoding="utf-8"?>
<nrml xmlns:gml="http://www.opengis.net/gml" xmlns="http://openquake.org/xmlns/nrml/0.{version}">
  <hazardCurves {kind} investigationTime="50.0" IMT="SA" saPeriod="0.5" saDamping="5.0">
    <IMLs>1.0E-02 1.0E-01 1.0E+00</IMLs>
    <hazardCurve><gml:Point><gml:pos>13.4 42.3</gml:pos></gml:Point>
      <poEs>9.0E-01 1.0E-01 1.0E-03</poEs></hazardCurve>
    <hazardCurve><gml:Point><gml:pos>14.0 42.3</gml:pos></gml:Point>
      <poEs>8.0E-01 5.0E-02 5.0E-04</poEs></hazardCurve>
  </hazardCurves>
  <hazardCurves {kind} investigationTime="50.0" IMT="PGA">
    <IMLs>1.0E-02 1.0E-01</IMLs>
    <hazardCurve><gml:Point><gml:pos>13.4 42.3</gml:pos></gml:Point>
      <poEs>9.0E-01 2.0E-01</poEs></hazardCurve>
  </hazardCurves>
</nrml>
"""


def openquake(kind="mean", imt="PGA", p="1.000000E-01"):
    return OPENQUAKE.format(kind=kind, imt=imt, p=p)


@pytest.fixture
def load(tmp_path):
    """Read texts, each as a file."""

    def load_texts(*texts, measure="PGA", unit=None, site=None):
        paths = [tmp_path / f"hazard{i}" for i in range(len(texts))]
        for path, text in zip(paths, texts):
            path.write_text(text, encoding="utf-8")
        return load_hazard(paths, measure, unit, site)

    return load_texts


class TestPlain:
    def test_rates_and_quantiles(self, load):
        found = load("# a site\nPGA [g],rate_0.84,rate\n0.1,2e-2,1e-2\n\n0.4,8e-4,4e-4\n")
        assert list(found.curves) == ["mean", "0.84"]
        np.testing.assert_allclose(found.main.im, [0.1 * G, 0.4 * G])
        np.testing.assert_array_equal(found.main.rate, [1e-2, 4e-4])
        assert found.notes == ()

    def test_probabilities_in_years(self, load):
        found = load("im,poe_50\n0.1,0.1\n0.4,0.02\n", unit="g")
        assert 1.0 / found.main.rate[0] == pytest.approx(474.561, rel=1e-5)
        assert "taken to be PGA" in found.notes[0]

    def test_other_measures_and_units(self, load):
        for measure, head in (("Sa(0.5)", "SA(0.50) [gal]"), ("PGV", "PGV [cm/s]")):
            found = load(f"{head},rate\n10,1e-2\n100,1e-3\n", measure=measure)
            np.testing.assert_allclose(found.main.im, [0.1, 1.0])


class TestOpenQuakeCsv:
    def test_nearest_site_in_g(self, load):
        found = load(openquake(), site=(13.41, 42.31))
        np.testing.assert_allclose(found.main.im, [0.005 * G, 0.1 * G, 0.4 * G])
        assert found.main.rate[1] == pytest.approx(-np.log(0.9) / 50.0)
        named = openquake().replace("lon,", "custom_site_id,lon,").replace("\n1", "\nsite,1")
        again = load(named, site=(13.4, 42.3))
        np.testing.assert_array_equal(again.main.rate, found.main.rate)

    def test_mean_comes_first_and_quantiles_follow(self, load):
        found = load(openquake("quantile-0.84", p="2.000000E-01"), openquake(), site=(13.4, 42.3))
        assert list(found.curves) == ["mean", "quantile-0.84"]
        assert found.curves["quantile-0.84"].rate[1] > found.main.rate[1]

    def test_component_that_it_cannot_name(self, load):
        found = load(openquake(), measure="RotD50(PGA)", site=(14.0, 42.3))
        assert "no component" in found.notes[0]


@pytest.mark.parametrize("version", [4, 5])
def test_measure_and_site_of_nrml_are_chosen(load, version):
    text = NRML.format(version=version, kind='statistics="mean"')
    found = load(text, measure="Sa(0.5)", site=(14.0, 42.3))
    assert list(found.curves) == ["mean"]
    np.testing.assert_allclose(found.main.im, [0.01 * G, 0.1 * G, G])
    assert found.main.rate[1] == pytest.approx(-np.log(0.95) / 50.0)
    assert load(text).main.im.size == 2


SITE = {"site": (13.4, 42.3)}


@pytest.mark.parametrize(
    ("text", "options", "part"),
    [
        ("", {}, "is not a table in CSV (No columns"),
        ("PGA,rate\n0.1,1e-2\n0.4,1e-3\n", {}, "no unit is stated; give one of g, m/s2"),
        ("PGV [m/s],rate\n1,1\n", {}, "hazard of PGV, but the study's levels are of PGA"),
        ("strength\n1\n", {}, "has 'strength' as its first of 1 columns; the header is `im [g]`"),
        ("strength,rate\n1,1\n", {}, "hazard of strength, but the study's levels are of PGA"),
        ("PGA [g],frequency\n1,1\n", {}, "has a column 'frequency'"),
        ("PGA [g],poe_0\n0.1,0.1\n0.2,0.05\n", {}, "is for 0 years"),
        ("PGA [g],rate\n0.1,much\n", {}, "must hold numbers, but: could not convert string to"),
        ("PGA [g],rate\n0.1,1e-3\n0.2,1e-2\n", {}, "rises from 0.001 to 0.01 at im = 0.2"),
        (openquake(), {}, "has 2 sites; choose one by longitude and latitude, such as 13.4,42.3"),
        (openquake(), {"site": (12.0, 42.3)}, "no site within 10 km of longitude 12, latitude 42"),
        (openquake(), {"unit": "m/s2", **SITE}, "gives PGA in g, not in m/s2"),
        (openquake(imt="SA(0.3)"), SITE, "hazard of SA(0.3), but the study's"),
        (openquake(p="1.5"), SITE, "the hazard curve's probability holds 1.5"),
        (openquake().replace("imt=", "im="), SITE, "does not state imt and investigation_time"),
        ("<nrml><hazardCurves", {}, "is not XML"),
        ("<nrml><other/></nrml>", {}, "no element hazardCurves"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><nrml/>', {}, "declares a document type"),
        ('<nrml><hazardCurves IMT="PGA"/></nrml>', {}, "must hold numbers"),
        ('<nrml><hazardCurves IMT="PGA" investigationTime="1"/></nrml>', {}, "without IMLs"),
    ],
)
def test_refusals_name_the_file(load, text, options, part):
    with pytest.raises(InputError, match=r"^[^\n]*hazard0: [^\n]*$") as found:
        load(text, **options)
    assert part in str(found.value)


def test_two_files_with_one_curve(load):
    with pytest.raises(InputError, match="hazard1: has a second curve 'mean'"):
        load(openquake(), openquake(), site=(13.4, 42.3))
