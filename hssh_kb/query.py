"""Questions typed as conjunctions, over all consistent maps or the best of them.

A query such as ``at(V,P), on(H,P)`` is answered by which of its instances hold in every map, and
in how many the others do.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from hssh_kb.errors import BudgetError, InputError
from hssh_kb.experience import Experience, hold_types
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.maps import Dstate, enumerate_maps, path_classes
from hssh_kb.solver import answer_query
from hssh_kb.variant import Variant

MAP_LIMIT = 20_000
"""At most so many maps are asked, unless one says otherwise."""
VOCABULARY = {
    ("visit", 1): "visit(V): V is a visit",
    ("name", 2): "name(V,N): the user calls what was visited at V by the name N, a string",
    ("at", 2): "at(V,P): visit V was at place P",
    ("new", 1): "new(V): visit V was the first at its place",
    ("dstate", 2): "dstate(Q,P): Q is a dstate at place P",
    ("along", 3): "along(Q,H,D): dstate Q is along path H in direction D, plus or minus",
    ("on", 2): "on(H,P): place P is on path H",
    ("order", 4): "order(H,D,P,P'): P comes before P' on path H in direction D",
    ("neighbour", 4): "neighbour(H,D,P,P'): P' is the next place after P that was travelled to",
    ("alpha", 2): "alpha(Q,A): travel is possible (1) from dstate Q or not (0)",
    ("place", 1): "place(P): P is a place, given as the number of its first visit",
    ("path", 1): "path(H): H is a path, path(P,K) after its first place and a dlp there",
    ("places", 1): "places(N): the map has N places",
    ("paths", 1): "paths(N): the map has N paths",
}
"""What a query may ask about; a dstate is q(P,K), at place P facing along its dlp K."""


@dataclass(frozen=True)
class QueryAnswer:
    """Which instances of a query hold in which maps.

    Attributes
    ----------
    variables : of the query, in the order in which they occur.
    every : instances that hold in all the maps: what is certain (cautious reading).
    some : all instances that hold in some map (brave reading), with the number of maps.
    maps : how many maps were asked.
    complete : False if the budget ended before all the maps were asked.
    """

    variables: tuple[str, ...]
    every: tuple[tuple[str, ...], ...]
    some: tuple[tuple[tuple[str, ...], int], ...]
    maps: int
    complete: bool = True


def query_maps(
    experience: Experience, maps: Sequence[Hypothesis], query: str, *, budget_s: float | None = None
) -> QueryAnswer:
    """Answer a conjunctive query over maps.

    Parameters
    ----------
    experience, maps : such as ``enumerate_maps(experience).maps``, or the best of them.
    query : literals with commas between them; ``not`` and comparisons are understood.
    budget_s : seconds to spend; when spent, the maps asked by then are answered for.

    Raises
    ------
    InputError : the query cannot be read, uses a predicate that there is not, or is unsafe.
    BudgetError : the budget was spent on the first map.

    Examples
    --------
    >>> from hssh_kb.trace import make_experience
    >>> from hssh_kb.maps import enumerate_maps
    >>> two = make_experience([(["a+1", "a-0"], None, 0), (["b-1", "b+0"], 1, None)])
    >>> query_maps(two, enumerate_maps(two).maps, "at(V,P), V > 0").every
    (('1', '1'),)
    """
    if not query.strip():
        raise InputError(f"the query is empty; ask for example {_EXAMPLE!r}")
    end = None if budget_s is None else time.monotonic() + budget_s
    counts: dict[tuple[str, ...], int] = {}
    variables: tuple[str, ...] = ()
    asked, step = 0, 1
    while asked < len(maps) or not asked:
        some = maps[asked : asked + step]
        try:
            variables, found = _ask(experience, some, query, end)
        except BudgetError:
            if not asked:
                raise BudgetError(
                    f"the budget of {budget_s:g} s was spent on the query before one map was "
                    "answered for; ask for less, or give a longer budget"
                ) from None
            break
        for instance in found:
            counts[instance[1:]] = counts.get(instance[1:], 0) + 1
        asked, step = asked + len(some), min(2 * step, _MOST_AT_ONCE)
        if not maps:
            break
    rows = sorted(counts.items(), key=lambda item: (-item[1], [_by_number(x) for x in item[0]]))
    every = tuple(instance for instance, count in rows if count == asked)
    return QueryAnswer(variables, every, tuple(rows), asked, asked == len(maps))


def query_all_maps(
    experience: Experience,
    query: str,
    *,
    order: bool = True,
    planarity: bool = True,
    limit: int = MAP_LIMIT,
    budget_s: float | None = None,
    variant: Variant | None = None,
) -> QueryAnswer:
    """Answer a query over all consistent maps, at most ``limit`` of them.

    ``complete`` is False if there are more maps, or more than the budget sufficed for. Half of the
    budget may go into finding them.

    Raises
    ------
    InputError, BudgetError : as in :func:`query_maps`.
    """
    start = time.monotonic()
    half = None if budget_s is None else budget_s / 2
    found = enumerate_maps(
        hold_types(experience),
        order=order,
        planarity=planarity,
        limit=limit,
        budget_s=half,
        variant=variant,
    )
    rest = None if budget_s is None else max(budget_s - (time.monotonic() - start), 0.0)
    answer = query_maps(experience, found.maps, query, budget_s=rest)
    return replace(answer, complete=answer.complete and found.complete)


def _ask(
    experience: Experience, maps: Sequence[Hypothesis], query: str, end: float | None
) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    facts = [
        (name, (str(i), *arguments))
        for i, hypothesis in enumerate(maps)
        for name, arguments in describe_map(experience, hypothesis)
    ]
    rest = None if end is None else end - time.monotonic()
    if rest is not None and rest <= 0:
        raise BudgetError("the budget was spent")
    try:
        return answer_query(query, facts, set(VOCABULARY), budget_s=rest)
    except ValueError as error:
        known = ", ".join(f"{name}/{arity}" for name, arity in sorted(VOCABULARY))
        raise InputError(f"query {query!r}: {error}; predicates: {known}") from None


_MOST_AT_ONCE = 256
_EXAMPLE = "at(V,P), on(H,P)"


def _by_number(text: str) -> tuple[int, str]:
    return (int(text), "") if text.isdigit() else (-1, text)


def describe_map(
    experience: Experience, hypothesis: Hypothesis
) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield what a map says, in the words of :data:`VOCABULARY`."""
    for v, p in enumerate(hypothesis.visits):
        yield "visit", (str(v),)
        yield "at", (str(v), str(p))
        name = experience.visits[v].name
        if name is not None:
            yield "name", (str(v), _quote(name))
        if v == p:
            yield "new", (str(v),)
            yield "place", (str(p),)
    yield from _describe_paths(experience, hypothesis)
    yield "places", (str(len(hypothesis.places)),)


