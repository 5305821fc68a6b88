"""The columns of a campaign's table: kinds, units and names in files."""

from famjax.boundary.units import factor, unit_system

_COLUMNS = {
    "time": (
        "time",
        "when the picture was taken, after the first stamped one, by the camera's clock",
    ),
    "length": ("length", "between the inner edges of the two tapes, along the axis"),
    "mean_diameter": ("length", "mean of the diameter over the length"),
    "max_diameter": ("length", "largest diameter"),
    "volume": ("volume", "enclosed by the outside of the braid"),
    "contraction": (None, "(rest length - length) / rest length"),
    "px_per_m": (None, "scale at the mid-plane of the muscle"),
    "roll_deg": (None, "angle of the axis to the columns of the picture"),
    "braid_angle_deg": (
        None,
        "between yarns and circumference, mean over where the weave is resolved",
    ),
    "braid_angle_resolved": (None, "part of the length over which the braid angle is resolved"),
    "yarns": (None, "of the braid around the circumference in each direction"),
    "turns": (None, "of a yarn about the axis over the length, from the braid angle"),
    "triangle_angle_deg": (
        None,
        "braid angle of the cylinder with the mean diameter, atan(L / (pi N D)), N the recipe's turns",
    ),
    "x0": ("length", "distance of the axis from the optical axis, to the right"),
    "distance": ("length", "of the camera to the axis: as stated, or by the tapes' arcs"),
    "tilt_deg": (None, "of the axis in depth, its lower end away from the camera"),
    "bow": ("length", "largest deviation of the mid-line from a straight one"),
    "log_time": ("time", "time of the picture by the machine's clock"),
    "displacement": ("length", "of the machine, at the time of the picture"),
    "force": ("force", "of the machine's log at the time of the picture"),
    "pressure": ("pressure", "gauge, of the machine's log at the time of the picture"),
}
"""Kind of unit, None where the name says the unit, and meaning; of others the name says both."""


def _column(name: str) -> tuple[str | None, str]:
    """Kind and meaning of a column, a standard error's being those of its quantity."""
    return _COLUMNS.get(name.removesuffix("_stderr"), (None, ""))


def describe(name: str) -> str:
    """What a column holds, in words; empty where its name says it."""
    about = _column(name)[1]
    return f"standard error: {about}" if about and name.endswith("_stderr") else about


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
    kind = _column(name)[0]
    if kind is None:
        return "", 1.0
    unit = unit_system(system)[kind]
    return unit, factor(unit, kind)


def cf_unit(name: str) -> str:
    """Unit in the spelling of the CF conventions."""
    kind = _column(name)[0]
    if kind is not None:
        return unit_system("si")[kind]
    for ending, unit in {"_deg": "degree", "_px": "pixel", "px_per_m": "pixel m-1"}.items():
        if name.removesuffix("_stderr").endswith(ending):
            return unit
    return "1"
