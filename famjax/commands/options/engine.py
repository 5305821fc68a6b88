"""The options of long commands that say where the work is done."""

import contextlib
import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from famjax.boundary.errors import InputError
from famjax.boundary.extras import import_extra

from .whole_numbers import Jobs

_CONNECT = 10.0  # s to find the scheduler


@Parameter(name="*")
@dataclasses.dataclass(frozen=True, kw_only=True)
class EngineOptions:
    """Processes of this machine or a cluster; the results are the same.

    Parameters
    ----------
    jobs
        Number of processes. More than the machine has cores make nothing faster.
    dask
        Address of the scheduler of a dask cluster, `tcp://host:8786`, or its scheduler file; the
        workers need this installation, and the paths of pictures.
    """

    jobs: Annotated[Jobs, Parameter(name=("--jobs", "--workers"))] = None
    dask: str | None = None

    @contextlib.contextmanager
    def executor(self, otherwise: Literal["auto"] | None = None) -> Iterator[Any]:
        """What the options name, for `executor=`; a cluster is left at the end.

        Args:
            otherwise: where they name nothing.

        Raises:
            InputError: both are given, dask is not installed, or no scheduler answers.
        """
        if self.dask is None:
            yield otherwise if self.jobs is None else self.jobs
            return
        if self.jobs is not None:
            raise InputError("give --jobs for this machine or --dask for a cluster, not both")
        distributed = import_extra("distributed", "cluster")
        file = Path(self.dask)
        where = {"scheduler_file": self.dask} if file.is_file() else {"address": self.dask}
        try:
            client = distributed.Client(**where, timeout=_CONNECT, set_as_default=False)
        except (OSError, ValueError, TypeError, KeyError) as error:
            raise InputError(
                f"no dask scheduler answers at {self.dask} ({str(error).partition(chr(10))[0]}): "
                "give the address that `dask scheduler` prints, tcp://host:8786"
            ) from None
        with client:
            yield client


UNNAMED = EngineOptions()
"""Where the options name nothing."""
