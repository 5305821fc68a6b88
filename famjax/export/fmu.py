"""A muscle with its circuit as a functional mock-up unit of FMI 2.0, for Simulink and OpenModelica."""

import hashlib
import io
import platform
import shutil
import subprocess
import tempfile
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

from .. import __version__
from .circuits import resting_signal
from .mujoco import filled
from .table import Subject

_COMPILER = ("gcc", "-std=c99", "-O2", "-shared", "-fPIC", "-fvisibility=hidden")


def fmu(subject: Subject, sources: Mapping[str, bytes]) -> bytes:
    """The archive: description, sources, and a binary for this Linux where gcc is at hand.

    Args:
        subject: the muscle, with its plant.
        sources: the C of both, by name.

    References:
        FMI 2.0.4, Modelica Association, 2022.
    """
    name, plant = subject.identifier, subject.plant
    assert plant is not None
    words: dict[str, Any] = {
        "name": name,
        "MODEL": quoteattr(subject.name),
        "TOOL": quoteattr(f"famjax {__version__}"),
        "ABOUT": quoteattr("; ".join(line.strip() for line in subject.about_table)),
        "HEADING": f" * {name}, exported by famjax {__version__}",
        "LENGTH": repr(float(subject.muscle.rest_length)),
        "SIGNAL": resting_signal(plant),
        "GUID": hashlib.sha256(b"".join(sources.values())).hexdigest()[:32],
    }
    files = {f"sources/{one}": content for one, content in sources.items()}
    files[f"sources/{name}_fmu.c"] = filled("fmu.c", words)
    files["modelDescription.xml"] = filled("fmu.xml", words)
    if shutil.which("gcc") and (platform.system(), platform.machine()) == ("Linux", "x86_64"):
        files |= _binary(name, files)
    written = io.BytesIO()
    with zipfile.ZipFile(written, "w", zipfile.ZIP_DEFLATED) as archive:
        for one, content in files.items():
            archive.writestr(zipfile.ZipInfo(one), content, zipfile.ZIP_DEFLATED)
    return written.getvalue()


def _binary(name: str, files: Mapping[str, bytes]) -> dict[str, bytes]:
    """The shared library by its place; none where gcc lacks the headers of C."""
    with tempfile.TemporaryDirectory() as folder:
        for one, content in files.items():
            (Path(folder) / Path(one).name).write_bytes(content)
        parts = [f"{name}_fmu.c", f"{name}.c", "-o", f"{name}.so", "-lm"]
        done = subprocess.run([*_COMPILER, *parts], cwd=folder, check=False, capture_output=True)
        if done.returncode:
            return {}
        return {f"binaries/linux64/{name}.so": (Path(folder) / f"{name}.so").read_bytes()}
