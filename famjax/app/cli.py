"""Define the `famjax` command line, which lists every command but imports only the one that is run."""

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
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cyclopts import App

# On few cores, batched LAPACK calls from two threads can hang jaxlib. Set this before JAX starts.
os.environ.setdefault("PJRT_NPROC", "16")

_RIG_HELP = (
    "Control a muscle's pressure and record tests on a real or simulated rig; see rig/firmware."
)
_HELP = "Identify stable models of fluidic artificial muscles from force measurements."

_FITTING, _HERE = "fitting.cli", "famjax.app"
COMMANDS = (
    f"{_FITTING}.fit:assess", f"{_FITTING}.muscle:card", f"{_HERE}.commands:characterise",
    f"{_HERE}.commands:new", f"{_FITTING}.several:compare", "famjax.design.cli:design",
    f"{_HERE}.doctor:doctor", f"{_FITTING}.muscle:export", f"{_FITTING}.fit:fit",
    f"{_HERE}.commands:measure", f"{_FITTING}.muscle:predict", f"{_FITTING}.several:ramps",
    f"{_HERE}.doctor:reproduce", f"{_FITTING}.several:series", f"{_HERE}.shape:shape",
    f"{_HERE}.dynamics:simulate", f"{_FITTING}.several:sweep",
)  # fmt: skip
"""Where each command is defined, as `module:function`."""
RIG_COMMANDS = (
    *(f"{_HERE}.commands:rig_{name}" for name in ("convert", "simulate")),
    *(f"{_HERE}.tuning:rig_{name}" for name in ("step", "tune")),
)
"""Commands under `famjax rig` that import other packages; `rig.cli` defines the rest."""

STANDARD_INPUT = "<stdin>"
"""Placeholder that replaces the argument `-`, which means standard input."""
STOPPED, NO_READER = 130, 141
"""Exit codes after Ctrl-C, and after the reader closes the output pipe (as for SIGPIPE)."""


def main(arguments: list[str] | None = None) -> None:
    """Run the command line.

    Exit codes: 0 success, 1 no certified result, 2 bad input, 3 some pictures not measured,
    130 interrupted, 141 output pipe closed.
    """
    if arguments is not None:
        sys.exit(_run(arguments))
    end_at_interrupts(sys.argv[1:])
    warnings.showwarning = _as_note
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # escape what the terminal cannot encode
            stream.reconfigure(errors="backslashreplace")
    # Imports and traces create many objects that live to the end: collect garbage less often.
    gc.set_threshold(400_000, 20, 50)
    try:
        code = _run(sys.argv[1:])
        sys.stdout.flush()
    except BrokenPipeError:  # as after `| head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = NO_READER
    # Skip the last garbage collection, which takes 0.3 s once JAX is loaded.
    gc.freeze()
    sys.exit(code)


def clashes() -> list[str]:
    """Return one sentence for each sibling package shadowed by other code, without importing any.

    Other distributions use two of these package names, and a user's folder may contain a `fitting.py`.
    Every package that belongs to famjax defines the name `__famjax__`.
    """
    found = []
    for name in ("fitting", "imaging", "rig"):
        spec = importlib.util.find_spec(name)
        if spec is None:
            continue
        # A folder without __init__.py has no origin.
        where = spec.origin or str(list(spec.submodule_search_locations or ()))
        text = (
            Path(where).read_text(encoding="utf-8", errors="replace")
            if Path(where).is_file()
            else ""
        )
        if "__famjax__" not in text:
            found.append(
                f"Python finds {name!r} at {where}, which is not famjax's own {name!r} package: rename "
                "that file or folder, or uninstall the other distribution and reinstall famjax."
            )
    return found


