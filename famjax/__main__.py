"""Run the command `famjax` as `python -m famjax`."""

from .app.cli import main

if __name__ == "__main__":
    main()
