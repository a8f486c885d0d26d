"""From typed route steps to sentences: phrase tables are data, this is the one code path."""

from __future__ import annotations

import functools
import json
from collections.abc import Sequence
from dataclasses import replace
from importlib import resources
from typing import Any

from hssh_kb.place_graph import PlaceGraph
from hssh_kb.route_steps import Step

_CLOSE_ANCHORS = {"t", "corner", "junction", "end"}


@functools.cache
def load_phrases(language: str = "en") -> dict[str, Any]:
    """Return the phrase table of a language.

    Examples
    --------
    >>> load_phrases()["turn"]["end"]["text"]
    'go to the end of the corridor and {turn}'
    """
    text = resources.files("hssh_kb").joinpath(f"phrases/{language}.json").read_text("utf-8")
    table: dict[str, Any] = json.loads(text)
    return table


def word_steps(steps: Sequence[Step], graph: PlaceGraph) -> tuple[Step, ...]:
    """Give each step its own short text."""
    return tuple(replace(step, text=_word_step(step, steps, graph)) for step in steps)


def word_route(
    steps: Sequence[Step], graph: PlaceGraph, doubted: Sequence[tuple[str, str]] = ()
) -> str:
    """Return the instructions as one paragraph; steps close to each other share a sentence.

    Stretches that are ``doubted``, given by their ends, are told at the end.
    """
    table = load_phrases()
    clauses = _merge_corners(
        [(step, _word_clause(step, graph)) for step in steps if step.action in {"turn", "arrive"}]
    )
    sentences = [step.text for step in steps if step.action == "orient"]
    i = 0
    while i < len(clauses):
        text = clauses[i][1]
        if i + 1 < len(clauses) and _is_close(clauses[i + 1][0]):
            text = table["then"].format(one=text, two=clauses[i + 1][1])
            i += 1
        sentences.append(f"{text[0].upper()}{text[1:]}.")
        i += 1
    for start, goal in doubted:
        ends = {"start": graph.places[start].title, "goal": graph.places[goal].title}
        sentences.append(_fill("doubt", "stretch", **ends))
    return " ".join(sentences)


def _merge_corners(clauses: Sequence[tuple[Step, str]]) -> list[tuple[Step, str]]:
    """Tell corners that follow one another in one clause."""
    merged = list[tuple[Step, str]]()
    for step, text in clauses:
        if merged and _is_corner(step) and _is_corner(merged[-1][0]):
            told = _fill("turn", "corner.more", before=merged[-1][1], side=_side(step))
            merged[-1] = merged[-1][0], told
        else:
            merged.append((step, text))
    return merged


def _is_corner(step: Step) -> bool:
    return step.action == "turn" and step.anchor == "corner" and not step.past


def _is_close(step: Step) -> bool:
    """Whether a step follows before the next junction, so that one sentence tells both."""
    return step.passed == 0 and not step.past and step.anchor in _CLOSE_ANCHORS


def _word_step(step: Step, steps: Sequence[Step], graph: PlaceGraph) -> str:
    table = load_phrases()
    if step.action == "orient":
        return _word_orient(step, graph)
    if step.action == "travel":
        turn = steps[steps.index(step) + 1]
        values = {
            "ordinal": _name_ordinal(step.count or 1),
            "side": _side(turn),
            "place": graph.places[turn.at].title,
        }
        return _fill("travel", _key(step), **values)
    if step.action == "turn":
        text = _word_turn(step)
        return f"{text[0].upper()}{text[1:]}."
    text = table["arrive"]["short"]["text"].format(goal=graph.places[step.at].title)
    return str(text)


def _word_orient(step: Step, graph: PlaceGraph) -> str:
    start = graph.places[step.at].title
    if step.anchor == "wall":
        key = "wall.straight" if step.direction == "straight" else "wall.side"
        return _fill("orient", key, start=start, side=_side(step))
    place = graph.places[step.anchor].title if step.anchor else ""
    return _fill("orient", step.direction or "towards", start=start, place=place)


def _word_clause(step: Step, graph: PlaceGraph) -> str:
    """Word a turn or an arrival together with the travel to it."""
    table, title = load_phrases(), graph.places[step.at].title
    ordinal = _name_ordinal(step.count or 1)
    if step.action == "arrive":
        clause = _fill("arrive", _key(step), goal=title, ordinal=ordinal)
    else:
        clause = _fill(
            "turn",
            _key(step),
            place=title,
            turn=_word_turn(step),
            side=_side(step),
            ordinal=ordinal,
        )
    if not step.past:
        return clause
    *first, places = step.past
    if first:
        places = table["past.list"].format(places=", ".join(first), last=places)
    return str(table["past"].format(places=places, clause=clause))


def _word_turn(step: Step) -> str:
    side, direction = _side(step), step.direction or ""
    if side == "back":
        return _fill("verbs", "turn.back")
    if direction.startswith(("slight", "sharp")):
        return _fill("verbs", f"turn.{direction.split()[0]}", side=side)
    if step.nth:
        return _fill("verbs", "turn.nth", ordinal=_name_ordinal(step.nth), side=side)
    return _fill("verbs", "turn", side=side)


def _key(step: Step) -> str:
    return "junction.next" if (step.anchor, step.count) == ("junction", 1) else step.anchor or ""


def _side(step: Step) -> str:
    return (step.direction or "").split(" ")[-1]


def _name_ordinal(count: int) -> str:
    table = load_phrases()
    ordinals = table["ordinals"]
    return str(
        ordinals[count - 1] if count <= len(ordinals) else table["ordinal"].format(count=count)
    )


def _fill(group: str, key: str, **values: str) -> str:
    return str(load_phrases()[group][key]["text"].format(**values))
