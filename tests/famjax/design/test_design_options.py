import pytest

from famjax import units
from famjax.boundary.errors import InputError
from famjax.design.cli import parse_requirement, parse_tube


def test_entries_are_read_in_any_known_unit():
    found = parse_requirement(["pressure_bar=6", " force_lbf = 900", "largest_diameter_mm=55"])
    assert found.pressure == 6e5
    assert found.force == pytest.approx(900 * units.LBF)
    assert found.largest_diameter == pytest.approx(0.055)
    assert (found.contraction, found.force_contraction) == (0.0, 0.0)


def test_what_is_said_of_the_tube():
    found = parse_tube(["modulus_psi=10e6", "supported_length_in=1.85"])
    assert found.modulus == pytest.approx(10e6 * units.PSI)
    assert found.supported_length == pytest.approx(1.85 * units.INCH)
    assert found.yield_stress is found.free_length is None
    assert parse_tube([]) == type(found)()


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        (["modulus=1"], "unknown tube option 'modulus=1'; known are modulus_Pa"),
        (["modulus_bar=1"], "unknown tube option"),
        (["modulus_psi=stiff"], "'stiff' is not a number"),
        (["modulus_psi"], "'' is not a number"),
        (["modulus_psi=nan"], "finite"),
        (["modulus_psi=0"], "the tube's modulus must be > 0"),
        (["modulus_psi=1", "modulus_GPa=1"], "modulus is given twice"),
    ],
)
def test_a_wrong_entry_is_refused(entries, message):
    with pytest.raises(InputError, match=message):
        parse_tube(entries)
