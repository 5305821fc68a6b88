"""How griffe reads the packages for the API pages: public names from the stubs, doctests as code."""

import ast
import re
from pathlib import Path
from typing import Any

import griffe

_DOCTEST = re.compile(r"^>>> .*(?:\n(?!\n).*)*", re.MULTILINE)


def names(stub: Path) -> list[str]:
    """Classes and functions that a stub exports; rooms below it have pages of their own."""
    return [
        alias.asname
        for node in ast.parse(stub.read_text(encoding="utf-8")).body
        if isinstance(node, ast.ImportFrom) and node.module
        for alias in node.names
        if alias.asname
    ]


class StubNames(griffe.Extension):
    """Public names are those of `__init__.pyi`; an example is a block of code."""

    def on_package(self, *, pkg: griffe.Module, **_: Any) -> None:
        """Set the exports of every room of a package that has been loaded."""
        for module in [pkg, *_rooms(pkg)]:
            folder = module.filepath if isinstance(module.filepath, list) else [module.filepath]
            stub = folder[0].with_name("__init__.pyi")
            if module.is_init_module and stub.exists():
                module.exports = [name for name in names(stub) if name in module.members]

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Fence the examples of a docstring, which Markdown would take for quotations."""
        if obj.docstring is not None:
            text = obj.docstring.value
            obj.docstring.value = _DOCTEST.sub(lambda one: f"```pycon\n{one[0]}\n```", text)


def _rooms(module: griffe.Module) -> list[griffe.Module]:
    below = [one for one in module.modules.values() if not one.is_alias]
    return [*below, *(room for one in below for room in _rooms(one))]
