"""Who shares the work of a verb: this process alone, processes of this machine, or the workers of a Dask cluster."""

from __future__ import annotations

import io
import pickle
from collections.abc import Callable
from concurrent.futures import CancelledError
from contextlib import ExitStack
from dataclasses import dataclass
from types import TracebackType
from typing import Any

from maskfab.base.errors import JobError
from maskfab.base.extras import require
from maskfab.base.machine import cores, memory_bytes
from maskfab.base.processes import Other, ProcessExecutor, SerialExecutor, answer
from maskfab.base.work import one_thread

PROCESS_BYTES = 1e9
"""Memory of a process with what most tasks hold."""
_ANSWERS_WITHIN_S = 10
_AT_ONCE = 4
"""Tasks at each thread of a worker, so that none is idle while the next one is on its way."""
_SENT_APART = 1_000_000
"""Bytes of a message that would make the graph of tasks large."""


@dataclass(frozen=True)
class Workers:
    """Who shares the work; what is found does not show who found it.

    Attributes:
        processes: of this machine, this one included; by default one for each processor, as far as memory bears.
        scheduler: address of a Dask scheduler, whose workers take the place of other processes.
        installation: tells a worker's version of all that numbers depend on; with a scheduler.
    """

    processes: int | None = None
    scheduler: str | None = None
    installation: Callable[[], str] = str

    def __post_init__(self) -> None:
        """Check that there can be a cluster, if one is asked for.

        Raises:
            JobError: MF105 for processes and a cluster; MissingPackageError MF152 for a cluster without dask.
        """
        if self.scheduler is None:
            return
        if self.processes is not None:
            what = f"{self.processes} processes of this machine, and a cluster"
            raise JobError("MF105", what, where="--workers", cure="Leave one of --workers and --scheduler out")
        require("cluster", what="a cluster", where="--scheduler", otherwise="leave --scheduler out")

    def at_once(self, tasks: int) -> int:
        """Processes of this machine that so many tasks are shared among."""
        borne = int(min(cores(), memory_bytes() // PROCESS_BYTES))
        return max(1, min(self.processes or borne, tasks))

    def executor(self, tasks: int) -> SerialExecutor:
        """An executor for so many tasks at a time."""
        if self.scheduler is not None:
            return ClusterExecutor(self.scheduler, self.installation)
        others = self.at_once(tasks) - 1
        return ProcessExecutor(others, memory_bytes()) if others else SerialExecutor()


EVERY_CORE = Workers()
"""As many processes as this machine bears."""


class ClusterExecutor(ProcessExecutor):
    """This process and the workers of a Dask cluster; ``installation`` is a worker's of all that numbers depend on."""

    def __init__(self, scheduler: str, installation: Callable[[], str]) -> None:
        super().__init__()
        self._scheduler, self._installation = scheduler, installation

    def __enter__(self) -> ClusterExecutor:
        """Find the workers; MF164 for a scheduler that does not answer, or workers of another version."""
        with ExitStack() as stack:
            self._client = stack.enter_context(_client(self._scheduler))
            check_version(self._client, self._scheduler, self._installation)
            self._others = _AT_ONCE * sum(self._client.nthreads().values())
            super().__enter__()
            self._left = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._left:
            super().__exit__(kind, error, trace)

    def _other(self) -> Other:
        return _Worker(self._client)


class _Worker(Other):
    """Whichever worker the scheduler chooses."""

    def __init__(self, client: Any) -> None:
        self._client, self._future, self._killed = client, None, False

    def answer(self, message: bytes) -> Any:
        from distributed import KilledWorker

        apart = len(message) > _SENT_APART
        sent = self._client.scatter(message, hash=False) if apart else message
        future = self._future = self._client.submit(answered, sent, pure=False)
        if self._killed:
            future.cancel()
        try:
            return pickle.loads(future.result())
        except (KilledWorker, CancelledError) as error:
            raise OSError(str(error)) from error

    def kill(self) -> None:
        self._killed = True
        if self._future is not None:
            self._future.cancel()


@one_thread
def answered(message: bytes) -> bytes:
    """Result of a task, in a process that others have set up, which may use more threads."""
    return answer(io.BytesIO(message))


def _client(scheduler: str) -> Any:
    """A client of a scheduler that answers; MF164 for one that does not."""
    import distributed

    try:
        return distributed.Client(scheduler, timeout=_ANSWERS_WITHIN_S, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        what = f"no scheduler answers at {scheduler} within {_ANSWERS_WITHIN_S} s"
        cure = "Start it with dask scheduler, and give the address that it prints, such as tcp://127.0.0.1:8786"
        raise JobError("MF164", what, where="--scheduler", cure=cure) from error


def check_version(client: Any, scheduler: str, installation: Callable[[], str]) -> None:
    """Refuse workers that have other code or versions of libraries, and would find other numbers (MF164)."""
    cure = "Install the same maskfab and the same libraries there, and start the workers again"
    try:
        versions = client.run(installation, on_error="return")
    except Exception as error:
        what = f"workers of {scheduler} do not answer: {error}"
        raise JobError("MF164", what, where="--scheduler", cure=cure) from error
    if not versions:
        cure = f"Start some: dask worker {scheduler} --nthreads 1"
        raise JobError("MF164", f"the scheduler {scheduler} has no workers", where="--scheduler", cure=cure)
    own = installation()
    for address, version in versions.items():
        if version != own:
            fault = f"fails with {version!r}" if isinstance(version, Exception) else "runs another maskfab or libraries"
            raise JobError("MF164", f"the worker {address} {fault}", where="--scheduler", cure=cure)
