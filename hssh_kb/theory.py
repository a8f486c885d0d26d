"""The theory as files: where the axioms lie, what each says, what each predicate means.

The logic itself is in ``axioms/``; nothing here or elsewhere in Python forbids a map. A copy of
one's own takes the place of the packaged files if the environment names it, or
:func:`use_axioms`.
"""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from hssh_kb.errors import InputError, InternalError, UsageError

_FIELD = re.compile(
    r"%\s*(?P<key>Number|Name|Title|Says|Source|Status|Reads|Derives):\s*(?P<text>.*)"
)
_MORE = re.compile(r"%\s{2,}(?P<text>\S.*)")
_PATHS, _PLACES, _READINGS = [("path", 2)], [("first", 1)], [("dear", 2)]
_LEVELS: dict[str, list[list[tuple[str, int]]]] = {
    "paths-then-places": [_PATHS, _PLACES, _READINGS],
    "places-then-paths": [_PLACES, _PATHS, _READINGS],
    "places-only": [_PLACES, _READINGS],
}
POLICIES = tuple(_LEVELS)
"""The preferences that ship, each in a file of ``axioms/policies``."""


@dataclass(frozen=True)
class Axiom:
    """One axiom: its place in the theory and its words.

    Attributes
    ----------
    number : 1 to 10 are the equations of Beeson, Modayil & Kuipers 2010, section 3.3.
    name : the constant that stands for it in the programs.
    title : a handful of words.
    text : the statement in words.
    source : document, section, equation.
    status : as published, adapted (why) or ours (why).
    file : name of the file in the axiom directory.
    reads : the predicates it judges.
    clauses : the heads by which it is violated, one a clause.
    arguments : the variables of each head; a letter stands for a sort.
    """

    number: int
    name: str
    title: str
    text: str
    source: str
    status: str
    file: str
    reads: tuple[str, ...]
    clauses: tuple[str, ...]
    arguments: Mapping[str, tuple[str, ...]] = field(default_factory=dict, compare=False)


ENVIRONMENT = "HSSH_AXIOMS"
"""The environment variable that names a directory of axioms of one's own."""
_chosen: list[Path] = []


@cache
def packaged_directory() -> Path:
    """Return the directory of the packaged ``.lp`` files: in the package, or in the checkout.

    Raises
    ------
    InternalError : the installation lacks them.
    """
    here = Path(__file__).resolve().parent
    for directory in (here / "axioms", here.parent / "axioms"):
        if (directory / "generate.lp").is_file():
            return directory
    raise InternalError(f"the axiom files are missing beside {here}; reinstall the package")


def use_axioms(directory: str | Path | None) -> None:
    """Use a copy of the axioms of one's own from now on; None for what is used by default.

    Raises
    ------
    InputError : it is no directory of axioms.
    """
    _chosen.clear()
    if directory is not None:
        _chosen.append(_check_directory(Path(directory), "--axioms"))


def axiom_directory() -> Path:
    """Return the directory of the ``.lp`` files in use.

    Raises
    ------
    InputError : the environment names what is no directory of axioms.
    """
    if _chosen:
        return _chosen[0]
    named = os.environ.get(ENVIRONMENT)
    return _check_directory(Path(named), ENVIRONMENT) if named else packaged_directory()


def _check_directory(directory: Path, told_by: str) -> Path:
    if not (directory / "generate.lp").is_file():
        raise InputError(
            f"{told_by}: {directory} is no directory of axioms (it lacks generate.lp); give a "
            f"copy of {packaged_directory()}"
        )
    return directory.resolve()


def read_program(name: str) -> str:
    """Return the text of one file of the axiom directory, named without ``.lp``.

    Raises
    ------
    InputError : a directory of one's own lacks it.
    """
    return _read_file(axiom_directory() / f"{name}.lp")


def _read_file(path: Path) -> str:
    try:
        if path.is_relative_to(packaged_directory()):
            return _read_text(path, 0, 0)
        about = path.stat()
        return _read_text(path, about.st_mtime_ns, about.st_size)
    except (OSError, UnicodeDecodeError) as error:
        told = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        if path.is_relative_to(packaged_directory()):
            raise InternalError(f"{path}: cannot be read ({told}); reinstall") from None
        raise InputError(
            f"{path}: cannot be read ({told}); take it from {packaged_directory()}"
        ) from None


