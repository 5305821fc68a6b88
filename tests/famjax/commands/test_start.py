"""What happens before any numeric work: imports when a name is used, help without the library."""

import ast
import importlib
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import famjax
from famjax.commands import app, rig

HEAVY = ("jax", "numpy", "scipy", "matplotlib", "pint", "cv2", "skimage", "serial", "jinja2")


def loaded(code: str) -> set[str]:
    """Top-level packages in a fresh process that has run the code."""
    code += "\nimport sys; print('loaded:', *sorted({m.partition('.')[0] for m in sys.modules}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return set(done.stdout.rpartition("loaded:")[2].split())


def public_names(package: str) -> dict[str, str]:
    """Name and module of every import under `if TYPE_CHECKING` in a package's own file."""
    tree = ast.parse(Path(inspect.getfile(importlib.import_module(package))).read_text())
    blocks = [node for node in tree.body if isinstance(node, ast.If)]
    guarded = next(node for node in blocks if ast.unparse(node.test) == "TYPE_CHECKING")
    return {
        alias.asname or alias.name: node.module or alias.name
        for node in guarded.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }


def test_importing_the_library_loads_nothing_until_a_name_is_used() -> None:
    assert not loaded("import famjax, fitting; famjax.require; fitting.InputError") & set(HEAVY)
    assert {"jax"} <= loaded("from famjax import Muscle")
    assert not loaded("import imaging, rig") & (set(HEAVY) - {"numpy", "scipy"})


@pytest.mark.parametrize("package", ["fitting"])
def test_names_of_a_lazy_package_are_all_there(package: str) -> None:
    module, names = importlib.import_module(package), public_names(package)
    assert len(names) > 50
    assert sorted(module.__all__) == sorted(names)  # what type checkers and `import *` see
    assert set(names) <= set(dir(module))
    for name, home in names.items():
        of_home = importlib.import_module(f"{package}.{home}")
        expected = of_home if name == home else getattr(of_home, name)
        assert getattr(module, name) is expected
    with pytest.raises(AttributeError, match=f"module '{package}' has no attribute 'spam'"):
        module.spam  # noqa: B018 -- looking it up is the test
    with pytest.raises(ImportError, match="cannot import name 'spam'"):
        exec(f"from {package} import spam")


def test_a_namespace_is_imported_as_a_module_or_as_a_name() -> None:
    assert not loaded("import famjax.units") & set(HEAVY)
    assert "jax" in loaded("import famjax.peers; famjax.peers.TonduLopez; famjax.Muscle")
    assert famjax.units is sys.modules["famjax.units"]


def commands() -> list[tuple[tuple[str, ...], str, str]]:
    """What a person types, the function behind it, and the sentence that the help shows for it."""
    every = [
        ((), "famjax.commands.", app.COMMANDS),
        (("rig",), "famjax.commands.rig.", rig.COMMANDS),
    ]
    return [
        ((*group, path.partition(":")[2].removeprefix("rig_")), package + path, sentence)
        for group, package, table in every
        for path, sentence in table.items()
    ]


@pytest.mark.parametrize(("words", "path", "sentence"), commands())
def test_a_command_is_listed_with_its_own_first_sentence(
    words: tuple[str, ...], path: str, sentence: str, capsys: pytest.CaptureFixture
) -> None:
    module, _, name = path.partition(":")
    docstring = inspect.getdoc(getattr(importlib.import_module(module), name)) or ""
    assert docstring.split("\n\n")[0] == sentence
    app.command_line([*words, "--help"])([*words, "--help"], result_action="return_value")
    shown = " ".join(capsys.readouterr().out.split())
    for paragraph in docstring.partition("\n\nParameters\n")[0].split("\n\n"):
        assert " ".join(paragraph.replace("`", "").split()) in shown


def test_help_loads_no_library() -> None:
    for words in ([], ["fit"], ["measure"], ["rig"], ["rig", "simulate"], ["doctor"]):
        code = f"from famjax.__main__ import main\ntry: main({[*words, '--help']})\nexcept SystemExit: pass"
        assert not loaded(code) & set(HEAVY), words
