"""The page on exporting is run: its commands, its C, its MATLAB, its Python."""

import re
import sys
from pathlib import Path

import pytest
from processes import command, needs, ran

PAGE = (Path(__file__).parents[3] / "docs" / "export.md").read_text()


def fences(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the first command of the page has exported the muscle."""
    folder = tmp_path_factory.mktemp("page")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        command(*fences("sh")[0].split()[1:])
    return folder


def said(folder: Path, *words: str) -> str:
    done = ran(*words, cwd=folder)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
@needs("gcc")
def test_c(folder: Path) -> None:
    (folder / "pull.c").write_text(*fences("c"))
    pressure, force, _ = said(folder, "sh", "-c", fences("sh")[1]).split(", ")
    assert force == "500.0 N"
    assert 1e5 < float(pressure.split()[0]) < 6e5


@pytest.mark.slow
@needs("octave-cli")
def test_matlab(folder: Path) -> None:
    (folder / "page.m").write_text(*fences("matlab"))
    told = said(folder, "octave-cli", "--norc", "--quiet", "page.m")
    assert "force =" in told
    assert "pressure =" in told


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "needs"),
    [(0, "numpy"), (1, "pandas"), (2, "mujoco"), (3, "mujoco.mjx"), (4, "flatbuffers")],
)
def test_python(number: int, needs: str, folder: Path) -> None:
    assert len(fences("python")) == 5
    pytest.importorskip(needs)
    printed = said(folder, sys.executable, "-c", fences("python")[number])
    assert printed.strip()
    assert "nan" not in printed.lower()
