"""Answers of the theory as documents: queries, basic maps, finished maps, and reasons."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hssh_kb.basic import BasicExperience, BasicMap
    from hssh_kb.boundary import Boundary
    from hssh_kb.check import Check, NewPlace
    from hssh_kb.finished import Finding
    from hssh_kb.query import QueryAnswer
    from hssh_kb.why import Derivation

Document = dict[str, Any]


def document_query(query: str, answer: QueryAnswer, asked_of: str, *, complete: bool) -> Document:
    """Return the ``hssh.query/1`` document of a query over maps."""
    return {
        "schema": "hssh.query/1",
        "query": query,
        "variables": list(answer.variables),
        "asked_of": asked_of,
        "maps": answer.maps,
        "complete": complete,
        "every": [list(instance) for instance in answer.every],
        "some": [{"instance": list(instance), "maps": count} for instance, count in answer.some],
    }


def document_basic_maps(
    experience: BasicExperience,
    maps: Sequence[BasicMap],
    consistent: int,
    policy: str,
    *,
    complete: bool,
) -> Document:
    """Return the ``hssh.basic-maps/1`` document of the maps of a basic trace."""
    return {
        "schema": "hssh.basic-maps/1",
        "moments": len(experience.views),
        "consistent": consistent if complete else None,
        "complete": complete,
        "policy": policy,
        "maps": [
            {
                "map": number,
                "paths": one.size[0],
                "places": one.size[1],
                "dstates": [f"q{q}" for q in one.dstates],
                "at": [f"P{p}" for p in one.places],
                "along": [f"H{path}{'+' if forth else '-'}" for path, forth in one.paths],
            }
            for number, one in enumerate(maps, 1)
        ],
    }


def document_finished(source: str, findings: Sequence[Finding]) -> Document:
    """Return the ``hssh.finished/1`` document: what a map drawn by hand violates."""
    return {
        "schema": "hssh.finished/1",
        "map": source,
        "consistent": not findings,
        "violations": [
            {"axiom": f.axiom, "source": f.source, "text": f.text, "witness": f.witness}
            for f in findings
        ],
    }


def document_sides(boundaries: Sequence[Boundary], number: int) -> Document:
    """Return the ``hssh.sides/1`` document: what lies left and right of the paths of one map."""
    return {
        "schema": "hssh.sides/1",
        "map": number,
        "paths": [
            {
                "path": f"path({one.path[0]},{one.path[1]})",
                **{
                    side: [f"P{p}" for p in getattr(one, side)]
                    for side in ("on", "left", "right", "abnormal")
                },
                "choices": one.choices,
                "complete": one.complete,
            }
            for one in boundaries
        ],
    }


def document_why(derivation: Derivation, number: int) -> Document:
    """Return the ``hssh.why/1`` document of a derivation in one map."""
    return {"schema": "hssh.why/1", "map": number, "derivation": _document_step(derivation)}


def _document_step(step: Derivation) -> Document:
    return {
        "atom": step.atom,
        "equation": step.equation or None,
        "text": step.sentence,
        "because": [_document_step(part) for part in step.because],
    }


def document_new(answer: NewPlace, possible: Mapping[int, str]) -> Document:
    """Return the ``hssh.new-place/1`` document: why a visit is a new place.

    ``possible`` says what became of the earlier visits that no axiom refuses.
    """
    return {
        "schema": "hssh.new-place/1",
        "visit": f"v{answer.visit}",
        "forced": answer.forced,
        "text": answer.text,
        "complete": answer.complete,
        "earlier": [
            {"visit": f"v{earlier}", **_document_reason(check, possible.get(earlier, check.text))}
            for earlier, check in answer.earlier
        ],
    }


def _document_reason(check: Check, text: str) -> Document:
    first = None if check.consistent else check.violations[0]
    return {
        "possible": check.consistent if check.status != "budget spent" else None,
        "axiom": first.axiom if first else None,
        "text": text,
    }
