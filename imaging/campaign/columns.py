"""The columns of a campaign's table: kinds, units and names in files."""

from famjax.boundary.units import factor, unit_system

_KINDS = {
    "time": "time",
    "length": "length",
    "length_stderr": "length",
    "mean_diameter": "length",
    "mean_diameter_stderr": "length",
    "max_diameter": "length",
    "volume": "volume",
    "volume_stderr": "volume",
    "x0": "length",
    "log_time": "time",
    "displacement": "length",
    "force": "force",
    "force_stderr": "force",
    "pressure": "pressure",
    "pressure_stderr": "pressure",
}
"""Kind of unit of the columns that have one; the name of any other says what it is."""

_ABOUT = {
    "time": "when the picture was taken, after the first stamped one, by the camera's clock",
    "length": "between the inner edges of the two tapes, along the axis",
    "mean_diameter": "mean of the diameter over the length",
    "max_diameter": "largest diameter",
    "volume": "enclosed by the outside of the braid",
    "contraction": "(rest length - length) / rest length",
    "px_per_m": "scale at the mid-plane of the muscle",
    "roll_deg": "angle of the axis to the columns of the picture",
    "x0": "distance of the axis from the optical axis, to the right",
    "log_time": "time of the picture by the machine's clock",
    "displacement": "of the machine, at the time of the picture",
    "force": "of the machine's log at the time of the picture",
    "pressure": "gauge, of the machine's log at the time of the picture",
}


def describe(name: str) -> str:
    """What a column holds, in words; empty where its name says it."""
    quantity = name.removesuffix("_stderr")
    if quantity not in _ABOUT:
        return ""
    return ("standard error: " if quantity != name else "") + _ABOUT[quantity]


def column_name(name: str, system: str) -> str:
    """The name of a column in a file, with its unit.

    >>> column_name("length", "us"), column_name("px_per_m", "metric"), column_name("roll_deg", "us")
    ('length_in', 'px_per_mm', 'roll_deg')
    """
    unit, _ = column_unit(name, system)
    if name == "px_per_m":
        return f"px_per_{unit_system(system)['length']}"
    return f"{name}_{unit}" if unit else name


def column_unit(name: str, system: str) -> tuple[str, float]:
    """Unit of a column, and SI per unit."""
    if name == "px_per_m":
        return "", factor(unit_system(system)["scale"], "scale")
    if name not in _KINDS:
        return "", 1.0
    unit = unit_system(system)[_KINDS[name]]
    return unit, factor(unit, _KINDS[name])


def cf_unit(name: str) -> str:
    """Unit in the spelling of the CF conventions."""
    if name in _KINDS:
        return unit_system("si")[_KINDS[name]]
    for ending, unit in {"_deg": "degree", "_px": "pixel", "px_per_m": "pixel m-1"}.items():
        if name.endswith(ending):
            return unit
    return "1"
