"""The command `famjax`: every command by name and sentence, imported on demand."""

import gc
import importlib.util
import inspect
import io
import os
import re
import signal
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cyclopts import App

# jaxlib on few cores can hang when two threads run batched LAPACK at once; this must be set first.
os.environ.setdefault("PJRT_NPROC", "16")

_RIG_HELP = "Control a muscle's pressure, record a test, or simulate both; see rig/firmware."
_HELP = "Fluidic artificial muscles: from measured force maps to identified, stable models."

_FITTING, _HERE = "fitting.cli", "famjax.app"
COMMANDS = (
    f"{_FITTING}.fit:assess", f"{_FITTING}.muscle:card", f"{_HERE}.commands:characterise",
    f"{_HERE}.commands:new", f"{_FITTING}.several:compare", "famjax.design.cli:design",
    f"{_HERE}.doctor:doctor", f"{_FITTING}.muscle:export", f"{_FITTING}.fit:fit",
    f"{_HERE}.commands:measure", f"{_FITTING}.muscle:predict", f"{_FITTING}.several:ramps",
    f"{_HERE}.doctor:reproduce", f"{_FITTING}.several:series", f"{_HERE}.shape:shape",
    f"{_HERE}.dynamics:simulate", f"{_FITTING}.several:sweep",
)  # fmt: skip
"""Where each command is, `module:function`."""
RIG_COMMANDS = (
    *(f"{_HERE}.commands:rig_{name}" for name in ("characterise", "convert", "simulate")),
    *(f"{_HERE}.tuning:rig_{name}" for name in ("step", "tune")),
)
"""Commands of the rig that need the muscle or the records; all others are in `rig.cli`."""
_MOUNTED = {f"{_HERE}.commands:measure": "imaging.cli:measure"}
"""Where the help of a command is, where it is elsewhere."""

STANDARD_INPUT = "<stdin>"
"""What stands for `-` among the arguments."""
STOPPED, NO_READER = 130, 141
"""Exit codes after Ctrl-C, and where nobody reads the output any more, as of SIGPIPE."""

_UNDO = ("measure", "rig")
"""Commands that end by themselves: pictures under way are finished, a rig is vented."""
_NOTHING = "nothing was written"
_KEPT = "what was finished is kept in {}, and the same command goes on from there"
_LEFT = {
    "compare": _KEPT.format("the output folder"),
    "characterise": _KEPT.format("results"),
}
_SHOW_CURSOR = "\x1b[?25h"


def main(arguments: list[str] | None = None) -> None:
    """Run the command line.

    Exit code 0 done, 1 no certified result, 2 bad input, 3 some pictures not measured, 130 stopped,
    141 nobody reads the output any more.
    """
    if arguments is not None:
        sys.exit(_run(arguments))
    end_at_interrupts(sys.argv[1:])
    warnings.showwarning = _as_note
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a name that it cannot show is no reason to end
            stream.reconfigure(errors="backslashreplace")
    # What imports and traces make stays to the end: it is searched for garbage less often.
    gc.set_threshold(400_000, 20, 50)
    try:
        code = _run(sys.argv[1:])
        sys.stdout.flush()
    except BrokenPipeError:  # as after `| head`; what is left goes nowhere
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = NO_READER
    # The process ends: without this, searching all that JAX has loaded for garbage takes 0.3 s.
    gc.freeze()
    sys.exit(code)


