"""Files that must not be overwritten: what a knowledge base was built from."""

from __future__ import annotations

from pathlib import Path

from hssh_kb.errors import InputError, UsageError
from perception.rosmap import load_yaml

_MOST_BYTES = 1 << 20


def spare_inputs(target: str | Path, knowledge: str | Path, source: str) -> None:
    """Refuse to write over the knowledge base, the file it was built from, or the image of a map.

    Parameters
    ----------
    target : the file to be written. knowledge : the file that was read.
    source : name of the input file that it was built from; "" if there was none.

    Raises
    ------
    UsageError : the target is one of them.
    """
    target, knowledge = Path(target), Path(knowledge)
    if not target.exists():
        return
    origins = [Path(source), knowledge.parent / Path(source).name] if source else []
    for path in (knowledge, *origins):
        if path.exists() and target.samefile(path):
            raise UsageError(f"{target}: is an input itself ({path}); choose another name with -o")
    for path in origins:
        image = _find_image(path)
        if image is not None and image.exists() and target.samefile(image):
            raise UsageError(
                f"{target}: is the image of the map {path}; choose another name with -o"
            )


def _find_image(sheet: Path) -> Path | None:
    """Return the image that the sheet of a map names; None if it is no such sheet."""
    if sheet.suffix.lower() not in (".yaml", ".yml") or not sheet.is_file():
        return None
    try:
        data = load_yaml(sheet, _MOST_BYTES)
    except InputError:
        return None
    name = data.get("image") if isinstance(data, dict) else None
    return sheet.parent / name if isinstance(name, str) else None
