"""Several programs one after the other in one process, each with its CPU time.

    python benchmarks/first_answer_steps.py STEPS.json

The file lists command lines without their interpreter: `["-m", "famjax", "fit"]`, `["-c", "..."]`
or `["script.py", ...]`. In their place it holds afterwards one object for each: `seconds` of user
and system time, children included, and `programs`, how many JAX has compiled or loaded; those of
the step that imports JAX are not counted.
"""

import json
import os
import runpy
import sys
import tempfile
from pathlib import Path
from typing import Any

COMPILED = "/jax/core/compile/backend_compile_duration"
"""What JAX calls the event of a program made ready, by compilation or from a cache on disk."""


def do(step: list[str]) -> None:
    """Run one as if the interpreter had been given it.

    Raises:
        SystemExit: the program failed.
    """
    kind, *rest = step
    try:
        if kind == "-c":
            sys.argv = ["-c", *rest[1:]]
            exec(compile(rest[0], "<step>", "exec"), {"__name__": "__main__"})
        elif kind == "-m":
            sys.argv = [rest[0], *rest[1:]]
            runpy.run_module(rest[0], run_name="__main__", alter_sys=True)
        else:
            sys.argv = step
            runpy.run_path(kind, run_name="__main__")
    except SystemExit as end:
        if end.code:
            raise


def main() -> None:
    """Run the steps of the file and write their figures into it."""
    plan, programs = Path(sys.argv[1]), []

    def count(event: str, *_: object, **__: object) -> None:
        if event == COMPILED:
            programs.append(event)

    found: list[dict[str, Any]] = []
    heard = False
    for step in json.loads(plan.read_text(encoding="utf-8")):
        os.chdir(tempfile.mkdtemp(dir=plan.parent))  # outputs of one are no results of the next
        before, known = os.times(), len(programs)
        do(step)
        after = os.times()
        found.append(
            {"seconds": sum(after[:4]) - sum(before[:4]), "programs": len(programs) - known}
        )
        if not heard and "jax" in sys.modules:
            sys.modules["jax"].monitoring.register_event_duration_secs_listener(count)
            heard = True
    plan.write_text(json.dumps(found), encoding="utf-8")


if __name__ == "__main__":
    main()