def _run(arguments: list[str]) -> int:
    try:
        import rich  # noqa: F401
        from cyclopts import CycloptsError
    except ImportError as missing:
        sys.exit(
            f"the famjax command needs its extra 'app' ({missing}); install it with\n"
            '    python -m pip install "famjax[app]"'
        )
    from famjax._require import clashes
    from famjax.boundary.errors import InputError

    if arguments and arguments[0] != "doctor" and (found := clashes()):
        print(*(f"famjax: {one}" for one in found), sep="\n", file=sys.stderr)
        return 2
    # A bare hyphen would be read as an option that nobody knows.
    words = [STANDARD_INPUT if word == "-" else word for word in arguments]
    try:
        code = command_line(words)(
            words, exit_on_error=False, print_error=False, result_action="return_value"
        )
    except CycloptsError as error:
        ask = " ".join(("famjax", *(error.command_chain or ()), "--help"))
        print(f"famjax: {error}\nTry '{ask}'.", file=sys.stderr)
        return 2
    except InputError as error:
        print(f"famjax: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(farewell(arguments), file=sys.stderr)
        return STOPPED
    return code or 0


def command_line(arguments: Sequence[str]) -> "App":
    """Make the command line for these arguments.

    The help of the command that they ask for is its docstring; all others are known by a sentence
    and are not imported.
    """
    from cyclopts import App, Parameter

    from famjax import __version__

    # A switch has no `--no-`, and a list no `--empty-`, unless it says so.
    options = Parameter(negative=(), show_default=_as_typed)
    command, of_rig = [*arguments, "", ""][:2]
    app = App(name="famjax", version=f"famjax {__version__}", help=_HELP, help_format="markdown",
              default_parameter=options, suppress_keyboard_interrupt=False)  # fmt: skip
    _register(app, COMMANDS, command)
    if command in {"rig", "--install-completion"}:
        from rig import cli

        rig = App(name="rig", help=cli.__doc__, help_format="markdown", default_parameter=options)
        for function in cli.COMMANDS:
            rig.command(function)
        _register(rig, RIG_COMMANDS, of_rig)
    else:
        rig = App(name="rig", help=_RIG_HELP)
    app.command(rig)
    app.register_install_completion_command(
        help="Complete commands and options in your shell: bash, zsh, fish. It adds a line to its "
        "start-up file."
    )
    return app


def _as_typed(default: object) -> str | None:
    """A default as one would type it; None for what is not given, off or empty."""
    if default is None or default is False or default == ():
        return None
    return ", ".join(map(str, default)) if isinstance(default, tuple) else str(default)


def _register(app: "App", commands: Sequence[str], asked: str) -> None:
    names = [path.partition(":")[2].removeprefix("rig_").replace("_", "-") for path in commands]
    for name, path in zip(names, commands, strict=True):
        # A sentence replaces the whole help; where one of them is asked for, none is shown of the others.
        shown = None if name == asked else "" if asked in names else sentence(path)
        app.command(path, name=name, help=shown)


def sentence(path: str) -> str:
    """The first sentence of a command's help, read from its file without an import."""
    module, _, name = _MOUNTED.get(path, path).partition(":")
    spec = importlib.util.find_spec(module)
    assert spec is not None
    assert spec.origin is not None
    text = Path(spec.origin).read_text(encoding="utf-8")
    found = re.search(rf'^def {name}\(.*?^    """(.*?)(?:\n\n|""")', text, re.DOTALL | re.MULTILINE)
    assert found is not None
    return inspect.cleandoc(found[1])


def _as_note(message: Warning | str, category: type[Warning], *_: Any) -> None:
    """A warning as a person reads it; those for developers are none of a user's."""
    if issubclass(category, UserWarning):
        print(f"note: {message}", file=sys.stderr)


def farewell(arguments: Sequence[str]) -> str:
    """The message for an interrupted command."""
    return f"famjax: stopped; {_LEFT.get(''.join(arguments[:1]), _NOTHING)}"


def end_at_interrupts(arguments: Sequence[str]) -> None:
    """Let an interrupt end the process of a command at any time.

    Raised as an exception it would be lost in the callbacks of JAX, and would abort the process in the
    import of a compiled module.
    """
    if "".join(arguments[:1]) in _UNDO or signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        return
    text = farewell(arguments)

    def end(_number: int, frame: FrameType | None) -> None:
        while frame is not None:
            if frame.f_code.co_name == "write_all":  # files appear whole, and its draft goes
                raise KeyboardInterrupt
            frame = frame.f_back
        shown = f"\n{_SHOW_CURSOR}" if sys.stderr.isatty() else ""
        os.write(2, f"{shown}{text}\n".encode())
        os._exit(STOPPED)

    signal.signal(signal.SIGINT, end)
