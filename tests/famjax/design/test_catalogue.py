import math

import pytest

from famjax import units
from famjax.design import CatalogueError, load_catalogue

INCH = units.INCH

# Table 2.2: nominal diameter, thickness, diameter range [in], angle range [deg].
TABLE_2_2 = [
    (1.5, 0.012, (0.60, 1.75), (73.6, 34.4)),
    (2.0, 0.011, (0.76, 2.23), (74.4, 38.0)),
    (2.5, 0.018, (1.40, 2.65), (66.7, 41.5)),
]
BRAID = """
source = "a vendor"
[[braid]]
name = "PET 20 mm"
nominal_diameter_mm = 20
thickness_mm = 0.5
diameter_range_mm = [10, 25]
"""
BLADDER = """
source = "a vendor"
[[bladder]]
diameter_mm = 12
thickness_mm = [1, 2]
"""
TUBE = """
source = "a vendor"
[[tube]]
outer_diameter_mm = 25
thickness_mm = 1.5
swage_reduction_mm = 0.7
"""


def read(tmp_path, text, *, bundled=False):
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return load_catalogue([path], bundled=bundled)


def test_bundled_braids_are_those_of_table_2_2():
    found = load_catalogue().braids
    for braid, (nominal, thickness, diameters, angles) in zip(found, TABLE_2_2, strict=True):
        assert braid.nominal_diameter == pytest.approx(nominal * INCH)
        assert braid.thickness == pytest.approx(thickness * INCH)
        assert braid.diameter_range == pytest.approx([d * INCH for d in diameters])
        assert braid.angle_range == pytest.approx([math.radians(a) for a in angles])
        assert "Chambers 2021" in braid.source


def test_a_users_file_can_replace_the_bundled_catalogue(tmp_path):
    catalogue = read(tmp_path, BLADDER)
    assert (catalogue.braids, catalogue.tubes) == ((), ())
    assert [b.bore for b in catalogue.bladders] == pytest.approx([0.010, 0.008])


@pytest.mark.parametrize(
    ("text", "old", "new", "message"),
    [
        (BRAID, "thickness_mm", "thickness", "number 1 .'PET 20 mm'.: thickness has no unit.*_in"),
        (BRAID, "thickness_mm", "wall_mm", "unknown key 'wall_mm'; thickness_<unit> is missing"),
        (BRAID, "[10, 25]", "[25, 10]", r"\[smallest, largest\]"),
        (BRAID, "[10, 25]", "[21, 25]", "with the nominal diameter between them"),
        (BRAID, "[10, 25]", "[10, 30]", "at which the threads lie all round"),
        (BRAID, "[10, 25]", "[10, 25]\nboundary_range_mm = [11, 25]", "must contain diameter_range"),
        (BRAID, "[10, 25]", "[10, 25]\nboundary_range_mm = [9, 29]", "end below"),
        (BRAID, "[[braid]]", "[[braids]]", "unknown key 'braids'; known are source, braid"),
        (BRAID, "[[braid]]", "[braid]", "two brackets"),
        (BRAID, 'source = "a vendor"', "", "where its numbers come from"),
        (BRAID, "thickness_mm = 0.5", "thickness_mm 0.5", "not a TOML file"),
        (BLADDER, "[1, 2]", "[1, 6]", "closes a tube"),
        (BLADDER, "[1, 2]", "[1, 1]", "is there twice"),
        (TUBE, "swage_reduction_mm = 0.7", "swage_reduction_mm = 23", "closes a tube"),
    ],
)  # fmt: skip
def test_a_wrong_row_is_refused_with_the_reason(tmp_path, text, old, new, message):
    assert old in text
    with pytest.raises(CatalogueError, match=message):
        read(tmp_path, text.replace(old, new))
