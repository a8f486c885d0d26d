"""Reading text and JSON files: what is wrong is said with file, line and column.

Source: ours.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from hssh_kb.errors import InputError


def read_text(path: str | Path, expected: str) -> str:
    """Read a file of UTF-8 text.

    Parameters
    ----------
    path : the file.
    expected : what it should be, such as ``"a trace (JSON, schema hssh.trace/1)"``.

    Raises
    ------
    InputError : missing, a directory, not UTF-8, or cannot be read.
    """
    path = Path(path)
    if path.is_dir():
        raise InputError(f"{path}: is a directory; give {expected}")
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; expected {expected}") from None
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: byte {error.start} is not UTF-8 text; expected {expected}"
        ) from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None


def parse_json(text: str, source: str, expected: str) -> Any:  # noqa: ANN401
    """Decode a JSON document.

    Raises
    ------
    InputError : empty, not JSON, or nested too deeply; ``source`` and ``expected`` are named.

    Examples
    --------
    >>> parse_json('[1,', "a", "")
    Traceback (most recent call last):
    perception.errors.InputError: a:1:4: not valid JSON (Expecting value); is the file complete?
    """
    if not text.strip():
        raise InputError(f"{source}: is empty; expected {expected}")
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        raise InputError(
            f"{source}:{error.lineno}:{error.colno}: not valid JSON ({error.msg}); "
            "is the file complete?"
        ) from None
    except ValueError as error:  # a number of too many digits
        raise InputError(f"{source}: not valid JSON ({error})") from None
    except RecursionError:
        raise InputError(f"{source}: JSON nested too deeply; expected {expected}") from None