def _run(arguments: list[str]) -> int:
    try:
        import rich  # noqa: F401
        from cyclopts import CycloptsError, UnusedCliTokensError
    except ImportError as missing:
        sys.exit(
            f"the famjax command requires the extra 'app' ({missing}); install it with\n"
            '    python -m pip install "famjax[app]"'
        )
    from famjax.boundary.errors import InputError

    if arguments and arguments[0] != "doctor" and (found := clashes()):
        print(*(f"famjax: {one}" for one in found), sep="\n", file=sys.stderr)
        return 2
    # cyclopts would read a bare hyphen as an unknown option.
    words = [STANDARD_INPUT if word == "-" else word for word in arguments]
    try:
        code = command_line(words)(
            words, exit_on_error=False, print_error=False, result_action="return_value"
        )
    except CycloptsError as error:
        ask = " ".join(("famjax", *(error.command_chain or ()), "--help"))
        what = str(error)
        if isinstance(error, UnusedCliTokensError):
            unused = " ".join(error.unused_tokens or ())
            what = f"unexpected argument {unused}: to pass several values, repeat the option"
        print(f"famjax: {what}\nTry '{ask}'.", file=sys.stderr)
        return 2
    except InputError as error:
        print(f"famjax: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("famjax: stopped", file=sys.stderr)
        return STOPPED
    return code or 0


def command_line(arguments: Sequence[str]) -> "App":
    """Build the command line for the given arguments.

    Only the requested command is imported, because its help text is its docstring. The other commands
    are listed with the first paragraph of their docstrings.
    """
    from cyclopts import App, Parameter

    from famjax import __version__

    # No `--no-` option for a switch and no `--empty-` option for a list.
    options = Parameter(negative=(), show_default=_as_typed)
    command, of_rig = [*arguments, "", ""][:2]
    app = App(name="famjax", version=f"famjax {__version__}", help=_HELP, help_format="markdown",
              default_parameter=options, suppress_keyboard_interrupt=False)  # fmt: skip
    _register(app, COMMANDS, command)
    if command == "rig":
        from rig import cli

        rig = App(name="rig", help=cli.__doc__, help_format="markdown", default_parameter=options)
        for function in cli.COMMANDS:
            rig.command(function)
        _register(rig, RIG_COMMANDS, of_rig)
    else:
        rig = App(name="rig", help=_RIG_HELP)
    app.command(rig)
    return app


def _as_typed(default: object) -> str | None:
    """Format a default as it is typed on the command line; return None if it need not be shown."""
    if default is None or default is False or default == ():
        return None
    return ", ".join(map(str, default)) if isinstance(default, tuple) else str(default)


def _register(app: "App", commands: Sequence[str], asked: str) -> None:
    names = [path.partition(":")[2].removeprefix("rig_").replace("_", "-") for path in commands]
    for name, path in zip(names, commands, strict=True):
        # A sentence replaces the full help. If the help of one command is asked for, skip the others.
        shown = None if name == asked else "" if asked in names else sentence(path)
        app.command(path, name=name, help=shown)


def sentence(path: str) -> str:
    """Return the first paragraph of a command's docstring without importing its module."""
    module, _, name = path.partition(":")
    if name == "measure":  # the app only adds a reader for logs
        module = "imaging.cli"
    file = Path(__file__).resolve().parents[2] / f"{module.replace('.', '/')}.py"
    text = file.read_text(encoding="utf-8")
    found = re.findall(
        rf'^def {name}\(.*?^    """(.*?)(?:\n\n|""")', text, re.DOTALL | re.MULTILINE
    )
    return inspect.cleandoc(found[0])


def _as_note(message: Warning | str, category: type[Warning], *_: Any) -> None:
    """Print a warning as a note; hide warnings meant for developers."""
    if issubclass(category, UserWarning):
        print(f"note: {message}", file=sys.stderr)


def end_at_interrupts(arguments: Sequence[str]) -> None:
    """Make the process exit immediately when a command is interrupted.

    If the interrupt were raised as an exception, a JAX callback would lose it, and it would crash the
    process during the import of a compiled module.
    """
    # `measure` and `rig` handle interrupts themselves: they finish a picture or vent the rig.
    ignored = signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    if ignored or "".join(arguments[:1]) in {"measure", "rig"}:
        return
    resumes = "".join(arguments[:1]) in {"compare", "characterise"}
    left = "run the same command again to resume" if resumes else "nothing was written"

    def end(*_: object) -> None:
        shown = "\n\x1b[?25h" if sys.stderr.isatty() else ""  # show the cursor again
        os.write(2, f"{shown}famjax: stopped; {left}\n".encode())
        os._exit(STOPPED)

    signal.signal(signal.SIGINT, end)
