"""How long a user waits for the first answer, in CPU time of whole processes.

Each command runs in a fresh process with an empty compilation cache (`cold`), and in another one with the
cache that the first has filled (`second`). A figure is the user and system time of the process and its
children, the least of the repetitions, over that of

    python -c "import jax, equinox, optimistix"

which runs between them in the same way. Caches are in a temporary folder that nothing else uses.

It also makes what the measured processes read (`python benchmarks/first_answer.py inputs FOLDER MAP`).
"""

import dataclasses
import math
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from row import Case

HERE = Path(__file__).resolve().parent
DATA = "DMSP-20-300"
UNIT = ("-c", "import jax, equinox, optimistix")

Step = tuple[str, ...]
"""What follows the interpreter on a command line; {data} and {inputs} are filled in."""


def famjax(*arguments: str) -> Step:
    """A command of famjax."""
    return ("-m", "famjax", *arguments)


def polynomial(data: str) -> Step:
    """`famjax fit` of the polynomial law, not of one that is chosen."""
    return famjax("fit", data, "--law", "polynomial")


FIT = polynomial("{data}")
PREDICT = famjax("predict", "{inputs}/fit.json", "--length", "270mm,250mm", "--pressure", "5bar")
LONG = "{inputs}/long.csv"
MEASURE = famjax("measure", "{inputs}/photo.jpg", "--ruler", "{inputs}/ruler.jpg")


@dataclasses.dataclass(frozen=True)
class Wait:
    """A command and how long it may take.

    Attributes:
        step: what is run.
        cold, second: limits as multiples of the import, nan for none.
        prime: what has filled the cache before the regime second, in place of `step` itself; there
            is no cold regime then.
        long: takes minutes, and runs once.
    """

    step: Step
    cold: float = math.nan
    second: float = math.nan
    prime: Step | None = None
    long: bool = False


WAITS = {
    "famjax --help": Wait(famjax("--help"), 0.3, 0.3),
    "famjax fit --help": Wait(famjax("fit", "--help"), 0.3, 0.3),
    "famjax predict": Wait(PREDICT, 1.5, 1.2),
    "famjax fit --law polynomial": Wait(FIT, 4, 2.5),
    "famjax fit --law polynomial, map of another size":
        Wait(polynomial("{inputs}/smaller.csv"), second=2.2, prime=FIT),
    "famjax fit --law polynomial, another specimen":
        Wait(polynomial("{inputs}/specimen.csv"), second=2.2, prime=FIT),
    "famjax fit": Wait(famjax("fit", "{data}"), 12, 6),
    "famjax fit --law ogden, new to the cache":
        Wait(famjax("fit", "{data}", "--law", "ogden"), second=2.2, prime=FIT),
    "famjax fit --law ogden": Wait(famjax("fit", "{data}", "--law", "ogden"), second=2.2),
    "famjax measure": Wait(MEASURE, 1.5, 1.5),
    "famjax sweep": Wait(famjax("sweep", "{data}"), 4, 2, long=True),
    "famjax compare": Wait(famjax("compare", "{data}"), 25, 12, long=True),
    "famjax fit, 3000 readings": Wait(famjax("fit", LONG), second=15, long=True),
    "famjax compare, one model, 3000 readings":
        Wait(famjax("compare", LONG, "--models", "sarosi_6"), second=6, long=True),
    "famjax reproduce": Wait(famjax("reproduce"), 40, 25, long=True),
}  # fmt: skip


class FailedRunError(RuntimeError):
    """A process ended with another exit code than 0."""


