"""What the commands of a rig ask a person before they do it."""

import sys

from ...boundary.units import from_si

PRECONDITIONS: dict[str, tuple[str, ...]] = {
    "air": (
        "The supply regulator is set no higher than muscle and hoses are rated for.",
        "A normally open dump valve vents the muscle when it loses its supply.",
        "The proportional valve exhausts at 0 % output.",
        "Nobody stands in line with the muscle's ends.",
    ),
    "water": (
        "A mechanical relief valve is fitted: software cannot stop the peak when the needle valve "
        "blocks (239 psi and more were computed in a circuit that trips within 6 ms).",
        "A normally open dump valve leads to the tank.",
        "The pump stops at 0 % output, and its supply has a switch within reach.",
        "The circuit is bled: trapped air stores energy.",
    ),
}
"""What must hold before a circuit is pressurised and software cannot check."""


def known_port(port: str | None) -> str:
    """The port, or an error that lists what there is to choose from."""
    from rig import RigError
    from rig.control import ports

    if port is not None:
        return port
    known = ", ".join(f"{row['port']} ({row['description']})" for row in ports())
    raise RigError(
        f"which port? --port PORT; this computer has {known or 'none: plug the device in'}"
    )


def typed(question: str) -> str:
    """The answer that a person types."""
    from rig import RigError

    try:
        return input(question)
    except EOFError:
        raise RigError("standard input ended before the question was answered") from None


def tell_preconditions(test) -> None:
    """Print what must hold before the circuit of a test is pressurised and software cannot check."""
    print(
        f"Circuit of {test.circuit}, limit {test.pressure_limit / 1e3:.4g} kPa "
        f"({from_si(test.pressure_limit, 'psi', 'pressure'):.4g} psi). Make sure that:"
    )
    for sentence in PRECONDITIONS[test.circuit]:
        print(f"- {sentence}")


def said_yes(question: str) -> bool:
    """Whether a person at a terminal types yes.

    Raises:
        RigError: there is no terminal.
    """
    from rig import RigError

    if not sys.stdin.isatty():
        raise RigError(
            "a person's yes is waited for, and standard input is no terminal: in a script, whose "
            "author answers for what is asked, give --yes"
        )
    return typed(question).strip().lower() == "yes"


def confirm(what: str, *, yes: bool) -> None:
    """Ask whether to start, and end the command unless the answer is yes."""
    from rig import RigError

    if not yes and not said_yes(f"{what}. Type yes to pressurise the muscle: "):
        raise RigError("not started: the answer was not yes")
