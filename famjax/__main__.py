"""The command `famjax`; its commands are in `_commands`."""

import os
import sys

# jaxlib on few cores can hang when two threads run batched LAPACK at once; this must be set first.
os.environ.setdefault("PJRT_NPROC", "16")

try:
    from cyclopts import CycloptsError

    from ._commands.app import command_line
except ImportError as missing:
    sys.exit(
        f"the famjax command needs its extra 'app' ({missing}); install it with\n"
        '    python -m pip install "famjax[app]"'
    )


def main(arguments: list[str] | None = None) -> None:
    """Run the command line.

    Exit code 0 done, 1 no certified result, 2 bad input, 3 some pictures not measured, 130 stopped.
    """
    from fitting import InputError  # noqa: PLC0415

    from ._catalogue import CatalogueError  # noqa: PLC0415

    words = sys.argv[1:] if arguments is None else arguments
    try:
        code = command_line(words)(
            words, exit_on_error=False, print_error=False, result_action="return_value"
        )
    except CycloptsError as error:
        print(f"famjax: {error}\nTry 'famjax --help'.", file=sys.stderr)
        sys.exit(2)
    except (InputError, CatalogueError) as error:
        print(f"famjax: {error}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        print(
            "famjax: stopped; nothing was written but the finished parts of a sweep, which goes on "
            "when it is run again",
            file=sys.stderr,
        )
        sys.exit(130)
    sys.exit(code or 0)


if __name__ == "__main__":
    main()
