"""`famjax export`."""

import dataclasses
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from ..loading import load_fitting, schema_of, warn_unidentified

Name = Literal["c", "csv", "mat", "matlab", "mujoco", "mjx", "opensim", "jax"]


def export(
    muscle: str,
    *,
    to: tuple[Name, ...],
    output: Annotated[Path, Parameter(name=["--output", "-o"])] = Path("exported"),
    length: str | None = None,
    tendon_offset: str | None = None,
) -> int:
    """Write a muscle as C, tables, MATLAB functions, or for a simulator.

    Each file's head says what muscle it is of, and its largest difference from the model, measured
    when it is written. Targets:

    c: C99 of force, stiffness and inverse pressure, for a microcontroller; double or float.

    csv, mat: tables of force, stiffness and area over length and pressure.

    matlab: functions for MATLAB, Octave and Simulink's MATLAB Function block.

    mujoco: XML of a load that hangs on the muscle, and the actuator's callback.

    mjx: the model itself inside MJX's step, to be differentiated; runs with famjax.

    opensim: OpenSim's McKibbenActuator, the ideal braid alone.

    jax: the model itself with its derivative as StableHLO; runs with JAX, without famjax.

    Parameters
    ----------
    muscle
        A card of `famjax card`, a `fit.json` of `famjax fit`, or a bundled muscle, DMSP-10 or DMSP-20.
    to
        A target; can be given several times.
    output
        Folder of the files.
    length
        Rest length to which the muscle is cut, with its unit, such as 300mm.
    tendon_offset
        For mujoco and mjx: the tendon is of `fixed` type, which has no length at joint 0, and the muscle
        has this length there, such as 275mm. A `spatial` tendon as long as the muscle unless given.
    """
    load_fitting()
    from famjax.boundary.errors import InputError
    from famjax.boundary.units import parse_quantity
    from famjax.export import export as export_to

    cut = None if length is None else parse_quantity(length, "length")
    subject = _subject(muscle, cut)
    if tendon_offset is not None:
        if not set(to) & {"mujoco", "mjx"}:
            raise InputError(
                f"--tendon-offset is for mujoco and mjx alone, got --to {' --to '.join(to)}: leave it out"
            )
        offset = parse_quantity(tendon_offset, "length")
        subject = dataclasses.replace(subject, tendon_offset=offset)
    if subject.card is not None:
        made = subject.card.provenance
        warn_unidentified(muscle, made.verdict, made.reasons)
    for path in export_to(subject, to, output):
        print(f"written: {path}")
    return 0


def _subject(muscle: str, length: float | None):
    """The muscle of a fit, of a card, or a bundled one."""
    from famjax.boundary.origin import Origin
    from famjax.export import Subject, made_of, read_subject

    origin, path = Origin.of_this_command(), Path(muscle)
    if not schema_of(path).startswith("famjax-fit/"):
        return read_subject(muscle, length=length, origin=origin)
    from fitting.saved import card_of, load_fit

    card = card_of(load_fit(path), count=0, origin=origin)
    return Subject.of_card(
        card, length=length, origin=made_of(path.name, path.read_bytes(), origin)
    )