def _describe_paths(
    experience: Experience, hypothesis: Hypothesis
) -> Iterator[tuple[str, tuple[str, ...]]]:
    names: dict[Dstate, str] = {}
    count = 0
    directed = path_classes(experience, hypothesis)
    stars = {p: hypothesis.reading(experience, p).star for p in hypothesis.places}
    for dstates in sorted(directed, key=min):
        behind = names.get((dstates[0][0], stars[dstates[0][0]].opposite(dstates[0][1])))
        path = behind or f"path({min(dstates)[0]},{min(dstates)[1]})"
        direction = "minus" if behind else "plus"
        if not behind:
            count += 1
            yield "path", (path,)
        names |= dict.fromkeys(dstates, path)
        for i, (p, k) in enumerate(dstates):
            q = f"q({p},{k})"
            yield "dstate", (q, str(p))
            yield "along", (q, path, direction)
            yield "alpha", (q, str(stars[p].alpha[k]))
            if not behind:
                yield "on", (path, str(p))
            if i + 1 < len(dstates):
                yield "neighbour", (path, direction, str(p), str(dstates[i + 1][0]))
            for later, _ in dstates[i + 1 :]:
                yield "order", (path, direction, str(p), str(later))
    yield "paths", (str(count),)


def _quote(name: str) -> str:
    escaped = name.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    return f'"{escaped}"'
