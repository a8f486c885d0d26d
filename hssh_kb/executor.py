"""Where tasks run: processes of this machine, or a Dask cluster, behind one interface.

The interface is :class:`concurrent.futures.Executor`; :func:`run_tasks` adds what it lacks: a
task whose process dies takes no other with it, and answers come with what went wrong.

Source: ours.
"""

from __future__ import annotations

import concurrent.futures
import contextlib
import importlib
import multiprocessing
import os
import signal
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from hssh_kb.errors import HsshError, InputError, InternalError, UsageError

Task = TypeVar("Task")
Answer = TypeVar("Answer")
DASK = "dask:"
_TICK_S = 0.2
_THREAD_COUNTS = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "OPENCV_FOR_THREADS_NUM",
)


@dataclass(frozen=True)
class Outcome(Generic[Answer]):
    """What became of one task.

    Attributes
    ----------
    answer : what it returned; None if it failed.
    error : what went wrong; None if nothing did.
    """

    answer: Answer | None
    error: HsshError | None = None


@contextlib.contextmanager
def open_executor(where: str = "processes", *, jobs: int = 1) -> Iterator[Executor]:
    """Give an executor to run tasks on.

    Parameters
    ----------
    where : "processes", or "dask:ADDRESS" with the address of a scheduler.
    jobs : how many processes; without effect on a cluster, which has its own number of workers.

    Raises
    ------
    UsageError : another word, or Dask is not installed.
    InputError : no scheduler answers at the address.

    Examples
    --------
    >>> with open_executor("processes", jobs=1) as executor:
    ...     executor.submit(abs, -3).result()
    3
    """
    if where == "processes":
        with _open_processes(jobs) as executor:
            yield executor
    elif where.startswith(DASK):
        with _open_cluster(where.removeprefix(DASK)) as executor:
            yield executor
    else:
        raise UsageError(f"there is no executor {where!r}: use 'processes' or 'dask:ADDRESS'")


def count_cores() -> int:
    """Return how many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _open_processes(jobs: int) -> ProcessPoolExecutor:
    """Make a pool of fresh processes of one thread each, so that answers depend on neither."""
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(jobs, mp_context=context, initializer=_prepare_process)


def _prepare_process() -> None:
    """Keep the libraries that will be loaded to one thread each; end silently on Ctrl-C."""
    if signal.getsignal(signal.SIGINT) != signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    os.environ.update(dict.fromkeys(_THREAD_COUNTS, "1"))


@contextlib.contextmanager
def _open_cluster(address: str) -> Iterator[Executor]:
    """Connect to a Dask scheduler."""
    try:
        distributed: Any = importlib.import_module("distributed")
    except ImportError:
        raise UsageError(
            "an executor 'dask:ADDRESS' needs the Dask package: install 'hssh[dask]'"
        ) from None
    if not address:
        raise UsageError("'dask:' lacks the address of a scheduler, such as 'dask:tcp://host:8786'")
    try:
        client = distributed.Client(address, timeout="10s", set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        told = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"no Dask scheduler answers at {address!r} ({told})") from None
    with client:
        yield client.get_executor(pure=False)


def run_tasks(
    function: Callable[[Task], Answer],
    tasks: Sequence[Task],
    *,
    where: str = "processes",
    jobs: int = 1,
    finished: Callable[[int, Outcome[Answer]], None] | None = None,
    tick: Callable[[], None] | None = None,
) -> tuple[Outcome[Answer], ...]:
    """Run a function over tasks, in parallel; a task that fails stops no other.

    Parameters
    ----------
    function : importable by name, its arguments and answers can be pickled.
    tasks : what it is called with, one at a time.
    where, jobs : as in :func:`open_executor`.
    finished : called with (index, outcome) as tasks end, in this process.
    tick : called now and then while waiting, in this process.

    Returns
    -------
    The outcomes, in the order of the tasks whatever the order they ended in. If a process dies
    (out of memory, killed), the tasks that went down with it run again, each in a process of its
    own; that which dies again has failed.

    Raises
    ------
    UsageError, InputError : the executor cannot be had.

    Examples
    --------
    >>> [outcome.answer for outcome in run_tasks(abs, [-1, -2], jobs=2)]
    [1, 2]
    """
    outcomes: dict[int, Outcome[Answer]] = {}

    def note(index: int, outcome: Outcome[Answer]) -> None:
        outcomes[index] = outcome
        if finished is not None:
            finished(index, outcome)

    broken = list[int]()
    with open_executor(where, jobs=max(1, min(jobs, len(tasks)))) as executor:
        futures = _submit(executor, function, tasks, broken)
        try:
            for future in _wait(futures, tick):
                outcome = _settle(future)
                if outcome is None:
                    broken.append(futures[future])
                else:
                    note(futures[future], outcome)
        finally:  # on an interrupt, start nothing more
            for future in futures:
                future.cancel()
    for index in sorted(broken):
        with open_executor(where, jobs=1) as executor:
            again = executor.submit(function, tasks[index])
            for future in _wait([again], tick):
                died = InternalError("the process died on it (out of memory, or killed)")
                note(index, _settle(future) or Outcome(None, died))
    return tuple(outcomes[i] for i in range(len(tasks)))


def _submit(
    executor: Executor,
    function: Callable[[Task], Answer],
    tasks: Sequence[Task],
    broken: list[int],
) -> dict[Future[Answer], int]:
    """Submit the tasks; those that a pool already broken refuses are noted as broken."""
    futures = dict[Future[Answer], int]()
    for index, task in enumerate(tasks):
        try:
            futures[executor.submit(function, task)] = index
        except BrokenExecutor:
            broken.append(index)
    return futures


def _wait(
    futures: Iterable[Future[Answer]], tick: Callable[[], None] | None
) -> Iterator[Future[Answer]]:
    """Yield futures as they end."""
    waiting = set(futures)
    while waiting:
        done, waiting = concurrent.futures.wait(
            waiting,
            timeout=None if tick is None else _TICK_S,
            return_when=concurrent.futures.FIRST_COMPLETED,
        )
        if tick is not None:
            tick()
        yield from done


def _settle(future: Future[Answer]) -> Outcome[Answer] | None:
    """Return the outcome of a future that has ended; None if its process died."""
    try:
        return Outcome(future.result())
    except HsshError as error:
        return Outcome(None, error)
    except BrokenExecutor:
        return None
    except concurrent.futures.CancelledError:
        return Outcome(None, InternalError("it was cancelled by the cluster"))
    except Exception as error:  # a task may fail in any way, and must not stop the others
        return Outcome(None, _explain(error))


def _explain(error: Exception) -> InternalError:
    if type(error).__name__ == "KilledWorker":  # of Dask, which has tried other workers by now
        return InternalError("the workers died on it (out of memory, or killed)")
    what = " ".join(str(error).split()) or "no message"
    return InternalError(f"a fault of hssh, not of the input ({type(error).__name__}: {what})")


def share_queue(where: str) -> tuple[Any, Callable[[], None]]:
    """Return a queue that processes can put reports on, and what closes it; None on a cluster."""
    if where != "processes":
        return None, lambda: None
    manager = multiprocessing.get_context("spawn").Manager()
    return manager.Queue(), manager.shutdown
