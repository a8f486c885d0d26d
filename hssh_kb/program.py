"""The strict program of an experience, and what turns its models into hypotheses."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from hssh_kb.errors import InputError, InternalError
from hssh_kb.experience import Experience, has_types
from hssh_kb.facts import candidate_facts, experience_to_facts
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.solver import Symbol
from hssh_kb.theory import axiom_program, read_programs
from hssh_kb.variant import Variant

_CORE = ("experience", "generate", "map", "connected", "modes/strict", "show")


def strict_program(
    experience: Experience,
    *,
    order: bool = True,
    planarity: bool = True,
    visits: int | None = None,
    generator: str = "given",
    further: Sequence[str] = (),
) -> str:
    """Return the program whose models are the consistent maps of the first visits.

    Parameters
    ----------
    experience : what was lived through.
    order, planarity : whether these axioms are loaded.
    visits : how many visits; all by default.
    generator : "wide" hides no axiom; "tight" has star isomorphism built in; "given" is the tight
        one worked out beforehand. All give the same maps, the last soonest.
    further : names of further files.
    """
    names = list(_CORE)
    facts = experience_to_facts(experience, range(len(experience) if visits is None else visits))
    if generator == "given":
        facts += candidate_facts(experience, visits)
    else:
        names.append(generator)
    if generator != "given" or has_alternatives(experience):
        names.append(axiom_program("star_isomorphism"))
    if has_types(experience):
        names.append(axiom_program("path_types"))
    names += map(axiom_program, ("travel_function", "reversibility"))
    if order:
        names.append(axiom_program("order_irreflexive"))
    if planarity:
        names.append(axiom_program("planarity"))
    return read_programs([*names, *further]) + facts


def variant_program(
    experience: Experience,
    variant: Variant,
    *,
    order: bool = True,
    planarity: bool = True,
    visits: int | None = None,
    generator: str = "wide",
    mode: str = "",
    further: Sequence[str] = (),
) -> str:
    """Return the program of a variant of the theory: all from the files in use, nothing hidden.

    Weakened axioms forbid nothing; what their violations cost is minimised first. Without a
    generator, what is offered is to be given.
    """
    left_out = set() if planarity else {"planarity"}
    left_out |= set() if order else {"order_irreflexive"}
    axioms = [name for name in variant.search_axioms() if name not in left_out]
    mode = mode or ("modes/diagnose" if variant.weights else "modes/strict")
    names = ["experience", "generate", "map", "components", mode, "show"]
    names += [generator] if generator else []
    weights = [f"weight({name},{cost})." for name, cost in sorted(variant.weights.items())]
    if weights:
        weights.append(":- violation(N,X), not weighted(N).")
    count = len(experience) if visits is None else visits
    return "\n".join(
        [
            variant.rules,
            read_programs([*names, *map(axiom_program, axioms), *further]),
            *weights,
            experience_to_facts(experience, range(count)),
        ]
    )


def hypothesis_facts(experience: Experience, hypothesis: Hypothesis) -> str:
    """Return what offers one map and no other, with the travels it doubts."""
    lines = [f"doubtable(travel({v}))." for v in hypothesis.doubted]
    for v, (p, r) in enumerate(zip(hypothesis.visits, hypothesis.offsets, strict=True)):
        if p < v:
            lines.append(f"candidate({v},{p},{r}).")
        lines.append(f":- not place({v},{p},{r}).")
        if len(experience.visits[v].readings) > 1:
            lines.append(
                f":- not reading({v},{hypothesis.readings[v] if hypothesis.readings else 0})."
            )
    return "\n" + "\n".join(lines) + "\n"


@contextmanager
def blame_variant(variant: Variant) -> Iterator[None]:
    """Turn what the solver has against a variant of the theory into an error of its author.

    Raises
    ------
    InputError : the rules of the variant do not fit together.
    """
    try:
        yield
    except InternalError as error:
        if variant.is_plain:
            raise
        raise InputError(f"axioms {variant.describe()}: {error}") from None


def make_converter(
    count: int,
    readings: bool,
    keep: Callable[[Sequence[int], Sequence[int]], bool] | None = None,
) -> Callable[[Sequence[Symbol]], Hypothesis | None]:
    """Return what turns the shown atoms of a model into a hypothesis over ``count`` visits.

    None stands for a map that ``keep`` refuses, given its visits and offsets. The arguments of
    each distinct atom are read once and kept: a model is then a few lookups.
    """
    cache: dict[Symbol, tuple[int, int, int]] = {}
    identity, zeros = list(range(count)), [0] * count

    def convert(symbols: Sequence[Symbol]) -> Hypothesis | None:
        visits, offsets = identity.copy(), zeros.copy()
        chosen = zeros.copy() if readings else []
        for symbol in symbols:
            entry = cache.get(symbol)
            if entry is None:
                numbers = [argument.number for argument in symbol.arguments]
                entry = (numbers[0], numbers[1], numbers[2] if len(numbers) == 3 else -1)
                cache[symbol] = entry
            v, value, offset = entry
            if offset < 0:
                chosen[v] = value
            else:
                visits[v], offsets[v] = value, offset
        if keep is not None and not keep(visits, offsets):
            return None
        return Hypothesis(tuple(visits), tuple(offsets), tuple(chosen))

    return convert


def has_alternatives(experience: Experience) -> bool:
    """Return whether some visit has several readings."""
    return any(len(visit.readings) > 1 for visit in experience.visits)


def sort_key(
    hypothesis: Hypothesis,
) -> tuple[tuple[int, ...], tuple[int, ...], tuple[int, ...]]:
    """Return what hypotheses are sorted by."""
    return hypothesis.visits, hypothesis.offsets, hypothesis.readings
