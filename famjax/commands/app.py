"""The command line: every command by its name and a sentence, imported when it is asked for."""

from collections.abc import Mapping, Sequence

from cyclopts import App, Parameter

from .. import __version__

_RIG_HELP = "Control a muscle's pressure, record a test, or simulate both; see rig/firmware."
_HELP = "Fluidic artificial muscles: from measured force maps to identified, stable models."

COMMANDS = {
    "fits.card:card": (
        "Write the muscle card of a fit: what a simulator, a controller or a colleague needs of it."
    ),
    "characterise:characterise": (
        "Evaluate a characterisation folder: force, pictures, shape, fits of four geometries, report."
    ),
    "characterise:new": (
        "Write the sheet of a new characterisation folder, with a comment on every entry."
    ),
    "fits.compare:compare": (
        "Fit every published static force model, and famjax's own, to one force map."
    ),
    "design:design": (
        "Search a catalogue of braids, bladders and tubes for a muscle that meets a requirement."
    ),
    "doctor:doctor": (
        "Report versions, devices, precision and name clashes; exit code 1 if something is wrong."
    ),
    "fits.export:export": ("Write a muscle as C, tables, MATLAB functions, or for a simulator."),
    "fits.identify:fit": "Identify a muscle from a measured force map.",
    "measure:measure": (
        "Measure the shape of a muscle in photographs, each picture with its errors."
    ),
    "fits.predict:predict": (
        "Predict the force of a fitted muscle, and the pressure at which it begins to pull."
    ),
    "ramps:ramps": (
        "Turn raw isometric pressure ramps into a static force map with its noise and hysteresis."
    ),
    "reproduce:reproduce": (
        "Compute the reference work's tables and put them beside its printed figures."
    ),
    "fits.series:series": (
        "Identify several muscles of a series together, to predict those of other lengths."
    ),
    "fits.sweep:sweep": (
        "Fit every permutation of order, pressure dependence and constraint at one geometry."
    ),
}
"""Where each command is, `module:function`, and the first sentence of its help."""

RIG_COMMANDS = {
    "rig:rig_characterise": (
        "Turn a test's journal and the test machine's log into curves, figures and a dataset to fit."
    ),
    "rig:rig_convert": (
        "Write a journal's records as a table with units; the journal stays the record."
    ),
    "rig:rig_simulate": (
        "Carry out the same test against a simulated rig, far faster than real time."
    ),
}
"""Commands of the rig that need the muscle or the records; all others are in `rig_cli`."""


def _as_typed(default: object) -> str | None:
    """A default as one would type it; None for what is not given, off or empty."""
    if default is None or default is False or default == ():
        return None
    return ", ".join(map(str, default)) if isinstance(default, tuple) else str(default)


_OPTIONS = Parameter(negative=(), show_default=_as_typed)
"""Of every option: a switch has no `--no-`, and a list no `--empty-`, unless it says so."""


def command_line(arguments: Sequence[str]) -> App:
    """The command line, for these arguments.

    The help of the command that they ask for is its docstring; all others are known by a sentence
    and are not imported.
    """
    command, of_rig = [*arguments, "", ""][:2]
    app = App(name="famjax", version=f"famjax {__version__}", help=_HELP, help_format="markdown",
              default_parameter=_OPTIONS, suppress_keyboard_interrupt=False)  # fmt: skip
    _register(app, __name__.rpartition(".")[0], COMMANDS, command)
    app.command(_rig(of_rig) if command in {"rig", "--install-completion"} else _rig_unasked())
    app.register_install_completion_command(
        help="Complete commands and options in your shell: bash, zsh, fish. It adds a line to its "
        "start-up file."
    )
    return app


def _rig(asked: str) -> App:
    from . import rig_cli

    app = App(name="rig", help=rig_cli.__doc__, help_format="markdown", default_parameter=_OPTIONS)
    for function in rig_cli.COMMANDS:
        app.command(function)
    _register(app, __name__.rpartition(".")[0], RIG_COMMANDS, asked)
    return app


def _rig_unasked() -> App:
    """The rig's commands where none of them is asked for: a sentence of the help."""
    return App(name="rig", help=_RIG_HELP)


def _register(app: App, package: str, commands: Mapping[str, str], asked: str) -> None:
    for path, sentence in commands.items():
        name = path.partition(":")[2].removeprefix("rig_").replace("_", "-")
        # A sentence given here would replace the whole help.
        app.command(f"{package}.{path}", name=name, help=None if name == asked else sentence)
