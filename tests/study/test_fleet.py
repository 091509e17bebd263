"""Tables of arches: rows become arches, mistakes one message with file, line and column."""

import numpy as np
import pytest
from pydantic import TypeAdapter

from archfrag.errors import StudyError
from archfrag.study.arches import StudyArch
from archfrag.study.members import expand

DEFAULTS = {
    "id": "fleet", "profile": "circular", "embrace": 157.5, "voussoirs": 7, "friction": 0.7,
}  # fmt: skip
TABLE = """\
id,radius,thickness,friction,region,built
old,10.0,1.5,0.6,north,1880
wide,12,1.8,,south,1901

late,8.0,1.25,inf,north,
"""


def fleet(folder, text=TABLE, **changed):
    path = folder / "fleet.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    given = {**DEFAULTS, "table": str(path), **changed}
    given = {key: value for key, value in given.items() if value is not None}
    return TypeAdapter(StudyArch).validate_python(given)


class TestRows:
    def test_cells_are_keys_and_the_entry_fills_the_others(self, tmp_path):
        found = expand([fleet(tmp_path)])
        assert found.ids == ["old", "wide", "late"]
        assert found.classes == ["fleet"] * 3
        assert [arch.friction for arch in found.entries] == [0.6, 0.7, np.inf]
        assert [arch.radius for arch in found.entries] == [10.0, 12.0, 8.0]
        assert {(arch.embrace, arch.voussoirs) for arch in found.entries} == {(157.5, 7)}
        assert found.meets(2).all()

    def test_lists_and_a_spreadsheets_full_numbers(self, tmp_path):
        text = '\ufeffid,radius,thickness,voussoirs,friction\r\na,10,1.5,2.0,"[0.5, 0.6, 0.7]"\r\n'
        (arch,) = expand([fleet(tmp_path, text)]).entries
        assert (arch.voussoirs, arch.friction) == (2, (0.5, 0.6, 0.7))

    def test_rows_may_vary_each_on_its_own(self, tmp_path):
        vary = {
            "samples": 4,
            "of": {"thickness": {"distribution": "normal", "mean": 1.0, "cov": 0.05,
                                 "relative": True}},
        }  # fmt: skip
        found = expand([fleet(tmp_path, vary=vary)])
        assert len(found) == 12
        assert found.ids[:2] == ["old-0001", "old-0002"]
        thickness = np.array([arch.thickness for arch in found.entries])
        np.testing.assert_array_equal(thickness, found.parameters()["thickness"])
        factors = thickness.reshape(3, 4) / [[1.5], [1.8], [1.25]]
        assert np.abs(factors[0] - factors[1]).min() > 1e-6
        # Whatever other rows there are.
        alone = expand([fleet(tmp_path, "".join(TABLE.splitlines(True)[i] for i in (0, 2)),
                              vary=vary)])  # fmt: skip
        assert [a.thickness for a in alone.entries] == thickness[4:8].tolist()

    def test_an_edited_table_is_read_again(self, tmp_path):
        entry = fleet(tmp_path)
        assert expand([entry]).entries[0].radius == 10.0
        fleet(tmp_path, TABLE.replace("old,10.0", "old,10.25"))
        assert expand([entry]).entries[0].radius == 10.25


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("12,1.8", "12,1.8m", "line 3, column thickness = 1.8m must be a number"),
        ("8.0,1.25", "8.0,", "line 5, column thickness is missing"),
        ("late,8.0", "old,8.0", "line 5, column id: 'old' is the id of line 2 too; each arch "
         "needs its own"),
        ("late,8.0", "l te,8.0", "line 5, column id = l te must begin with a letter or a digit "
         "and hold only letters, digits and _ . + -"),
        (",south,1901", ",south", "line 3: has 5 cells; it must have 6, one for each column of "
         "the first line"),
        ("built", "region", "line 1: column region is there twice"),
        ("region", "", "line 1: column 5 must have a name"),
        ("region", "vary", "line 1: vary must be given in the study file"),
        ("region", "Thicknes", "line 1: column Thicknes is no key of an arch; did you mean "
         "thickness?"),
        ("id,", "name,", "line 1: a column id is missing"),
        ("0.6,north", '"[0.6, x]",north', "line 2, column friction[1] = x must be a number"),
        ("0.6,north", '2e6,north', "line 2, column friction = 2000000 must be at most 1e+06, or "
         "inf for no sliding"),
        ("id,radius", "id,span", "line 2, column span is no known key; allowed are "),
    ],
)  # fmt: skip
def test_a_bad_table_is_one_message(tmp_path, old, new, message):
    entry = fleet(tmp_path, TABLE.replace(old, new, 1))
    with pytest.raises(StudyError) as refusal:
        expand([entry])
    path = f"arches[0] (fleet): {tmp_path / 'fleet.csv'}"
    assert str(refusal.value).startswith(f"{path}, {message}")
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("id,radius\n", "must have a line for each arch below its first line"),
        (TABLE.encode("utf-16"), "fleet.csv is not text in UTF-8"),
        (TABLE.replace(",", ";"), "line 1: a column id is missing (commas must be between them)"),
    ],
    ids=["no row", "utf-16", "semicolons"],
)
def test_what_is_no_table(tmp_path, text, message):
    with pytest.raises(StudyError) as refusal:
        expand([fleet(tmp_path, text)])
    assert message in str(refusal.value)
