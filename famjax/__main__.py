"""The command `famjax`; its commands are in `commands`."""

import gc
import io
import os
import re
import sys
import warnings
from itertools import pairwise
from typing import Any

from .commands.stopping import NO_READER, STOPPED, end_at_interrupts, farewell, reader_has_left

# jaxlib on few cores can hang when two threads run batched LAPACK at once; this must be set first.
os.environ.setdefault("PJRT_NPROC", "16")


def main(arguments: list[str] | None = None) -> None:
    """Run the command line.

    Exit code 0 done, 1 no certified result, 2 bad input, 3 some pictures not measured, 130 stopped,
    141 nobody reads the output any more.
    """
    if arguments is None:
        end_at_interrupts(sys.argv[1:])
        warnings.showwarning = _as_note
        _print_what_the_terminal_lacks()
        # What imports and traces make stays to the end: it is searched for garbage less often.
        gc.set_threshold(400_000, 20, 50)
    try:
        code = _run(sys.argv[1:] if arguments is None else arguments)
        if arguments is None:
            sys.stdout.flush()
    except BrokenPipeError:
        if arguments is not None or not reader_has_left():
            raise
        code = NO_READER
    if arguments is None:
        # The process ends: without this, searching all that JAX has loaded for garbage takes 0.3 s.
        gc.freeze()
    sys.exit(code)


def _print_what_the_terminal_lacks() -> None:
    """Print characters that a stream's encoding lacks as their numbers: a name is no reason to end."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _as_note(message: Warning | str, category: type[Warning], *_: Any) -> None:
    """A warning as a person reads it; those for developers are none of a user's."""
    if issubclass(category, UserWarning):
        print(f"note: {message}", file=sys.stderr)


def _run(arguments: list[str]) -> int:
    try:
        from cyclopts import CycloptsError

        from .commands.app import command_line
    except ImportError as missing:
        sys.exit(
            f"the famjax command needs its extra 'app' ({missing}); install it with\n"
            '    python -m pip install "famjax[app]"'
        )
    from ._require import clashes
    from .boundary.errors import InputError
    from .commands.loading import STANDARD_INPUT

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
        hint = _of_a_minus_sign(arguments, str(error))
        ask = " ".join(("famjax", *(error.command_chain or ()), "--help"))
        print(f"famjax: {error}{hint}\nTry '{ask}'.", file=sys.stderr)
        return 2
    except InputError as error:
        print(f"famjax: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(farewell(arguments), file=sys.stderr)
        return STOPPED
    return code or 0


def _of_a_minus_sign(arguments: list[str], error: str) -> str:
    """How a value that begins with a minus sign is given, where one was read as an option."""
    for option, value in pairwise(arguments):
        if f"{option} requires an argument" in error and re.match(r"-[.\d]", value):
            return f"\nA value with a minus sign is written {option}={value}"
    return ""


if __name__ == "__main__":
    main()
