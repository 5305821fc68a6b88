from .errors import InputError as InputError, check_seed as check_seed
from .files import (
    Origin as Origin,
    as_png as as_png,
    check_output as check_output,
    write_all as write_all,
)
from .units import (
    SYSTEMS as SYSTEMS,
    UNITS as UNITS,
    entry as entry,
    factor as factor,
    from_si as from_si,
    parse_quantities as parse_quantities,
    parse_quantity as parse_quantity,
    quantity_unit as quantity_unit,
    si_unit as si_unit,
    to_si as to_si,
    unit_system as unit_system,
)
