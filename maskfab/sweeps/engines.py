"""Who finds the cases of a sweep: this process, several, or a Dask cluster; the findings are the same."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

from maskfab.errors import JobError, OutputError
from maskfab.kept.fingerprint import of_installation
from maskfab.processes import Alone, Pair
from maskfab.progress import Progress
from maskfab.sweeps.case_files import Record, keep, make_folder
from maskfab.sweeps.finding import find_and_keep, find_by_one_thread
from maskfab.sweeps.plan import Case
from maskfab.threads import one_thread

Engine: TypeAlias = Literal["processes", "serial", "dask"]
ENGINES: tuple[str, ...] = get_args(Engine)
_ANSWERS_WITHIN_S = 10
_TOLD = 200
"""Times at most that progress is told: it counts all cases."""
_AT_ONCE = 4
"""Tasks that wait at each worker of a cluster, so that none is idle while the next is on its way."""
_TASK_S = 0.2
"""Work of a cluster's task: it costs some 20 ms to hand out, and all its cases are lost with its worker."""
_MOST_IN_TASK = 100


@one_thread
def map_cases(
    cases: Sequence[Case],
    quantities: tuple[str, ...],
    folder: Path,
    progress: Progress,
    *,
    engine: Engine = "processes",
    scheduler: str | None = None,
    workers: int | None = None,
) -> list[Record]:
    """Find cases, each kept in its file as soon as it is found.

    Args:
        cases: none of which is refused.
        quantities: that are wanted.
        folder: of the files; made once nothing can be refused any more.
        progress: told how many are found.
        engine: who finds them.
        scheduler: address of a Dask scheduler, of that engine alone.
        workers: processes, this one included; by default as many as there are processors.

    Returns:
        Records in the order of the cases; one whose worker failed says so and has no file, so that it is tried again.

    Raises:
        JobError: MF105 for engines and addresses that do not go together; MF164 for a scheduler that does not answer,
            or workers that run another version.
        OutputError: MF401 where files cannot be written; MF431 without dask.
    """
    if (engine == "dask") != (scheduler is not None) or engine not in ENGINES:
        cure = "Use --engine serial or processes, or --engine dask with --scheduler tcp://HOST:8786"
        raise JobError("MF105", f"the engine {engine!r} with the scheduler {scheduler!r}", where="--engine", cure=cure)
    if scheduler is not None:
        return _by_cluster(cases, quantities, folder, progress, scheduler)
    make_folder(folder)
    others = 0 if engine == "serial" else min(workers or os.cpu_count() or 1, len(cases)) - 1
    return _by_processes(cases, quantities, folder, progress, others)


def _by_processes(
    cases: Sequence[Case], quantities: tuple[str, ...], folder: Path, progress: Progress, others: int
) -> list[Record]:
    progress("cases", 0, len(cases))
    records: list[Record] = []
    told = 0
    with Pair(others) if others > 0 else Alone() as crew:
        tasks = [
            crew.submit(partial(find_and_keep, folder), lambda case=case: (case.key, case.document, quantities))  # type: ignore[misc]
            for case in cases
        ]
        # The others begin with the first, this process with the last: they meet where little is left.
        for done, task in enumerate(reversed(tasks)):
            task.attempt()
            if done % max(1, len(cases) // _TOLD) == 0 and (ended := sum(each.ended for each in tasks)) > told:
                progress("cases", ended, len(cases))
                told = ended
        for case, task in zip(cases, tasks, strict=True):
            try:
                records.append(task.result())
            except (JobError, OutputError):
                raise
            except Exception as error:
                records.append(_failed(case, error))
    progress("cases", len(cases), len(cases))
    return records


def _by_cluster(
    cases: Sequence[Case], quantities: tuple[str, ...], folder: Path, progress: Progress, scheduler: str
) -> list[Record]:
    distributed = _distributed()
    with _client(distributed, scheduler) as client:
        _same_version(client, scheduler)
        make_folder(folder)
        found: dict[str, Record] = {}
        waiting, many = deque(cases), 1
        tasks: dict[str, tuple[Case, ...]] = {}

        def begin(some: tuple[Case, ...]) -> Any:
            given = tuple((case.key, case.document) for case in some)
            future = client.submit(find_by_one_thread, given, quantities, pure=False)
            tasks[future.key] = some
            return future

        def take() -> tuple[Case, ...]:
            return tuple(waiting.popleft() for _ in range(min(many, len(waiting))))

        progress("cases", 0, len(cases))
        first = [begin(some) for _ in range(_AT_ONCE * len(client.nthreads())) if (some := take())]
        running = distributed.as_completed(first, loop=client.loop)
        for future in running:
            some = tasks.pop(future.key)
            try:
                records, seconds = future.result()
            except Exception as error:
                if len(some) > 1:  # which of them it was shows when each is alone
                    running.update([begin((case,)) for case in some])
                    continue
                records = [_failed(some[0], error)]
            else:
                many = max(1, min(_MOST_IN_TASK, int(len(some) * _TASK_S / seconds)))
                for record in records:
                    keep(folder, record)
            found |= {record["key"]: record for record in records}
            future.release()
            if more := take():
                running.add(begin(more))
            progress("cases", len(found), len(cases))
    return [found[case.key] for case in cases]


def _failed(case: Case, error: Exception) -> Record:
    """Record of a case that no worker finished."""
    told = str(error).strip().splitlines() or [""]
    return {"key": case.key, "failed": f"{type(error).__name__}: {told[0]}", "rows": []}


def _distributed() -> Any:
    try:
        import distributed
    except ImportError as missing:
        raise OutputError(
            "MF431", "a cluster needs the package dask.distributed", cure="pip install 'maskfab[cluster]'"
        ) from missing
    return distributed


def _client(distributed: Any, scheduler: str) -> Any:
    """A client of a scheduler that answers.

    Raises:
        JobError: MF164.
    """
    try:
        return distributed.Client(scheduler, timeout=_ANSWERS_WITHIN_S, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise JobError(
            "MF164",
            f"no scheduler answers at {scheduler} within {_ANSWERS_WITHIN_S} s",
            where="--scheduler",
            cure="Start it with dask scheduler, and give the address that it prints, such as tcp://127.0.0.1:8786",
        ) from error


def _same_version(client: Any, scheduler: str) -> None:
    """Refuse workers that would find other numbers.

    Raises:
        JobError: MF164 without workers, or if one has other code or other versions of libraries.
    """
    cure = "Install the same maskfab and the same libraries there, and start the workers again"
    try:
        versions = client.run(of_installation, on_error="return")
    except Exception as error:
        raise JobError(
            "MF164", f"workers of {scheduler} do not answer: {error}", where="--scheduler", cure=cure
        ) from error
    if not versions:
        cure = f"Start some: dask worker {scheduler} --nthreads 1"
        raise JobError("MF164", f"the scheduler {scheduler} has no workers", where="--scheduler", cure=cure)
    own = of_installation()
    for address, version in versions.items():
        if version != own:
            told = f"fails with {version!r}" if isinstance(version, Exception) else "runs another maskfab or libraries"
            raise JobError("MF164", f"the worker {address} {told}", where="--scheduler", cure=cure)
