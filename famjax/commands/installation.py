"""What this installation is made of, and what is wrong with it."""

import importlib.metadata
import platform
from collections.abc import Iterable

from .._require import SIBLINGS, require

_REPORTED = (
    "jax",
    "jaxlib",
    "equinox",
    "optimistix",
    "lineax",
    "jaxtyping",
    "numpy",
    "opencv-python-headless",
    "scikit-image",
    "pyserial",
    "cyclopts",
    "matplotlib",
)


def versions() -> dict[str, str]:
    """Installed version of Python and of every package famjax uses; "not installed" where absent."""
    found = {"python": platform.python_version()}
    for name in _REPORTED:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = "not installed"
    return found


def problems() -> list[str]:
    """One sentence for each clash between famjax and what else is installed; starts no backend."""
    found = []
    for name in SIBLINGS:
        try:
            require(name)
        except ImportError as error:
            found.append(str(error))
    owners = importlib.metadata.packages_distributions()
    for name in SIBLINGS:
        foreign = sorted(set(owners.get(name, [])) - {"famjax"})
        if foreign:
            found.append(
                f"the distribution {', '.join(foreign)} also installs a package {name!r} and may "
                "have overwritten famjax's: uninstall it and install famjax again"
            )
    cameras = _installed(["opencv-python", "opencv-contrib-python", "opencv-python-headless"])
    if len(cameras) > 1:
        found.append(
            f"{' and '.join(cameras)} both own the package cv2: keep opencv-python-headless only"
        )
    return found


def _installed(names: Iterable[str]) -> list[str]:
    present = {str(d.metadata["Name"]).lower() for d in importlib.metadata.distributions()}
    return [name for name in names if name in present]
