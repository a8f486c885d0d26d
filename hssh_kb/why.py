"""Why something holds in a map: a derivation tree with named equations."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import takewhile

from hssh_kb.errors import InputError, NoAnswerError
from hssh_kb.experience import Experience
from hssh_kb.finished import claim_to_facts
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.solver import Step, derive_all, parse_facts
from hssh_kb.theory import read_programs

_NEAR = 4
"""So many atoms that hold are told where the one asked for does not."""
_HIDDEN = {
    "visit",
    "travelled",
    "size",
    "dlp",
    "reading",
    "trusted",
    "arrives",
    "departs",
    "opposite_direction",
    "star_size",
    "opposite_dlp",
    "is_travel",
}


@dataclass(frozen=True)
class Derivation:
    """One node of a derivation tree.

    Attributes
    ----------
    atom : what holds. equation : number of the equation or axiom by which; empty for what was
        given. sentence : in words. because : what it rests on.
    """

    atom: str
    equation: str
    sentence: str
    because: tuple[Derivation, ...]

    def lines(self, depth: int = 0, told: set[str] | None = None) -> Iterator[str]:
        """Yield the tree as indented lines; what rests on more is told in full once."""
        told = set() if told is None else told
        by = f" (equation {self.equation})" if self.equation else ""
        again = self.atom in told and bool(self.because)
        told.add(self.atom)
        yield f"{'  ' * depth}{self.sentence}{by}{', as said above' if again else ''}"
        for child in () if again else self.because:
            yield from child.lines(depth + 1, told)


def explain_holds(experience: Experience, hypothesis: Hypothesis, atom: str) -> Derivation:
    """Derive an atom in a map.

    Parameters
    ----------
    experience, hypothesis : a map of an experience.
    atom : in the words of ``axioms/named.lp``, such as ``order(path(0,0),plus,0,2)``.

    Raises
    ------
    InputError : not one ground atom.
    NoAnswerError : it does not hold in this map.

    Examples
    --------
    >>> from hssh_kb.trace import make_experience
    >>> two = make_experience([(["a+1", "a-0"], None, 0), (["b-1", "b+0"], 1, None)])
    >>> print(next(explain_holds(two, Hypothesis((0, 1), (0, 0)), "on(path(0,0),1)").lines()))
    place P1 is on path(0,0) (equation 5)
    """
    try:
        facts = parse_facts(f"{atom.strip().rstrip('.')}.")
    except ValueError as error:
        raise InputError(f"{atom!r} is not an atom such as on(path(0,0),1): {error}") from None
    if len(facts) != 1:
        raise InputError(f"{atom!r} is not one atom, such as on(path(0,0),1)")
    wanted = facts[0][2]
    program = read_programs(["experience", "map", "named"])
    steps = derive_all(
        program + claim_to_facts(experience, hypothesis),
        lambda variable, value: _tell_value(experience, variable, value),
    )
    if wanted not in steps:
        raise NoAnswerError(f"{wanted} does not hold in this map{_tell_near(wanted, steps)}")
    return _build(wanted, steps, experience)


def _tell_value(experience: Experience, variable: str, value: str) -> str:
    """Return a value as a sentence says it: places and travels by the names of their visits."""
    if variable.startswith("P") and value.isdigit():
        name = experience.visits[int(value)].name
        return f"P{value} ({name})" if name else f"P{value}"
    if variable.startswith("T") and value.isdigit() and int(value):
        label = experience.visit_label
        return f"from {label(int(value) - 1)} to {label(int(value))}"
    return value


def _tell_near(wanted: str, steps: dict[str, Step]) -> str:
    """Return which atoms of the same predicate do hold, those most alike first."""
    name = wanted.partition("(")[0]
    held = [atom for atom in steps if atom.partition("(")[0] == name]
    if not held or name in _HIDDEN or name.startswith("same_"):
        known = "dstate, at, along, on, order, schema"
        return "" if name in known.split(", ") else f"; the predicates are {known}"
    near = sorted(held, key=lambda atom: (-_count_alike(wanted, atom), atom))
    return f"; what does hold: {', '.join(near[:_NEAR])}{', ...' if len(near) > _NEAR else ''}"


def _count_alike(one: str, other: str) -> int:
    """Return how many characters two texts have in common at their beginning."""
    return sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], zip(one, other, strict=False)))


def _build(atom: str, steps: dict[str, Step], experience: Experience) -> Derivation:
    step = steps[atom]
    sentence = step.sentence or _tell(atom, experience)
    parts = [part for part in step.body if part.partition("(")[0] not in _HIDDEN]
    because = tuple(_build(part, steps, experience) for part in dict.fromkeys(parts))
    return Derivation(atom, step.label, sentence, because)


def _tell(atom: str, experience: Experience) -> str:
    """Return the sentence of an atom whose rule has none."""
    name, _, inside = atom.rstrip(")").partition("(")
    values = inside.split(",")
    if name == "place":
        visit, place = int(values[0]), int(values[1])
        if visit == place:
            return f"{experience.visit_label(visit)} is a new place in this map"
        there = experience.visit_label(place)
        return f"this map puts {experience.visit_label(visit)} at the place of {there}"
    if name in ("travel", "travelled"):
        one, other = (experience.visit_label(int(value)) for value in values)
        return f"the robot travelled from {one} to {other}"
    if name in ("starts", "ends"):
        verb = "starts" if name == "starts" else "ends"
        label = experience.visit_label(int(values[0]))
        return f"the travel to {label}, taken {values[1]}, {verb} at q({values[2]},{values[3]})"
    return atom
