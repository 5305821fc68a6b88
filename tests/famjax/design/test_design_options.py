import pytest

from famjax import units
from famjax.boundary.errors import InputError
from famjax.design.cli import parse_requirement


def test_entries_are_read_in_any_known_unit():
    found = parse_requirement(["pressure_bar=6", " force_lbf = 900", "largest_diameter_mm=55"])
    assert found.pressure == 6e5
    assert found.force == pytest.approx(900 * units.LBF)
    assert found.largest_diameter == pytest.approx(0.055)
    assert (found.contraction, found.force_contraction) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        (["force=1"], "force has no unit.*one of force_N"),
        (["force_bar=1"], "unknown unit 'bar'"),
        (["pressure_psi=much"], "'much'"),
        (["pressure_psi"], "must read name=value"),
        (["pressure_psi=nan"], "finite"),
        (["pressure_psi=1", "pressure_bar=1"], "pressure is given twice"),
        (["force_N=1"], "pressure_<unit> is missing"),
        (["pressure_psi=1", "width_mm=3"], "unknown key 'width_mm'; known are pressure"),
    ],
)
def test_a_wrong_entry_is_refused(entries, message):
    with pytest.raises(InputError, match=message):
        parse_requirement(entries)
