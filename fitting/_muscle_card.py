"""The muscle card: a muscle as plain data with the unit in every key, and back."""

from typing import Any

import numpy as np

import famjax

from ._errors import InputError


def muscle_as_dict(muscle: famjax.Muscle) -> dict[str, Any]:
    """The muscle as JSON-ready data in SI, exact to the last digit.

    Raises:
        InputError: a part of the muscle has no card format.
    """
    geometry, material = muscle.geometry, muscle.material
    if not isinstance(geometry, famjax.EstimatedGeometry) or not isinstance(
        geometry.braid, famjax.Braid
    ):
        raise InputError(
            "a muscle card holds an EstimatedGeometry with an inextensible Braid, got "
            f"{type(geometry).__name__}"
        )
    return {
        "geometry": {
            "type": "EstimatedGeometry",
            "braid": {
                "rest_thread_length_m": float(geometry.braid.rest_thread_length),
                "turns": float(geometry.braid.turns),
                "thickness_m": float(geometry.braid.thickness),
            },
            "bladder": {
                "rest_length_m": float(geometry.bladder.rest_length),
                "rest_diameter_m": float(geometry.bladder.rest_diameter),
                "rest_thickness_m": float(geometry.bladder.rest_thickness),
                "embedded": geometry.bladder.embedded,
            },
        },
        "material": _material_as_dict(material),
        "deadband_pressure_Pa": float(muscle.deadband_pressure),
    }


def _material_as_dict(material: famjax.AbstractMaterial) -> dict[str, Any]:
    if isinstance(material, famjax.PolynomialMaterial):
        coefficients = np.asarray(material.coefficients).tolist()
        return {"type": "PolynomialMaterial", "coefficients_Pa": coefficients}
    if isinstance(material, famjax.PressurePolynomialMaterial):
        return {
            "type": "PressurePolynomialMaterial",
            "node_pressures_Pa": np.asarray(material.node_pressures).tolist(),
            "node_coefficients_Pa": np.asarray(material.node_coefficients).tolist(),
        }
    raise InputError(f"no card format for the material {type(material).__name__}")


def muscle_from_dict(card: dict[str, Any]) -> famjax.Muscle:
    """The muscle of a card.

    Raises:
        InputError: the card lacks an entry, or names a type that is not known.
    """
    try:
        geometry, material = card["geometry"], card["material"]
        if geometry["type"] != "EstimatedGeometry":
            raise InputError(f"unknown geometry {geometry['type']!r} in the muscle card")
        braid, bladder = geometry["braid"], geometry["bladder"]
        law: famjax.AbstractMaterial
        if material["type"] == "PolynomialMaterial":
            law = famjax.PolynomialMaterial(np.array(material["coefficients_Pa"], float))
        elif material["type"] == "PressurePolynomialMaterial":
            law = famjax.PressurePolynomialMaterial(
                np.array(material["node_pressures_Pa"], float),
                np.array(material["node_coefficients_Pa"], float),
            )
        else:
            raise InputError(f"unknown material {material['type']!r} in the muscle card")
        return famjax.Muscle(
            famjax.EstimatedGeometry(
                famjax.Braid(braid["rest_thread_length_m"], braid["turns"], braid["thickness_m"]),
                famjax.Bladder(
                    bladder["rest_length_m"],
                    bladder["rest_diameter_m"],
                    bladder["rest_thickness_m"],
                    embedded=bladder["embedded"],
                ),
            ),
            law,
            card["deadband_pressure_Pa"],
        )
    except KeyError as error:
        raise InputError(f"the muscle card has no entry {error}; was the file edited?") from None
