"""A camera that a program of this computer triggers, one call for each photograph."""

import shlex
import shutil
import subprocess

from ..errors import RigError

NAME = "{name}"
"""Stands in the command for a photograph's name."""


class CameraCommand:
    """Calls a program for each photograph and does not wait for it.

    Args:
        command: program and arguments, `{name}` in them for the photograph's name.

    Attributes:
        taken: photographs that were asked for.
        failed: what the program said where it failed, by the photograph's name.

    Raises:
        RigError: the program is not there, or the name has no place in the command.
    """

    def __init__(self, command: str) -> None:
        self._words = shlex.split(command)
        if NAME not in command:
            raise RigError(
                f"the camera's command needs {NAME} where the photograph's name goes, as in "
                f"'gphoto2 --capture-image-and-download --filename photographs/{NAME}.jpg'; got "
                f"{command!r}"
            )
        if shutil.which(self._words[0]) is None:
            raise RigError(
                f"the camera's program {self._words[0]!r} is not on this computer's path"
            )
        self.taken = 0
        self.failed: dict[str, str] = {}
        self._under_way: dict[str, subprocess.Popen[str]] = {}

    def __call__(self, name: str) -> None:
        """Take a photograph of a name."""
        self.taken += 1
        words = [word.replace(NAME, name) for word in self._words]
        self._under_way[name] = subprocess.Popen(
            words, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
            text=True,
        )  # fmt: skip
        for ended in [key for key, one in self._under_way.items() if one.poll() is not None]:
            self._collect(ended)

    def close(self, seconds: float = 30.0) -> None:
        """Wait for photographs under way, so long for each at most."""
        for name in [*self._under_way]:
            self._collect(name, seconds)

    def _collect(self, name: str, seconds: float | None = None) -> None:
        process = self._under_way.pop(name)
        try:
            _, said = process.communicate(timeout=seconds)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            self.failed[name] = f"it had not ended after {seconds:g} s"
            return
        if process.returncode:
            lines = said.strip().splitlines()
            self.failed[name] = (
                f"exit code {process.returncode}, {lines[-1] if lines else 'silent'}"
            )
