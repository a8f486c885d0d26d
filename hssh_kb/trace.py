"""The trace format ``hssh.trace/1``: reading an experience from JSON, and writing it.

Source: the format is ours.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from hssh_kb.errors import InputError
from hssh_kb.experience import (
    PATH_TYPES,
    Displacement,
    Experience,
    Reading,
    Visit,
    checked_covariance,
    default_covariance,
    read_matches,
)
from hssh_kb.text_files import parse_json, read_text
from perception.star import Dlp, Star, star_faults

SCHEMA = "hssh.trace/1"
_EXPECTED = f"a trace (JSON, schema {SCHEMA})"
_ANY_HEADING_RAD2 = math.pi**2 / 3  # variance of a heading of which nothing is known
_VISIT_KEYS = {
    *("star", "arrive", "depart", "name", "displacement", "alternatives"),
    *("headings", "types", "pose", "time_s", "lpm_matches"),
}


class _Faults:
    """Gathers all faults of one input, so that they are told at once."""

    def __init__(self, source: str) -> None:
        self.source, self.faults = source, list[str]()

    def add(self, where: str, what: str) -> None:
        """Note one fault."""
        self.faults.append(f"{where}: {what}" if where else what)

    def raise_if_any(self) -> None:
        """Raise one InputError that names them all (at most ten)."""
        if not self.faults:
            return
        shown = "; ".join(self.faults[:10])
        more = f"; and {len(self.faults) - 10} more" if len(self.faults) > 10 else ""
        raise InputError(f"{self.source}: {shown}{more}")


def load_trace(path: str | Path) -> Experience:
    """Read an experience from a ``hssh.trace/1`` JSON file.

    Raises
    ------
    InputError : the file cannot be read, is not JSON, or breaks the format; all faults at once.
    """
    return parse_trace(read_text(path, _EXPECTED), source=str(path))


def parse_trace(text: str, source: str = "trace") -> Experience:
    """Read an experience from the JSON text of a ``hssh.trace/1`` document.

    Raises
    ------
    InputError : not JSON, or breaks the format; all faults at once.

    Examples
    --------
    >>> text = '''{"schema": "hssh.trace/1", "visits": [
    ...   {"star": ["a+1", "b+1", "a-0", "b-0"], "arrive": null, "depart": 1},
    ...   {"star": ["a-0", "b+1", "a+1", "b-1"], "arrive": 3, "depart": 2}]}'''
    >>> parse_trace(text).visits[1].arrive
    3
    """
    return experience_from_data(parse_json(text, source, _EXPECTED), source)


def experience_from_data(data: Any, source: str = "trace") -> Experience:  # noqa: ANN401
    """Check a decoded ``hssh.trace/1`` document and return its experience.

    Raises
    ------
    InputError : breaks the format; all faults at once.
    """
    if not isinstance(data, dict):
        raise InputError(f"{source}: expected a JSON object with 'schema' and 'visits'")
    schema = data.get("schema")
    if schema != SCHEMA:
        got = "no 'schema'" if schema is None else f"schema {schema!r}"
        raise InputError(f'{source}: {got}; expected "schema": "{SCHEMA}"')
    if data.get("kind") == "basic":
        raise InputError(
            f"{source}: is a basic trace (views and actions, no stars), "
            "which only 'hssh maps' reads"
        )
    visits = data.get("visits")
    if not isinstance(visits, list) or not visits:
        raise InputError(f"{source}: 'visits' must be a list of at least one visit")
    faults, notices = _Faults(source), list[str]()
    out = [_parse_visit(v, item, len(visits), faults, notices) for v, item in enumerate(visits)]
    slip = data.get("slip", 0.0)
    if not _is_number(slip) or not 0 <= slip < 1:
        faults.add("slip", f"must be a probability below 1, found {slip!r}")
    faults.raise_if_any()
    return Experience(
        tuple(visit for visit in out if visit is not None), source, float(slip), tuple(notices)
    )


def _is_number(value: Any) -> bool:  # noqa: ANN401
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _parse_visit(
    v: int,
    item: Any,  # noqa: ANN401
    count: int,
    faults: _Faults,
    notices: list[str],
) -> Visit | None:
    where = f"visit {v}"
    if not isinstance(item, dict):
        faults.add(where, "must be an object with 'star', 'arrive' and 'depart'")
        return None
    notices.extend(
        f"{where}: unknown key {key!r} ignored" for key in item if key not in _VISIT_KEYS
    )
    best = _parse_reading(where, v, count, item, faults)
    alternatives = item.get("alternatives", [])
    if not isinstance(alternatives, list):
        faults.add(where, "'alternatives' must be a list")
        alternatives = []
    others = [
        _parse_reading(f"{where}, alternative {i}", v, count, other, faults, weighted=True)
        for i, other in enumerate(alternatives)
    ]
    rest = 1.0 - sum(reading.weight for reading in others if reading)
    if others and rest <= 0:
        faults.add(where, f"the weights of the alternatives sum to {1 - rest:g}, must be below 1")
    name = item.get("name")
    if name is not None and not isinstance(name, str):
        faults.add(where, f"'name' must be a text, found {name!r}")
    displacement = _parse_displacement(where, item.get("displacement"), faults, notices)
    if displacement is not None and v == 0:
        faults.add(where, "the first visit has no previous visit, so no 'displacement'")
    pose = item.get("pose")
    if pose is not None and not (
        isinstance(pose, list) and len(pose) == 3 and all(map(_is_number, pose))
    ):
        faults.add(where, f"'pose' must be [x, y, theta], found {pose!r}")
        pose = None
    time_s = item.get("time_s")
    if time_s is not None and not _is_number(time_s):
        faults.add(where, f"'time_s' must be a number, found {time_s!r}")
        time_s = None
    matches = read_matches(item.get("lpm_matches", []), v)
    if matches is None:
        faults.add(where, "'lpm_matches' must be a list of [earlier visit, nats]")
    if best is None or any(reading is None for reading in others):
        return None
    first = replace(best, weight=rest)
    return Visit(
        (first, *(reading for reading in others if reading)),
        displacement,
        name if isinstance(name, str) else None,
        (float(pose[0]), float(pose[1]), float(pose[2])) if pose else None,
        float(time_s) if time_s is not None else None,
        matches or (),
    )


def _parse_reading(
    where: str,
    v: int,
    count: int,
    item: Any,  # noqa: ANN401
    faults: _Faults,
    *,
    weighted: bool = False,
) -> Reading | None:
    if not isinstance(item, dict) or not isinstance(item.get("star"), list):
        faults.add(where, "needs a 'star', a list of dlps such as \"a+1\", clockwise")
        return None
    dlps = []
    for k, text in enumerate(item["star"]):
        try:
            dlps.append(Dlp.parse(text))
        except InputError as error:
            faults.add(f"{where}, star[{k}]", str(error))
    if len(dlps) < len(item["star"]):
        return None
    bad = star_faults(dlps)
    for fault in bad:
        faults.add(f"{where}, star", fault)
    if bad:
        return None
    star = Star(tuple(dlps))
    arrive = _parse_index(where, "arrive", item.get("arrive"), star, v == 0, faults)
    depart = _parse_index(where, "depart", item.get("depart"), star, v == count - 1, faults)
    if v == 0 and arrive is not None:
        faults.add(where, "the first visit has no 'arrive' (use null)")
    if depart is not None and star.alpha[depart] == 0:
        faults.add(where, f"departs along {star.dlps[depart]}, whose alpha is 0")
    if arrive is not None and v > 0 and star.alpha[star.opposite(arrive)] == 0:
        came_in = star.dlps[star.opposite(arrive)]
        faults.add(
            where,
            f"arrives facing {star.dlps[arrive]}, so it came in through the gateway of {came_in}, "
            "whose alpha is 0",
        )
    weight = item.get("weight", 1.0) if weighted else 1.0
    if weighted and (not _is_number(weight) or not 0 < weight < 1 or "weight" not in item):
        faults.add(where, f"'weight' must be a probability between 0 and 1, found {weight!r}")
        weight = 0.5
    headings = item.get("headings", [])
    if not isinstance(headings, list) or (
        headings and (len(headings) != len(star) or not all(map(_is_number, headings)))
    ):
        faults.add(where, f"'headings' must be {len(star)} numbers, one a dlp")
        headings = []
    types = _parse_types(where, item.get("types"), star, faults)
    return Reading(star, arrive, depart, float(weight), tuple(map(float, headings)), types)


def _parse_types(
    where: str,
    types: Any,  # noqa: ANN401
    star: Star,
    faults: _Faults,
) -> tuple[str, ...]:
    if types is None:
        return ()
    if not isinstance(types, list) or len(types) != len(star):
        faults.add(where, f"'types' must be {len(star)} path types, one a dlp, null if unknown")
        return ()
    for dlp, told in zip(star.dlps, types, strict=True):
        if told is not None and (not isinstance(told, str) or told not in PATH_TYPES):
            faults.add(where, f"path type {told!r} of {dlp} is none of {', '.join(PATH_TYPES)}")
        elif told is not None and PATH_TYPES[told] != dlp.alpha:
            faults.add(where, f"path type {told} of {dlp} contradicts its alpha {dlp.alpha}")
    known = tuple(told if isinstance(told, str) else "" for told in types)
    return known if any(known) else ()


def _parse_index(
    where: str,
    key: str,
    value: Any,  # noqa: ANN401
    star: Star,
    may_lack: bool,
    faults: _Faults,
) -> int | None:
    if value is None:
        if not may_lack:
            faults.add(where, f"lacks '{key}', the index of a dlp of its star")
        return None
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < len(star):
        faults.add(
            where, f"'{key}' is {value!r}, must be an index into the {len(star)} dlps of its star"
        )
        return None
    return value


def _parse_displacement(
    where: str,
    item: Any,  # noqa: ANN401
    faults: _Faults,
    notices: list[str],
) -> Displacement | None:
    if item is None:
        return None
    where = f"{where}, displacement"
    if not isinstance(item, dict):
        faults.add(where, "must be an object with x, y, theta and cov")
        return None
    blind = item.get("theta") is None
    bad = [key for key in ("x", "y", "theta")[: 3 - blind] if not _is_number(item.get(key))]
    for key in bad:
        faults.add(where, f"'{key}' must be a finite number, found {item.get(key)!r}")
    if bad:
        return None
    x, y, theta = float(item["x"]), float(item["y"]), float(item.get("theta") or 0.0)
    try:
        cov = checked_covariance(item.get("cov", default_covariance(x, y)))
    except ValueError as error:
        faults.add(where, str(error))
        return None
    if blind:
        notices.append(f"{where}: no 'theta', so the heading is taken for unknown")
        cov = (*((*row[:2], 0.0) for row in cov[:2]), (0.0, 0.0, _ANY_HEADING_RAD2))
    return Displacement(x, y, theta, cov)


def experience_to_data(experience: Experience) -> dict[str, Any]:
    """Return the ``hssh.trace/1`` document of an experience, ready for JSON."""
    document: dict[str, Any] = {
        "schema": SCHEMA,
        "visits": [_visit_to_data(visit) for visit in experience.visits],
    }
    if experience.slip:
        document["slip"] = experience.slip
    return document


def _reading_to_data(reading: Reading) -> dict[str, Any]:
    data: dict[str, Any] = {
        "star": [str(dlp) for dlp in reading.star.dlps],
        "arrive": reading.arrive,
        "depart": reading.depart,
    }
    if reading.headings:
        data["headings"] = list(reading.headings)
    if reading.types:
        data["types"] = [told or None for told in reading.types]
    return data


def _visit_to_data(visit: Visit) -> dict[str, Any]:
    data = _reading_to_data(visit.readings[0])
    if visit.name is not None:
        data["name"] = visit.name
    if visit.displacement is not None:
        d = visit.displacement
        data["displacement"] = {
            "x": d.x,
            "y": d.y,
            "theta": d.theta,
            "cov": [list(row) for row in d.cov],
        }
    if visit.pose is not None:
        data["pose"] = list(visit.pose)
    if visit.time_s is not None:
        data["time_s"] = visit.time_s
    if visit.lpm_matches:
        data["lpm_matches"] = [list(pair) for pair in visit.lpm_matches]
    if len(visit.readings) > 1:
        data["alternatives"] = [
            {**_reading_to_data(reading), "weight": reading.weight}
            for reading in visit.readings[1:]
        ]
    return data


def make_experience(
    visits: Iterable[tuple[Sequence[str], int | None, int | None]],
    **keywords: Any,  # noqa: ANN401
) -> Experience:
    """Build an experience from ``(star texts, arrive, depart)`` triples, checked like a trace.

    Examples
    --------
    >>> len(make_experience([(["a+1", "a-0"], None, 0), (["b-1", "b+0"], 1, None)]))
    2
    """
    data: Mapping[str, Any] = {
        "schema": SCHEMA,
        "visits": [
            {"star": list(star), "arrive": arrive, "depart": depart}
            for star, arrive, depart in visits
        ],
    }
    experience = experience_from_data(data, keywords.pop("source", "experience"))
    return Experience(experience.visits, experience.source, **keywords)
