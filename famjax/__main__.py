"""Entry point for `python -m famjax`, which runs the command `famjax`."""

from .app.cli import main

if __name__ == "__main__":
    main()