@cache
def _read_text(path: Path, _time_ns: int, _size: int) -> str:
    """Read a file; one that was changed since is read anew."""
    return path.read_text(encoding="utf-8")


def read_programs(names: Iterable[str]) -> str:
    """Return the texts of several files as one program."""
    return "\n".join(read_program(name) for name in names)


def policy_program(policy: str) -> str:
    """Return the file name of a policy.

    Raises
    ------
    UsageError : no policy of that name ships.
    """
    if policy not in POLICIES:
        raise UsageError(f"no policy is called {policy!r}; there are {', '.join(POLICIES)}")
    return f"policies/{policy.replace('-', '_')}"


def policy_levels(policy: str) -> list[list[tuple[str, int]]]:
    """Return what a policy makes few: predicates (name, arity) by level, highest first."""
    policy_program(policy)
    return _LEVELS[policy]


def list_policies() -> dict[str, str]:
    """Return what each policy prefers, in words, from the first line of its file.

    Examples
    --------
    >>> list_policies()["places-only"]
    'fewest places, whatever the paths; then the dearest readings avoided.'
    """
    return {name: _first_comment(read_program(policy_program(name))) for name in POLICIES}


def _first_comment(text: str) -> str:
    return text.splitlines()[0].partition(": ")[2]


def list_axioms() -> tuple[Axiom, ...]:
    """Return all axioms by number, read from the headers of their files.

    Raises
    ------
    InputError : a file of one's own lacks the header.

    Examples
    --------
    >>> next(axiom.name for axiom in list_axioms() if axiom.number == 8)
    'order_irreflexive'
    """
    directory = axiom_directory()
    return _list_packaged() if directory == packaged_directory() else _list_files(directory)


@cache
def _list_packaged() -> tuple[Axiom, ...]:
    return _list_files(packaged_directory())


def _list_files(directory: Path) -> tuple[Axiom, ...]:
    files = sorted(directory.glob("[0-9][0-9]_*.lp"))
    axioms = [_parse_axiom(path, _read_file(path)) for path in files]
    return tuple(sorted(axioms, key=lambda axiom: axiom.number))


def find_axiom(name: str) -> Axiom:
    """Return the axiom of a name.

    Raises
    ------
    UsageError : there is none.
    """
    axioms = list_axioms()
    for axiom in axioms:
        if axiom.name == name:
            return axiom
    known = ", ".join(axiom.name for axiom in axioms)
    raise UsageError(f"no axiom is called {name!r}; there are {known}")


def axiom_program(name: str) -> str:
    """Return the file name, without ``.lp``, of an axiom."""
    return find_axiom(name).file.removesuffix(".lp")


def read_messages() -> dict[str, dict[str, str]]:
    """Return the sentences for violations: axiom, clause, template.

    Raises
    ------
    InputError : the file of one's own is no TOML.
    """
    path = axiom_directory() / "messages.toml"
    return _parse_messages(path, _read_file(path))


@cache
def _parse_messages(path: Path, text: str) -> dict[str, dict[str, str]]:
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: not valid TOML ({error})") from None


@cache
def _parse_axiom(path: Path, text: str) -> Axiom:
    fields: dict[str, str] = {}
    key = ""
    for line in text.splitlines():
        if match := _FIELD.match(line):
            key = match["key"]
            fields[key] = match["text"].strip()
        elif key and (match := _MORE.match(line)):
            fields[key] += " " + match["text"].strip()
        else:
            key = ""
            if not line.startswith("%"):
                break
    missing = {"Number", "Name", "Title", "Says", "Source", "Status", "Reads", "Derives"} - set(
        fields
    )
    if missing or not fields["Number"].isdigit():
        raise InputError(
            f"{path}: the header of an axiom needs a line '% Number: N' and such lines for "
            f"{', '.join(sorted(missing)) or 'the rest'}; the other axioms show how"
        )
    heads = re.findall(r"violation\(\w+, (\w+)(?:\(([^)]*)\))?\)", fields["Derives"])
    return Axiom(
        number=int(fields["Number"]),
        name=fields["Name"],
        title=fields["Title"],
        text=fields["Says"],
        source=fields["Source"],
        status=fields["Status"],
        file=path.name,
        reads=tuple(re.findall(r"\w+/\d+", fields["Reads"])),
        clauses=tuple(name for name, _ in heads),
        arguments={name: tuple(inside.split(",")) if inside else () for name, inside in heads},
    )
