"""What happens before any numeric work: imports when a name is used, help without the library."""

import importlib
import inspect
import sys

import pytest
from processes import python

import famjax
from famjax.app import cli
from rig import cli as rig_cli

HEAVY = ("jax", "numpy", "scipy", "matplotlib", "pint", "cv2", "skimage", "serial", "jinja2")


def loaded(code: str) -> set[str]:
    """Top-level packages in a fresh process that has run the code."""
    code += "\nimport sys; print('loaded:', *sorted({m.partition('.')[0] for m in sys.modules}))"
    done = python("-c", code)
    assert done.returncode == 0, done.stderr
    return set(done.stdout.rpartition("loaded:")[2].split())


def test_importing_the_library_loads_nothing_until_a_name_is_used() -> None:
    assert not loaded("import famjax, fitting; famjax.units; fitting.InputError") & set(HEAVY)
    used = loaded(
        "from famjax import Muscle; from fitting import read_csv; from jax._src import xla_bridge\n"
        "assert not xla_bridge.backends_are_initialized()\n"
        "assert not __import__('jax').config.read('jax_enable_x64')"
    )
    assert "jax" in used
    assert not used & {"cv2", "skimage", "serial", "matplotlib", "pint"}
    assert not loaded("import imaging, rig") & (set(HEAVY) - {"numpy", "scipy"})


def test_a_namespace_is_imported_as_a_module_or_as_a_name() -> None:
    assert not loaded("import famjax.units") & set(HEAVY)
    assert "jax" in loaded("import famjax.peers; famjax.peers.TonduLopez; famjax.Muscle")
    assert famjax.units is sys.modules["famjax.units"]


def commands() -> list[tuple[tuple[str, ...], str, str]]:
    """What a person types, the function behind it, and the sentence that the help shows for it."""
    every = [((), path, cli.sentence(path)) for path in cli.COMMANDS]
    every += [(("rig",), path, cli.sentence(path)) for path in cli.RIG_COMMANDS]
    for function in rig_cli.COMMANDS:
        sentence = (inspect.getdoc(function) or "").split("\n\n")[0]
        every.append((("rig",), f"rig.cli:{function.__name__}", sentence))
    return [
        ((*group, path.partition(":")[2].removeprefix("rig_").replace("_", "-")), path, sentence)
        for group, path, sentence in every
    ]


@pytest.mark.parametrize(("words", "path", "sentence"), commands())
def test_a_command_is_listed_with_its_own_first_sentence_and_a_text_for_every_option(
    words: tuple[str, ...], path: str, sentence: str, capsys: pytest.CaptureFixture
) -> None:
    module, _, name = path.partition(":")
    docstring = inspect.getdoc(getattr(importlib.import_module(module), name)) or ""
    assert docstring.split("\n\n")[0] == sentence
    cli.command_line([*words, "--help"])([*words, "--help"], result_action="return_value")
    shown = " ".join(capsys.readouterr().out.split())
    for paragraph in docstring.partition("\n\nParameters\n")[0].split("\n\n"):
        assert " ".join(paragraph.replace("`", "").split()) in shown
    assert "--empty-" not in shown  # of a list: no option that means nothing
    asked = cli.command_line([*words])
    for word in words:
        asked = asked[word]
    for option in asked.assemble_argument_collection(parse_docstring=True):
        if option.parse and not option.has_tokens and option.show:
            assert option.parameter.help, option.names


def test_help_loads_no_library() -> None:
    """That of one command after the other, in one process."""
    code = """
from famjax.__main__ import main
for words in ("", "fit", "assess", "predict", "measure", "rig", "rig simulate", "doctor"):
    try:
        main([*words.split(), "--help"])
    except SystemExit:
        pass
"""
    assert not loaded(code) & set(HEAVY)
