"""The house: what importing costs, who may know whom, and what the wheel holds."""

import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_importing_loads_no_camera_serial_or_plot_library_and_starts_no_backend() -> None:
    code = (
        "import sys, famjax, fitting\n"
        "from jax._src import xla_bridge\n"
        "loaded = {'cv2', 'skimage', 'serial', 'matplotlib', 'pint'} & set(sys.modules)\n"
        "assert not loaded, loaded\n"
        "assert not xla_bridge.backends_are_initialized()\n"
        "assert not __import__('jax').config.read('jax_enable_x64')\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_wheel_holds_exactly_the_four_packages() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    wheel = project["tool"]["hatch"]["build"]["targets"]["wheel"]
    assert wheel["packages"] == ["famjax", "fitting", "imaging", "rig"]
    for name in wheel["packages"]:
        assert (ROOT / name / "py.typed").exists()
        assert (ROOT / name / "__init__.py").exists()