@dataclasses.dataclass
class Machine:
    """Runs steps in fresh processes of an interpreter, each in an empty folder of its own.

    Attributes:
        python: the interpreter.
        data: name of a bundled map, or file.
        folder: for everything that is written.
    """

    python: str
    data: str
    folder: Path

    def run(self, step: Step, cache: Path | None) -> tuple[float, str]:
        """CPU time [s] of a process with its children, and what it has printed.

        Args:
            step: see `Step`.
            cache: folder of the compilation cache, None for an empty one.

        Raises:
            FailedRunError: with the last line of what it said.
        """
        where = Path(tempfile.mkdtemp(dir=self.folder))
        argv = [self.python, *self._filled(step)]
        with (where / "out").open("w+") as out, (where / "err").open("w+") as err:
            process = subprocess.Popen(
                argv, cwd=where, env=self._environment(cache), stdout=out, stderr=err
            )
            _, status, used = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
            for stream in (out, err):
                stream.seek(0)
            said, wrong = out.read(), err.read().strip().splitlines()
        if process.returncode:
            last = wrong[-1] if wrong else "nothing on standard error"
            raise FailedRunError(f"exit code {process.returncode}: {last}")
        return used.ru_utime + used.ru_stime, said

    def _filled(self, step: Step) -> list[str]:
        """The step with its places filled in, and its inputs made."""
        inputs = self.folder / "inputs"
        for name in re.findall(r"\{inputs\}/([\w.]+)", " ".join(step)):
            if not (inputs / name).exists():
                inputs.mkdir(exist_ok=True)
                fit = famjax("fit", "{data}", "--output", str(inputs))
                made = (__file__, "inputs", str(inputs), self.data)
                self.run(fit if name == "fit.json" else made, None)
        return [word.replace("{inputs}", str(inputs)).replace("{data}", self.data) for word in step]

    def _environment(self, cache: Path | None) -> dict[str, str]:
        """This tree first, and a cache of its own; a user's is not touched."""
        ours = {"FAMJAX_CACHE_DIR", "JAX_COMPILATION_CACHE_DIR", "PYTHONDONTWRITEBYTECODE"}
        given = {key: value for key, value in os.environ.items() if key not in ours}
        path = [HERE.parent, HERE, HERE.parent / "tests", given.get("PYTHONPATH", "")]
        return given | {
            "PYTHONPATH": os.pathsep.join(map(str, path)),
            "FAMJAX_CACHE_DIR": str(cache or tempfile.mkdtemp(dir=self.folder)),
        }


def waited(machine: Machine, wait: Wait, repeat: int = 3) -> dict[str, float]:
    """CPU time over that of the import, by regime: the least of the repetitions."""
    units, seconds = [], {"cold": math.inf, "second": math.inf}
    machine.run(wait.step, None) if repeat > 1 else None  # reads the files once, makes the inputs
    for _ in range(1 if wait.long else repeat):
        units.append(machine.run(UNIT, None)[0])
        cache = Path(tempfile.mkdtemp(dir=machine.folder))
        first, _ = machine.run(wait.prime or wait.step, cache)
        if not wait.prime:
            seconds["cold"] = min(seconds["cold"], first)
        seconds["second"] = min(seconds["second"], machine.run(wait.step, cache)[0])
        units.append(machine.run(UNIT, None)[0])
    return {f"{regime}, CPU time / import": one / min(units) for regime, one in seconds.items()}


def _machine(case: "Case", folder: str) -> Machine:
    path = Path(case.source or DATA)
    return Machine(case.python, str(path.resolve() if path.exists() else path), Path(folder))


def command_wait(case: "Case", name: str) -> dict[str, float]:
    """One of `WAITS`."""
    with tempfile.TemporaryDirectory(prefix="first-answer-") as folder:
        return waited(_machine(case, folder), WAITS[name], case.repeat)


def _scattered(count: int, rng: "np.random.Generator") -> list[Any]:
    """Forces, pressures and lengths of the DMSP-20 with 1 N of noise, each at a state of its own."""
    import jax  # noqa: PLC0415

    from famjax import muscles  # noqa: PLC0415

    jax.config.update("jax_enable_x64", True)
    muscle = muscles.dmsp_20()
    length = float(muscle.rest_length) * rng.uniform(0.84, 1, count)
    pressure = rng.uniform(3e5, 6.5e5, count)
    return [muscle.force(length, pressure) + rng.normal(size=count), pressure, length]


def make_inputs(folder: Path, name: str) -> None:
    """Maps derived from one, and photographs at the reference work's size; everything is seeded."""
    import numpy as np  # noqa: PLC0415
    from rendering import published_ruler, published_scene, render, render_ruler  # noqa: PLC0415
    from row import load  # noqa: PLC0415

    import fitting  # noqa: PLC0415

    data, rng = load(name), np.random.default_rng(0)
    levels = np.unique(data.pressure[data.loaded])
    others = [fitting.load_bundled(one) for one in fitting.bundled_names()]
    maps = {
        "smaller": data.part(data.pressure != levels[len(levels) // 2]),
        "long": fitting.ForceData(
            *_scattered(3000, rng), specimen=fitting.load_bundled("DMSP-20").specimen
        ),
        "specimen": next(one for one in others if one.sha256 != data.sha256),
    }
    for stem, one in maps.items():
        fitting.write_csv(one, folder / f"{stem}.csv")
    render(published_scene(0.175), 7).save(folder / "photo.jpg")
    render_ruler(published_ruler(), 1).save(folder / "ruler.jpg")


if __name__ == "__main__":
    make_inputs(Path(sys.argv[2]), sys.argv[3])
