"""Tables of arches: rows become arches, mistakes one message with file, arch and column."""

import numpy as np
import pytest

from archfrag.errors import StudyError
from archfrag.study.file.arches import ArchEntry
from archfrag.study.file.members import expand

DEFAULTS = {
    "id": "fleet", "profile": "circular", "embrace": 157.5, "voussoirs": 7, "friction": 0.7,
}  # fmt: skip
TABLE = """\
# From a survey.
id,radius,thickness,friction,region,built
old,10.0,1.5,0.6,north,1880
wide,12,1.8,,south,1901

late,8.0,1.25,inf,north,
"""


def fleet(folder, text=TABLE, **changed):
    path = folder / "fleet.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return ArchEntry.model_validate({**DEFAULTS, "table": str(path), **changed})


class TestRows:
    def test_cells_are_keys_and_the_entry_fills_the_others(self, tmp_path):
        entry = fleet(tmp_path)
        found = expand([entry])
        assert found.ids == ["old", "wide", "late"]
        assert found.classes == ["fleet"] * 3
        assert [arch.friction for arch in found.entries] == [0.6, 0.7, np.inf]
        assert [arch.radius for arch in found.entries] == [10.0, 12.0, 8.0]
        assert {(arch.embrace, arch.voussoirs) for arch in found.entries} == {(157.5, 7)}
        assert found.attributes()["built"] == ["1880", "1901", ""]
        fleet(tmp_path, TABLE.replace("old,10.0", "old,10.25"))  # which is read again
        assert expand([entry]).entries[0].radius == 10.25

    def test_lists_and_a_spreadsheets_full_numbers(self, tmp_path):
        text = '\ufeffid,radius,thickness,voussoirs,friction\r\na,10,1.5,2.0,"[0.5, 0.6, 0.7]"\r\n'
        (arch,) = expand([fleet(tmp_path, text)]).entries
        assert (arch.voussoirs, arch.friction) == (2, [0.5, 0.6, 0.7])

    def test_rows_may_vary_each_on_its_own(self, tmp_path):
        normal = {"distribution": "normal", "mean": 1.0, "cov": 0.05, "relative": True}
        vary = {"samples": 4, "of": {"thickness": normal}}
        found = expand([fleet(tmp_path, vary=vary)])
        assert len(found) == 12
        assert found.ids[:2] == ["old-0001", "old-0002"]
        thickness = np.array([arch.thickness for arch in found.entries])
        np.testing.assert_array_equal(thickness, found.parameters()["thickness"])
        factors = thickness.reshape(3, 4) / [[1.5], [1.8], [1.25]]
        assert np.abs(factors[0] - factors[1]).min() > 1e-6
        alone = "".join(TABLE.splitlines(True)[i] for i in (1, 3))  # whatever other rows there are
        found = expand([fleet(tmp_path, alone, vary=vary)])
        assert [arch.thickness for arch in found.entries] == thickness[4:8].tolist()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("12,1.8", "12,1.8m", ", arch wide: thickness = '1.8m' must be"),
        ("8.0,1.25", "8.0,", ", arch late: thickness is missing"),
        ("late,8.0", "old,8.0", ": several arches have the id 'old'"),
        ("late,8.0", "l te,8.0", ", arch l te: id = l te must begin with"),
        (",south,1901", ",south,1901,x", ": is not a table in CSV (Error tokenizing data"),
        ("region", "Thicknes", ": column Thicknes is not a key of an arch; did you mean"),
        (TABLE, TABLE.replace(",", ";"), ": must have arches and a column id; commas"),
        ("0.6,north", '"[0.6, x]",north', ", arch old: friction[1] = 'x' must be"),
        ("0.6,north", '"[0.6",north', ", column friction: line 1: expected ',' or ']'"),
        ("id,radius", "id,span", ", arch old: span is not a known key; allowed are "),
    ],
)
def test_a_bad_table_is_one_message(tmp_path, old, new, message):
    with pytest.raises(StudyError) as refusal:
        expand([fleet(tmp_path, TABLE.replace(old, new, 1))])
    assert str(refusal.value).startswith(f"arches[0] (fleet): {tmp_path / 'fleet.csv'}{message}")
    assert "\n" not in str(refusal.value)


def test_a_table_that_is_no_text_in_utf_8(tmp_path):
    with pytest.raises(StudyError, match=r"fleet\.csv is not text in UTF-8"):
        expand([fleet(tmp_path, TABLE.encode("utf-16"))])
