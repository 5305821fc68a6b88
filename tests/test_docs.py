"""The documentation is run: fences, links, figures, glossary, and the build by both tools."""

import ast
import importlib.util
import json
import re
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from doc_pages import DOCS, ROOT, fences, links, not_printed, run_page
from processes import python
from test_glossary import labels_of_page, unexplained

PAGES = sorted(page for page in DOCS.rglob("*.md") if "api" not in page.relative_to(DOCS).parts)
README = ROOT / "README.md"
RUN = [README, *(p for p in PAGES if any(one.language in {"python", "sh"} for one in fences(p)))]
LAB = DOCS / "how-to" / "lab.md"
NAMES = """first-result control check-before-you-publish export concepts/bands concepts/shape
how-to/design how-to/robotics how-to/jax-modeller how-to/matlab how-to/large-work how-to/tune-rig"""
LONG = [DOCS / f"{name}.md" for name in NAMES.split()]
"""Pages whose examples take more than five seconds each."""
WRITTEN = [DOCS / "comparison.md", DOCS / "reproduction.md"]
TUTORIALS = DOCS / "tutorials.md"


@pytest.mark.timeout(600)
@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, marks=[pytest.mark.slow] if page in LONG else [])
        for page in RUN
        if page not in (LAB, TUTORIALS, *WRITTEN)
    ],
    ids=lambda page: page.relative_to(ROOT).as_posix(),
)
def test_every_fence_of_a_page_runs(page, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    if page == README:
        (tmp_path / "examples").symlink_to(ROOT / "examples")
    if page.stem == "export":
        for program in ("gcc", "octave-cli"):
            if shutil.which(program) is None:
                pytest.skip(f"no {program} on this machine")
    assert run_page(page, tmp_path) > 0


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_every_fence_of_the_lab_runs_and_its_report_is_explained(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    muscle = Path("examples", "muscle")
    shutil.copytree(ROOT / muscle, muscle, ignore=shutil.ignore_patterns("results"))
    assert run_page(LAB, tmp_path) > 5
    labels = labels_of_page((muscle / "results" / "report" / "report.html").read_text())
    assert len(labels) > 30
    assert not unexplained(labels)


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_written_pages_are_what_the_commands_print(tmp_path: Path) -> None:
    tables = load("tables")
    for new, page in zip(tables.write(tmp_path), WRITTEN, strict=True):
        assert not not_printed(page.read_text(), new.read_text()), page.name
        run = [line for fence in fences(page) for line in fence.text.splitlines()]
        known = [*(tables.COMPARE.format(name) for name in tables.MAPS), tables.REPRODUCE]
        assert set(run) <= {f"{command} > /dev/null" for command in known}
        assert run


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_tutorials_are_what_their_scripts_print(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    new = load("notebooks").write(tmp_path)
    assert not not_printed(TUTORIALS.read_text(), new.read_text())
    pictures = list((tmp_path / "figures").glob("*.svg"))
    assert len(pictures) == 3
    assert all(one.stat().st_size > 5000 for one in pictures)


def test_the_readme_is_short_and_holds_the_two_commands() -> None:
    text = README.read_text()
    assert len(text.splitlines()) < 150
    made = "python3 -m venv .venv && .venv/bin/python -m pip install -e"
    for extra, command in (("", "famjax fit"), (",test", "python -m pytest")):
        assert f'{made} ".[all{extra}]" && .venv/bin/{command}\n' in text


@pytest.mark.parametrize("page", [*PAGES, README], ids=lambda page: page.name)
def test_links_lead_to_files(page: Path) -> None:
    for target in links(page):
        file = page.parent / target.partition("#")[0]
        assert file.exists(), f"{page}: {target}"


def test_the_packages_call_nothing_that_windows_lacks() -> None:
    lacking = {"fcntl", "grp", "pty", "pwd", "resource", "syslog", "termios", "tty"} | {
        "fork", "killpg", "sched_getaffinity", "SIGALRM", "SIGHUP", "SIGKILL",
    }  # fmt: skip
    for package in ("famjax", "fitting", "imaging", "rig"):
        for file in (ROOT / package).rglob("*.py"):
            for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Import):
                    assert not lacking & {one.name for one in node.names}, file
                if isinstance(node, ast.Attribute):
                    assert node.attr not in lacking, f"{file}, line {node.lineno}"
                if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
                    said = node.func.attr not in {"read_text", "write_text"}
                    said |= "encoding" in {one.arg for one in node.keywords}
                    assert said, f"{file}, line {node.lineno}: which encoding?"


def test_every_public_room_has_a_page() -> None:
    for package in ("famjax", "fitting", "imaging", "rig"):
        for stub in (ROOT / package).rglob("__init__.pyi"):
            room = ".".join(stub.parent.relative_to(ROOT).parts)
            file = "_".join(room.split(".")[1:]) or "index"
            page = DOCS / "api" / package / f"{file}.md"
            assert " as " in stub.read_text()
            assert page.read_text() == f"# {room}\n\n::: {room}\n"


@pytest.mark.slow
def test_figures_are_what_the_packages_compute(tmp_path: Path) -> None:
    figures = load("figures")
    found = figures.make(tmp_path)
    kept = json.loads((DOCS / "figures" / "curves.json").read_text())
    assert found.keys() == kept.keys() == figures.FIGURES.keys()
    for name, curves in kept.items():
        assert (DOCS / "figures" / f"{name}.svg").read_text().startswith("<?xml")
        assert (tmp_path / f"{name}.svg").stat().st_size > 5000
        for key, values in curves.items():
            kept_values, now = (np.array(one, float) for one in (values, found[name][key]))
            scale = np.nanmax(np.abs(kept_values))
            np.testing.assert_allclose(now, kept_values, atol=2e-3 * scale, err_msg=f"{name} {key}")


def test_every_figure_is_shown() -> None:
    shown = "".join(page.read_text() for page in PAGES)
    for picture in (DOCS / "figures").glob("*.svg"):
        assert f"figures/{picture.name})" in shown


@pytest.mark.slow
@pytest.mark.parametrize("tool", ["mkdocs", "zensical"])
def test_builds_without_a_warning_and_loads_nothing_from_elsewhere(tool, tmp_path) -> None:
    if shutil.which(tool) is None and not (Path(sys.executable).parent / tool).exists():
        pytest.skip(f"{tool} is not installed: pip install -e '.[docs]'")
    copy = tmp_path / "copy"
    copy.mkdir()
    for name in ("docs", "examples", "famjax", "fitting", "imaging", "rig"):
        shutil.copytree(ROOT / name, copy / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("mkdocs.yml", "CONTRIBUTING.md"):
        shutil.copy(ROOT / name, copy / name)
    done = python("-m", tool, "build", "--strict", cwd=copy)
    assert done.returncode == 0, done.stdout + done.stderr
    pages = list((copy / "site").rglob("*.html"))
    assert len(pages) > 60
    for page in pages:
        assert not loaded_from_elsewhere(page.read_text()), page


def loaded_from_elsewhere(html: str) -> list[str]:
    """What a page fetches from another host: scripts, styles, pictures; links are not fetched."""
    tags = re.findall(r"<(?:script|link|img|iframe|source)\b[^>]*>", html)
    fetched = [tag for tag in tags if re.search(r"(?:src|href)=\"?(?:https?:)?//", tag)]
    return [tag for tag in fetched if 'rel="canonical"' not in tag]


def load(name: str) -> object:
    spec = importlib.util.spec_from_file_location(name, DOCS / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
