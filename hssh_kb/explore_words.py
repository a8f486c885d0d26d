"""Exploration in words: which way to leave, what the maps expect there, what is tied.

Source: ours.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Literal

from hssh_kb.explore import Expectation, Exploration, Suggestion
from hssh_kb.foresight import Foresight, Stand, View
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.place_graph import Edge, PlaceGraph
from hssh_kb.route_steps import describe_route, look_out
from hssh_kb.walks import Walk
from hssh_kb.wording import word_route, word_steps
from perception.star import Star

_NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine")
_ORDINALS = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth")
_LISTED_MAPS = 4


def word_way(star: Star, facing: int, dlp: int) -> str:
    """Say which way leads out along a dlp, to one who came in facing another.

    Examples
    --------
    >>> crossing = Star.parse(["a+1", "b+1", "a-1", "b-1"])
    >>> [word_way(crossing, 0, k) for k in range(4)]
    ['the way straight ahead', 'the way on the right', 'the way back', 'the way on the left']
    """
    if dlp == facing:
        return "the way straight ahead"
    if dlp == star.opposite(facing):
        return "the way back"
    outlook = look_out(star, facing)
    for side in ("left", "right"):
        openings = outlook.side(side)
        if dlp in openings and len(openings) == 1:
            return f"the way on the {side}"
        if dlp in openings:
            nth = _ORDINALS[min(openings.index(dlp), len(_ORDINALS) - 1)]
            return f"the {nth} way on the {side}, counted from straight ahead"
    return f"the dlp {star.dlps[dlp]}, which leads nowhere"


def word_view(star: Star, facing: int) -> str:
    """Say what a place looks like to one who comes in facing a dlp of its star.

    Examples
    --------
    >>> t = Star.parse(["a-0", "b+1", "a+1", "b-1"])
    >>> word_view(t, 0)
    'ways on to the left and right, none ahead'
    >>> word_view(t, 1)
    'ways on ahead and to the right'
    >>> word_view(Star.parse(["a-0", "a+1"]), 0)
    'a dead end'
    """
    outlook = look_out(star, facing)
    sides = []
    for side in ("left", "right"):
        count = len(outlook.side(side))
        if count:
            many = f" ({_NUMBERS[count] if count < len(_NUMBERS) else count})" if count > 1 else ""
            sides.append(f"{side}{many}")
    where = ["ahead"] if outlook.ahead else []
    where += [f"to the {_join(sides)}"] if sides else []
    if not where:
        return "a dead end"
    if outlook.ways_on == 1:
        return f"a way on {where[0]} only"
    return f"ways on {_join(where)}{'' if outlook.ahead else ', none ahead'}"


def tell_suggestion(
    graph: PlaceGraph, foresight: Foresight, walk: Walk, rank: int, tie: int, unit: str
) -> Suggestion:
    """Word one suggestion.

    Parameters
    ----------
    graph, foresight, walk : as in :func:`hssh_kb.walks.list_walks`.
    rank, tie : its place among the suggestions. unit : of lengths, "m" or "travels".
    """
    expects = tell_expectations(foresight, walk)
    kind: Literal["frontier", "revisit"] = "frontier" if walk.edge is None else "revisit"
    place = graph.places[walk.place]
    dlp = place.star.dlps[walk.dlp]
    way = word_way(place.star, walk.facing, walk.dlp)
    new = "never taken yet"
    if walk.edge is not None:
        new = f"taken before, to {graph.places[walk.edge.goal].title}"
        new += ", but a place may have gone unnoticed on it" * walk.edge.doubted
    length = _format_length(walk.length, unit)
    text = (
        f"Leave {place.title} by {way} as you come in ({dlp.path}{dlp.direction}, {new}); "
        f"{length} from here."
    )
    return Suggestion(
        rank,
        tie,
        kind,
        walk,
        walk.entropy_bits,
        walk.gain_bits,
        walk.rate_bits,
        expects,
        word_walk(graph, walk.way),
        text,
    )


def word_walk(graph: PlaceGraph, way: Sequence[Edge]) -> str:
    """Return route instructions along a way; empty for no way at all."""
    if not way:
        return ""
    start, goal = graph.places[way[0].start], graph.places[way[-1].goal]
    known = graph.believed_or_not
    steps = word_steps(describe_route(known, start, goal, way), known)
    return word_route(steps, known, [(edge.start, edge.goal) for edge in way if edge.doubted])


def tell_expectations(foresight: Foresight, walk: Walk) -> tuple[Expectation, ...]:
    """Say what each map expects at the end of a walk; maps that expect the same stand together."""
    groups: dict[View | str, list[int]] = {}
    stands = walk.forecast.stands
    for i, stand in enumerate(stands):
        if stand is not None:
            groups.setdefault(foresight.walkers[i].view(stand), []).append(i)
        else:
            groups.setdefault("parted" if i in walk.before.parted else "anything", []).append(i)
    told = list[Expectation]()
    for key, members in groups.items():
        numbers = tuple(i + 1 for i in members)
        who, many = word_maps(numbers), len(members) > 1
        if key == "anything":
            text = f"{who} {'know' if many else 'knows'} nothing of that way and may see anything"
            told.append(Expectation(numbers, "anything", (), (), text))
        elif key == "parted":
            text = f"{who} {'expect' if many else 'expects'} something else on the way already"
            told.append(Expectation(numbers, "parted", (), (), text))
        else:
            told.append(_tell_view(foresight, stands, members, numbers))
    return tuple(told)


def _tell_view(
    foresight: Foresight,
    stands: Sequence[Stand | None],
    members: Sequence[int],
    numbers: tuple[int, ...],
) -> Expectation:
    there = [(i, stand) for i in members if (stand := stands[i]) is not None]
    places = tuple(f"P{place}" for place in sorted({stand.place for _, stand in there}))
    i, stand = there[0]
    star = foresight.walkers[i].stars[stand.place]
    dlps = tuple(str(star.dlps[(stand.facing + k) % len(star)]) for k in range(len(star)))
    named = places[0] if len(places) == 1 else "a known place"
    verb = "expect" if len(members) > 1 else "expects"
    text = f"{word_maps(numbers)} {verb} {named}: {word_view(star, stand.facing)}"
    return Expectation(numbers, "view", places, dlps, text)


def word_maps(numbers: Sequence[int]) -> str:
    """Name maps by their numbers; many are counted.

    Examples
    --------
    >>> word_maps([2]), word_maps([1, 3]), word_maps([1, 2, 3, 4, 5, 6])
    ('map 2', 'maps 1 and 3', 'map 1 and 5 others')
    """
    if len(numbers) == 1:
        return f"map {numbers[0]}"
    if len(numbers) <= _LISTED_MAPS:
        return f"maps {_join([str(n) for n in numbers])}"
    return f"map {numbers[0]} and {len(numbers) - 1} others"


def tell_summary(found: Exploration, maps: Sequence[Hypothesis]) -> Exploration:
    """Return the answer with its summary in words."""
    count = len(maps)
    if count == 1:
        doubt = "There is one map and no rival to it"
    elif found.entropy_bits < 5e-4:
        doubt = f"Of {count} rival maps one is as good as certain"
    else:
        doubt = f"{count} rival maps; the doubt between them is {found.entropy_bits:.2f} bits"
    sentences = [f"{doubt}. The robot is at {found.graph.places[found.at].title}."]
    agenda = "the exploration agenda: ways never taken, nearest first."
    if found.used == "rehearsal":
        sentences.append(_tell_rehearsal(found, maps))
    elif found.used == "entropy":
        unit = "metre" if found.unit == "m" else "travel"
        sentences.append(f"First comes what is expected to remove most doubt per {unit}.")
    elif found.strategy == "agenda":
        sentences.append(f"This is {agenda}")
    else:
        if found.strategy == "rehearsal":
            sentences.append(
                "There is nothing to rehearse: no place was recognised from which ways are known."
            )
        elif count > 1:
            sentences.append("No observation within reach is expected to tell them apart.")
        sentences.append(f"So this is {agenda}")
    tie = found.suggestions[0].tie
    if tie > 1:
        sentences.append(f"The first {tie} tie{_name_merit(found)}.")
    if found.unreached:
        titles = [found.graph.places[label].title for label in found.unreached]
        listed = _join(titles) if len(titles) <= _LISTED_MAPS else f"{len(titles)} places"
        sentences.append(f"No known way leads from here to {listed}, where ways are unexplored.")
    return replace(found, text=" ".join(sentences))


def _tell_rehearsal(found: Exploration, maps: Sequence[Hypothesis]) -> str:
    v, lead = found.doubted or 0, maps[found.number - 1]
    title = found.graph.places[f"P{lead.visits[v]}"].title
    others = [
        i
        for i, h in enumerate(maps, 1)
        if (h.visits[v], h.offsets[v]) != (lead.visits[v], lead.offsets[v])
    ]
    who = f"{word_maps(others)} {'say' if len(others) > 1 else 'says'} otherwise" if others else ""
    return (
        f"In map {found.number} visit v{v} was to {title} again"
        f"{f', but {who}' if who else ', and no rival map says otherwise'}. To rehearse it, take a "
        f"way from {title} that was known before and come back: if something else is seen than "
        f"map {found.number} expects, v{v} was to another place."
    )


def _name_merit(found: Exploration) -> str:
    return {
        "entropy": f": they remove equally much doubt per {found.unit.removesuffix('s')}",
        "agenda": ": they are equally near; the sharpest turn is listed first",
        "rehearsal": ": they are expected to tell equally much",
    }[found.used]


def _format_length(length: float, unit: str) -> str:
    if unit == "m":
        return f"{length:.0f} m"
    count = round(length)
    return f"{count} travel{'s' * (count != 1)}"


def _join(words: Iterable[str]) -> str:
    listed = list(words)
    if len(listed) < 2:
        return "".join(listed)
    return f"{', '.join(listed[:-1])} and {listed[-1]}"
