"""The ``hssh.explore/1`` document."""

from __future__ import annotations

from typing import Any

from hssh_kb.explore import WORTH_BITS, Exploration, Suggestion


def document_exploration(found: Exploration) -> dict[str, Any]:
    """Return an exploration as plain data, ready for JSON.

    Bits and lengths are rounded; ``at``, ``place`` and ``route`` are labels of the places of map
    ``map``, ``dlp`` and ``facing`` are indices into the star of the place, and a turn says how many
    dlps clockwise of the one faced the robot leaves by.
    """
    return {
        "schema": "hssh.explore/1",
        "strategy": found.strategy,
        "used": found.used,
        "map": found.number,
        "at": found.at,
        "maps": len(found.weights),
        "weights": [round(weight, 6) for weight in found.weights],
        "entropy_bits": round(found.entropy_bits, 6),
        "informative": any(one.gain_bits > WORTH_BITS for one in found.suggestions),
        "doubted": None if found.doubted is None else f"v{found.doubted}",
        "unit": found.unit,
        "unreached": list(found.unreached),
        "found": found.found,
        "text": found.text,
        "suggestions": [_document_suggestion(found, one) for one in found.suggestions],
    }


def _document_suggestion(found: Exploration, one: Suggestion) -> dict[str, Any]:
    walk = one.walk
    place = found.graph.places[walk.place]
    return {
        "rank": one.rank,
        "tie": one.tie,
        "kind": one.kind,
        "place": walk.place,
        "name": place.name,
        "dlp": walk.dlp,
        "facing": walk.facing,
        "turn": walk.turns[-1],
        "direction": str(place.star.dlps[walk.dlp])[:-1],
        "text": one.text,
        "route": {
            "places": [found.at, *(edge.goal for edge in walk.way)],
            "dlps": [edge.dlp for edge in walk.way],
            "turns": list(walk.turns[:-1]),
            "text": one.route_text or None,
        },
        "leads_to": None if walk.edge is None else walk.edge.goal,
        "length": round(walk.length, 3),
        "travels": len(walk.way) + 1,
        "entropy_before_bits": round(found.entropy_bits, 6),
        "entropy_after_bits": round(one.entropy_bits, 6),
        "gain_bits": round(one.gain_bits, 6),
        "gain_bits_per_unit": round(one.rate_bits, 6),
        "expects": [
            {
                "maps": list(group.maps),
                "kind": group.kind,
                "places": list(group.places),
                "star": list(group.star),
                "text": group.text,
            }
            for group in one.expects
        ],
    }
