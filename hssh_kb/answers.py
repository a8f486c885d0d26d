"""Answers as documents: what each command prints with ``--json``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from hssh_kb.experience import Experience
from hssh_kb.place_graph import PlaceGraph
from hssh_kb.ranking import MapRow, RankedMaps, tabulate_maps

if TYPE_CHECKING:
    from hssh_kb.change_of_mind import ChangeOfMind
    from hssh_kb.check import Check
    from hssh_kb.kb import KnowledgeBase
    from hssh_kb.route import Route
    from hssh_kb.route_steps import Step

Document = dict[str, Any]


def document_maps(
    experience: Experience,
    ranked: RankedMaps,
    changes: Sequence[ChangeOfMind] | None = None,
) -> Document:
    """Return the ``hssh.maps/1`` document of a ranking, with the changes of mind if asked for."""
    document: Document = {
        "schema": "hssh.maps/1",
        "consistent": ranked.consistent,
        "complete": ranked.complete,
        "ranked_by": ranked.ranked_by,
        "proven": ranked.proven,
        "budget_spent": ranked.budget_spent,
        "inconsistent_from": ranked.inconsistent_from,
        "contradiction": ranked.contradiction or None,
        "visits": len(experience),
        "maps": [_document_row(row) for row in tabulate_maps(experience, ranked)],
    }
    if ranked.ranked_by == "minimal":
        document["minimal"] = ranked.minimality
        document["policy"] = ranked.policy
    if changes is not None:
        document["changes"] = [_document_change(change) for change in changes]
    return document


def _document_change(change: ChangeOfMind) -> Document:
    return {
        "visit": f"v{change.visit}",
        "text": change.text,
        "beliefs": [
            {"visit": f"v{b.visit}", "before": f"P{b.before}", "after": f"P{b.after}"}
            for b in change.beliefs
        ],
        "axiom": change.refusal.axiom if change.refusal else None,
        "travels": [f"v{v}" for v in change.refusal.travels] if change.refusal else [],
        "lost_nats": round(change.lost_nats, 3) if math.isfinite(change.lost_nats) else None,
    }


def _document_row(row: MapRow) -> Document:
    h = row.hypothesis
    return {
        "map": row.number,
        "rank": row.rank,
        "tie": row.tie,
        "places": row.places,
        "paths": row.paths,
        "log_posterior": h.log_posterior,
        "probability": row.probability,
        "visits": [f"P{place}" for place in h.visits],
        "offsets": list(h.offsets),
        "readings": list(h.readings) or [0] * len(h.visits),
        "terms": dict(h.terms),
        "doubted": [f"v{v}" for v in h.doubted],
    }


def document_route(route: Route, number: int = 1) -> Document:
    """Return the ``hssh.route/1`` document of a route."""
    return {
        "schema": "hssh.route/1",
        "from": route.start.label,
        "to": route.goal.label,
        "text": route.text,
        "steps": [document_step(step) for step in route.steps],
        "length_m": None if route.length_m is None else round(route.length_m, 3),
        "holds_in": route.holds_in,
        "maps": route.maps,
        "map": number,
        "places": [route.start.label, *(edge.goal for edge in route.edges)],
        "doubted": [list(ends) for ends in route.doubted],
        "names": {p.label: p.name for p in (route.start, route.goal) if p.name},
    }


def document_no_route(start: str, goal: str, reason: str, number: int = 1) -> Document:
    """Return the ``hssh.route/1`` document that says that there is no route, and why."""
    return {
        "schema": "hssh.route/1",
        "from": start,
        "to": goal,
        "text": None,
        "steps": [],
        "length_m": None,
        "holds_in": 0,
        "map": number,
        "reason": reason,
    }


def document_step(step: Step) -> Document:
    """Return one step of a route as plain data."""
    return {
        "action": step.action,
        "direction": step.direction,
        "at": step.at,
        "along": step.along,
        "count": step.count,
        "anchor": step.anchor,
        "nth": step.nth or None,
        "past": list(step.past),
        "text": step.text,
    }


def document_check(check: Check) -> Document:
    """Return the ``hssh.check/1`` document of a check."""
    violations = [
        {
            "axiom": violation.axiom,
            "source": violation.source,
            "text": violation.text,
            "witness": _to_plain(violation.witness),
            "observations": _to_plain(violation.observations),
            "minimal": violation.minimal,
            "axioms": list(violation.axioms),
        }
        for violation in check.violations
    ]
    return {
        "schema": "hssh.check/1",
        "consistent": check.consistent,
        "violations": violations,
        "repairs": _to_plain(check.repairs),
        "status": check.status,
        "text": check.text,
        "complete": check.complete,
    }


def document_build(kb: KnowledgeBase, path: str) -> Document:
    """Return the ``hssh.build/1`` document of a knowledge base just built."""
    rows = kb.rows
    return {
        "schema": "hssh.build/1",
        "kb": path,
        "source": kb.record.source,
        "scans": kb.record.scans,
        "visits": len(kb.experience),
        "places": rows[0].places if rows else 0,
        "paths": rows[0].paths if rows else 0,
        "maps": len(rows),
        "ranked_by": kb.ranked_by,
        "proven": kb.ranked.proven,
        "budget_spent": kb.ranked.budget_spent,
        "inconsistent_from": kb.ranked.inconsistent_from,
        "trajectory_m": None if kb.trajectory is None else round(kb.trajectory.length_m, 3),
        "seconds": dict(kb.record.seconds),
        "notices": list(kb.record.notices),
    }


def document_graph(graph: PlaceGraph) -> Document:
    """Return places, edges and paths of a map as plain data."""
    return {
        "places": [
            {
                "place": place.label,
                "name": place.name,
                "visits": [f"v{v}" for v in place.visits],
                "star": [str(dlp) for dlp in place.star.dlps],
                "headings_rad": list(place.headings_rad),
                "frontiers": list(place.frontiers),
            }
            for place in graph.places.values()
        ],
        "edges": [
            {
                "from": edge.start,
                "dlp": edge.dlp,
                "to": edge.goal,
                "arrive": edge.arrive,
                "path": edge.path,
                "forward": edge.forward,
                "length_m": edge.length_m,
                "travels": [f"v{v}" for v in edge.travels],
            }
            for edge in graph.undirected_edges
        ],
        "paths": [asdict(path) for path in graph.paths],
    }


def _to_plain(value: Any) -> Any:  # noqa: ANN401
    """Turn tuples, sets and other containers into lists, for JSON."""
    if isinstance(value, dict):
        return {str(key): _to_plain(item) for key, item in value.items()}
    if isinstance(value, set | frozenset):
        return [_to_plain(item) for item in sorted(value)]
    if isinstance(value, list | tuple):
        return [_to_plain(item) for item in value]
    return value
