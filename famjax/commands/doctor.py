"""`famjax doctor`: what this installation is made of, and what is wrong with it."""

import importlib.metadata
import platform
from pathlib import Path

from .. import __version__
from .._require import SIBLINGS, clashes, require
from .compilation_cache import VARIABLE, cache_root, contents, is_loaded, switch_on

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
    "mujoco",
    "mujoco-mjx",
    "optax",
    "blackjax",
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
    found = clashes()
    for name in () if found else SIBLINGS:
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
    there = {str(one.metadata["Name"]).lower() for one in importlib.metadata.distributions()}
    known = ("opencv-python", "opencv-contrib-python", "opencv-python-headless")
    cameras = [name for name in known if name in there]
    if len(cameras) > 1:
        found.append(
            f"{' and '.join(cameras)} both own the package cv2: keep opencv-python-headless only"
        )
    return found


def doctor() -> int:
    """Report versions, devices, precision and name clashes; exit code 1 if something is wrong."""
    print(f"famjax {__version__}")
    for name, version in versions().items():
        print(f"  {name} {version}")
    import jax

    print("devices:", ", ".join(str(device) for device in jax.devices()))
    print(
        "float64:",
        "on" if jax.config.read("jax_enable_x64") else "off in this process (JAX's default)",
        "- the famjax commands that identify switch it on themselves",
    )
    print("compilation cache:", _cache_sentence())
    found = problems()
    for problem in found:
        print("problem:", problem)
    if not found:
        print("no problems found")
    return 1 if found else 0


def _cache_sentence() -> str:
    """Where compiled programs are kept, how many, and whether they are used."""
    folder = switch_on()
    if not folder:
        root = cache_root()
        if root is None:
            return f"off ({VARIABLE} says so, or there is no home); every command compiles anew"
        return (
            f"off, as no folder of this user alone can be written below {root}; every command "
            f"compiles anew; name another folder in {VARIABLE}"
        )
    own = (root := cache_root()) is not None and Path(folder).is_relative_to(root)
    if is_loaded():
        used = "what one command compiles the next one loads"
    elif own:
        used = (
            "but what is kept is not loaded, and every command compiles anew (on some processors "
            "JAX rejects what it has kept: jax issue 38445)"
        )
    else:
        used = "which was given to JAX itself; small programs are not kept or not loaded there"
    number, size = contents(folder)
    return f"{folder}, {number} programs, {size / 1e6:.3g} MB; {used}"
