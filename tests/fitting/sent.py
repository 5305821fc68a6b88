"""An executor for tests that sends work as one with other processes does, and does it here."""

import pickle
from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import Any


class Sent(Executor):
    """Function, arguments and result go through pickle; one task at a time, in this thread.

    Attributes:
        count: of the tasks so far.
    """

    def __init__(self) -> None:
        self.count = 0

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        self.count += 1
        function, given, named = pickle.loads(pickle.dumps((fn, args, kwargs)))
        future: Future[Any] = Future()
        future.set_result(pickle.loads(pickle.dumps(function(*given, **named))))
        return future
