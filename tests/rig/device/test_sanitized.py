"""The C core with the compiler's sanitizers: nothing undefined or unsafe, whatever comes in."""

import random
import shutil
import subprocess
from pathlib import Path

import pytest

from rig.device import firmware_folder
from rig.protocol import frame

TARGET = Path(__file__).parents[1] / "fuzz_core.c"
SANITIZERS = "-fsanitize=address,undefined", "-fno-sanitize-recover=all"
TICKS = 400_000


@pytest.fixture(scope="module")
def fuzz(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The fuzz target, built with the address and undefined behaviour sanitizers."""
    if shutil.which("cc") is None:
        pytest.skip("no C compiler 'cc' on the path")
    program = tmp_path_factory.mktemp("fuzz") / "fuzz"
    names = "famrig_core.c", "famrig_plausibility.c", "famrig_text.c"
    core = [str(firmware_folder() / name) for name in names]
    warnings = ["-std=c99", "-g", "-O1", "-Wall", "-Wextra", "-Werror", f"-I{firmware_folder()}"]
    command = ["cc", *warnings, *SANITIZERS, str(TARGET), *core, "-o", str(program)]
    built = subprocess.run(command, capture_output=True, text=True, check=False)
    if "cannot find" in built.stderr:
        pytest.skip("the compiler has no sanitizers")
    assert built.returncode == 0, built.stderr
    return program


def _clean(run: "subprocess.CompletedProcess[bytes]") -> bool:
    assert run.returncode == 0, run.stderr.decode()
    return not run.stderr


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_nothing_is_undefined_or_unsafe_under_random_hosts(seed: int, fuzz: Path) -> None:
    run = subprocess.run([fuzz, str(seed), str(TICKS)], capture_output=True, check=False)
    assert _clean(run)
    assert int(run.stdout.rsplit(b" ", 1)[1]) > 1000  # lines that it has heard


def test_nor_under_bytes_as_a_fuzzer_makes_them(fuzz: Path) -> None:
    r = random.Random(5)
    lines = b"".join(
        frame(f"{k} {body}")
        for k, body in enumerate(
            ("trip 900", "jump 1023", "gain 127.9 127.9", "set 1023.9 255", "run", "board 77"), 1
        )
    )
    for _ in range(20):
        data = bytearray(lines + r.randbytes(2000))
        for _ in range(r.randint(0, 4)):
            data[r.randrange(len(lines))] = r.randrange(256)
        pairs = bytes(b for byte in data for b in (byte, r.choice((0x10, 0x0F, r.randrange(256)))))
        assert _clean(subprocess.run([fuzz], input=pairs, capture_output=True, check=False))
