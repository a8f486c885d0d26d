"""Building many knowledge bases at once, each from its own log or trace.

Source: ours.
"""

from __future__ import annotations

import contextlib
import queue
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from hssh_kb.errors import HsshError, InputError, UsageError
from hssh_kb.executor import Outcome, run_tasks, share_queue

STAGES = ("localise", "places", "search")
"""The stages that report progress, in order."""

Report = Callable[[str, int, int], None]


@dataclass(frozen=True)
class BuildTask:
    """One input to build.

    Attributes
    ----------
    source, target : the input and the knowledge base to write.
    options : keywords of :func:`hssh_kb.build.build`.
    number : which of the tasks it is, for reports.
    reports : queue to put (number, stage, done, in all) on; None for no reports.
    """

    source: Path
    target: Path
    options: Mapping[str, Any] = field(default_factory=dict)
    number: int = 0
    reports: Any = None


@dataclass(frozen=True)
class Built:
    """What became of one input.

    Attributes
    ----------
    task : the input and its target.
    document : its ``hssh.build/1`` document; None if it failed.
    error : why it failed; None if it did not.
    """

    task: BuildTask
    document: dict[str, Any] | None
    error: HsshError | None


def build_one(task: BuildTask) -> dict[str, Any]:
    """Build one knowledge base, save it, and return its ``hssh.build/1`` document.

    Raises
    ------
    InputError : the input cannot be read or breaks its format; it is named.
    """
    from hssh_kb.answers import document_build
    from hssh_kb.kb import KnowledgeBase
    from hssh_kb.store import is_knowledge_base
    from perception.bags import looks_like_bag

    def report(stage: str, done: int, total: int) -> None:
        if task.reports is not None and (done == total or done % 25 == 0):
            with contextlib.suppress(OSError, EOFError):  # nobody listens any more
                task.reports.put((task.number, stage, done, total))

    if not looks_like_bag(task.source) and is_knowledge_base(task.source):
        raise InputError(f"{task.source}: is a knowledge base already, nothing to build")
    kb = KnowledgeBase.build(task.source, progress=report, **task.options)
    kb.save(task.target)
    return document_build(kb, str(task.target))


def build_many(
    tasks: Sequence[BuildTask],
    *,
    where: str = "processes",
    jobs: int = 1,
    finished: Callable[[Built], None] | None = None,
    report: Report | None = None,
) -> tuple[Built, ...]:
    """Build knowledge bases in parallel; one that fails stops no other.

    The same input gives the same maps whatever the number of processes, unless a search runs
    into its budget of seconds, which the answer says.

    Parameters
    ----------
    tasks : what to build. On a cluster the workers have to see the same folders as this machine.
    where, jobs : as in :func:`hssh_kb.executor.open_executor`.
    finished : called with each answer as it comes.
    report : called with (name of the input, done, in all) as work goes on.

    Raises
    ------
    UsageError : two inputs would be written to one file, or there is no such executor.
    InputError : the cluster does not answer.
    """
    _refuse_doubles(tasks)
    reports, close = share_queue(where) if report is not None else (None, lambda: None)
    numbered = [replace(task, number=i, reports=reports) for i, task in enumerate(tasks)]
    if where != "processes":  # workers stand in folders of their own
        numbered = [
            replace(task, source=task.source.absolute(), target=task.target.absolute())
            for task in numbered
        ]

    def settle(index: int, outcome: Outcome[dict[str, Any]]) -> Built:
        task, document, error = tasks[index], outcome.answer, outcome.error
        if document is not None and not task.target.is_file():
            document = None
            error = InputError(
                f"{task.target}: was written by a worker but is not to be seen from here; workers "
                "and this machine have to share the folder"
            )
        if document is not None:
            document = {**document, "kb": str(task.target)}
        return Built(task, document, error)

    def note(index: int, outcome: Outcome[dict[str, Any]]) -> None:
        if report is not None:
            report(tasks[index].source.name, 100, 100)
        if finished is not None:
            finished(settle(index, outcome))

    def listen() -> None:
        if report is not None and reports is not None:
            _pass_on(reports, tasks, report)

    try:
        outcomes = run_tasks(
            build_one,
            numbered,
            where=where,
            jobs=jobs,
            finished=note,
            tick=listen if reports is not None else None,
        )
    finally:
        close()
    return tuple(settle(i, outcome) for i, outcome in enumerate(outcomes))


def _refuse_doubles(tasks: Sequence[BuildTask]) -> None:
    seen: dict[Path, Path] = {}
    for task in tasks:
        other = seen.setdefault(task.target.absolute(), task.source)
        if other is not task.source:
            raise UsageError(
                f"{other} and {task.source} would both be written to {task.target}; build them "
                "one by one, each with its own -o"
            )


def _pass_on(reports: Any, tasks: Sequence[BuildTask], report: Report) -> None:  # noqa: ANN401
    """Turn what processes report into parts of a hundred, one bar a log."""
    with contextlib.suppress(queue.Empty):
        while True:
            number, stage, done, total = reports.get_nowait()
            if stage in STAGES:
                share = (STAGES.index(stage) + done / max(total, 1)) / len(STAGES)
                report(tasks[number].source.name, min(round(100 * share), 99), 100)
