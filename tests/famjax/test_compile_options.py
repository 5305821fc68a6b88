"""Options of the compiler: the same numbers, and an option that XLA does not know is left out."""

import os
import sys
from pathlib import Path

import jax
import pytest
from processes import python

from famjax import compilation_cache
from famjax.compilation_cache import cache_root

SWITCH_ON = "from famjax.compilation_cache import switch_on; print(repr(switch_on()))"


def in_fresh_process(code: str, **environment: str) -> str:
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("JAX_", "FAMJAX_"))}
    done = python("-W", "error", "-c", code, env=kept | environment)
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout.strip()


@pytest.mark.skipif(sys.platform in {"win32", "darwin"}, reason="the convention of Linux")
def test_the_folder_is_below_the_users_cache_unless_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.delenv("FAMJAX_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_root() == tmp_path / "famjax" / "programs"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache_root() == tmp_path / ".cache" / "famjax" / "programs"
    monkeypatch.setenv("XDG_CACHE_HOME", "not/absolute")
    assert cache_root() is None
    monkeypatch.setenv("FAMJAX_CACHE_DIR", "~/mine")
    assert cache_root() == tmp_path / "mine"


def test_the_folder_is_of_this_machine_and_private(tmp_path: Path) -> None:
    folder = Path(in_fresh_process(SWITCH_ON, FAMJAX_CACHE_DIR=str(tmp_path)).strip("'"))
    assert folder.parent == tmp_path
    assert folder.name.endswith(f"-jaxlib-{jax.lib.__version__}")
    if sys.platform != "win32":
        folder.chmod(0o755)
        in_fresh_process(SWITCH_ON, FAMJAX_CACHE_DIR=str(tmp_path))
        assert folder.stat().st_mode & 0o777 == 0o700


def test_a_folder_of_somebody_else_is_not_trusted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert compilation_cache._private_folder(tmp_path / "mine")
    monkeypatch.setattr(os, "getuid", lambda: -1, raising=False)
    assert not compilation_cache._private_folder(tmp_path / "mine")


def test_a_platform_without_a_device_is_refused_in_one_sentence() -> None:
    code = """
from famjax.compilation_cache import start_jax
from famjax.boundary.errors import InputError
try:
    start_jax()
except InputError as error:
    print(error)
"""
    assert "JAX_PLATFORMS is 'nothing'" in in_fresh_process(code, JAX_PLATFORMS="nothing")
