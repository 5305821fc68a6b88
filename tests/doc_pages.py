"""Pages of the documentation as a test reads them: fences, what they print, links."""

import contextlib
import dataclasses
import io
import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path

from processes import ran

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
_FENCE = re.compile(r"^``` *([^\n]*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w])")
_LINK = re.compile(r"\]\(([^)\s]+)\)")


@dataclasses.dataclass(frozen=True)
class Fence:
    language: str
    text: str
    line: int


def fences(page: Path) -> list[Fence]:
    text = page.read_text(encoding="utf-8")
    return [
        Fence(one[1], one[2], text.count("\n", 0, one.start()) + 1) for one in _FENCE.finditer(text)
    ]


def run_page(page: Path, folder: Path) -> int:
    """Run the fences of a page in order, in one namespace and one folder; how many were run.

    A `text` fence is what the one before it prints, or a part of it.
    """
    names: dict[str, object] = {"__name__": page.stem}
    printed, count = "", 0
    for fence in fences(page):
        where = f"{page.name}, line {fence.line}"
        if fence.language == "python":
            printed = _python("\n" * fence.line + fence.text, names, str(page))
        elif fence.language == "sh":
            printed = _shell(fence.text, folder, where)
        elif fence.language == "c":  # which the next fence compiles
            (folder / "pull.c").write_text(fence.text)
        elif fence.language == "matlab":
            (folder / "page.m").write_text(fence.text)
            printed = _shell("octave-cli --norc --quiet page.m", folder, where)
        elif fence.language == "text":
            missing = not_printed(fence.text, printed)
            assert not missing, f"{where}: not printed: {missing}\nprinted was:\n{printed}"
            continue
        else:
            continue
        count += 1
    return count


def not_printed(expected: str, printed: str) -> list[str]:
    """Lines that are not among those printed, in that order; numbers to a unit of their last digit."""
    left: Iterator[str] = iter(printed.splitlines())
    lines = (line for line in expected.splitlines() if line.strip(" ."))
    return [line for line in lines if not any(_same(line, other) for other in left)]


def links(page: Path) -> list[str]:
    """Targets of a page's links that are files of this repository."""
    text = _FENCE.sub("", page.read_text(encoding="utf-8"))
    return [one for one in _LINK.findall(text) if "://" not in one and not one.startswith("#")]


def _python(code: str, names: dict[str, object], where: str) -> str:
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        exec(compile(code, where, "exec"), names)
    return out.getvalue()


def _shell(script: str, folder: Path, where: str) -> str:
    lines = [line for line in script.splitlines() if not re.search("pip install|-m venv", line)]
    code = "\n".join([f'famjax() {{ "{sys.executable}" -m famjax "$@"; }}', *lines])
    env = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "120"}
    done = ran("bash", "-euo", "pipefail", "-c", code, cwd=folder, env=env)
    assert done.returncode == 0, f"{where}:\n{done.stdout}\n{done.stderr}"
    return done.stdout


def _same(expected: str, printed: str) -> bool:
    if _words(expected) != _words(printed):
        return False
    pairs = zip(_NUMBER.findall(expected), _NUMBER.findall(printed), strict=True)
    return all(abs(float(a) - float(b)) <= 1.001 * _unit(a) for a, b in pairs)


def _words(line: str) -> list[str]:
    return _NUMBER.sub("0", line).split()


def _unit(number: str) -> float:
    """One of the last digit that is written."""
    mantissa, _, exponent = number.partition("e")
    return 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))
