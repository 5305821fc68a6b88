"""Options of the compiler: the same numbers, and an option that XLA does not know is left out."""

import functools
import os
import subprocess
import sys
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from famjax import compilation_cache, compile_options
from famjax.compilation_cache import cache_root, contents
from famjax.compile_options import quick_jit, quick_options


class Spring(eqx.Module):
    stiffness: jax.Array
    kind: str

    @quick_jit
    def force(self, length: jax.Array) -> jax.Array:
        return self.stiffness * jnp.sin(length) if self.kind == "soft" else self.stiffness * length


def test_quickly_compiled_results_are_the_same() -> None:
    length = jnp.linspace(0.0, 1.0, 7)
    soft, hard = Spring(jnp.asarray(3.0), "soft"), Spring(jnp.asarray(3.0), "hard")
    assert np.asarray(soft.force(length)) == pytest.approx(
        3.0 * np.sin(np.asarray(length)), rel=1e-14
    )
    assert np.asarray(hard.force(length=length)) == pytest.approx(
        3.0 * np.asarray(length), rel=1e-14
    )
    assert Spring.force.__name__ == "force"


def test_an_unknown_option_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    known = {"xla_backend_optimization_level": 0}
    monkeypatch.setattr(compile_options, "_QUICK", known | {"xla_spam": False})
    fresh = functools.cache(quick_options.__wrapped__)
    assert fresh() == known


SWITCH_ON = "from famjax.compilation_cache import switch_on; print(repr(switch_on()))"


def in_fresh_process(code: str, **environment: str) -> str:
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("JAX_", "FAMJAX_"))}
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        env=kept | environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout.strip()


def test_the_library_keeps_nothing_by_itself() -> None:
    code = "import famjax, fitting, jax; famjax.Muscle, fitting.identify"
    code += "; print(jax.config.jax_compilation_cache_dir)"
    assert in_fresh_process(code) == "None"


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


def test_it_can_be_switched_off() -> None:
    every = (
        "import os\nfor word in ('off', '', ' OFF '):\n    os.environ['FAMJAX_CACHE_DIR'] = word"
    )
    every += f"\n    {SWITCH_ON}"
    assert in_fresh_process(every).split() == ["''"] * 3


def test_the_folder_is_of_this_machine_and_private(tmp_path: Path) -> None:
    folder = Path(in_fresh_process(SWITCH_ON, FAMJAX_CACHE_DIR=str(tmp_path)).strip("'"))
    assert folder.parent == tmp_path
    assert folder.name.endswith(f"-jaxlib-{jax.lib.__version__}")
    if sys.platform != "win32":
        folder.chmod(0o755)
        in_fresh_process(SWITCH_ON, FAMJAX_CACHE_DIR=str(tmp_path))
        assert folder.stat().st_mode & 0o777 == 0o700


def test_a_folder_that_cannot_be_made_is_no_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    below = str(tmp_path / "file" / "below")
    assert in_fresh_process(SWITCH_ON, FAMJAX_CACHE_DIR=below) == "''"


def test_a_folder_of_somebody_else_is_not_trusted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert compilation_cache._private_folder(tmp_path / "mine")
    monkeypatch.setattr(os, "getuid", lambda: -1, raising=False)
    assert not compilation_cache._private_folder(tmp_path / "mine")


def test_a_folder_given_to_jax_stays(tmp_path: Path) -> None:
    code = f"{SWITCH_ON}; import jax; print(jax.config.jax_persistent_cache_min_compile_time_secs)"
    given = {"JAX_COMPILATION_CACHE_DIR": str(tmp_path / "theirs")}
    printed = in_fresh_process(code, **given, FAMJAX_CACHE_DIR=str(tmp_path / "ours"))
    assert printed.split() == [repr(str(tmp_path / "theirs")), "1.0"]
    assert not (tmp_path / "ours").exists()


def test_the_oldest_programs_go_first_and_nothing_else_goes(tmp_path: Path) -> None:
    for k, host in enumerate(("a-jaxlib-1", "b-jaxlib-2", "b-jaxlib-2")):
        path = tmp_path / host / f"jit_{k}-cache"
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(bytes(100))
        os.utime(path, (k, k))
    for other in ("notes-cache", "b-jaxlib-2/notes"):
        (tmp_path / other).write_bytes(bytes(1000))
    compilation_cache._bound(tmp_path, 250)
    assert {p.name for p in tmp_path.rglob("*") if p.is_file()} == {
        "jit_1-cache", "jit_2-cache", "notes-cache", "notes"
    }  # fmt: skip
    assert contents(str(tmp_path / "b-jaxlib-2")) == (2, 200)


@pytest.mark.slow
def test_doctor_says_where_programs_are_kept(tmp_path: Path) -> None:
    def doctor(**environment: str) -> str:
        out = in_fresh_process("from famjax.__main__ import main; main(['doctor'])", **environment)
        return next(line for line in out.splitlines() if line.startswith("compilation cache:"))

    told = doctor(FAMJAX_CACHE_DIR=str(tmp_path))
    assert str(tmp_path) in told
    assert "0 programs" in told
    assert "off (FAMJAX_CACHE_DIR says so" in doctor(FAMJAX_CACHE_DIR="off")
    theirs = str(tmp_path / "theirs")
    assert theirs in doctor(JAX_COMPILATION_CACHE_DIR=theirs)


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
