"""Files that are never half: written beside their target, then moved over it in one step."""

from __future__ import annotations

import contextlib
import os
import secrets
from collections.abc import Iterator
from pathlib import Path

from perception.errors import InputError

_SUFFIX = ".part"


@contextlib.contextmanager
def replace_file(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Give the path of a temporary file that becomes ``path`` if the block ends well.

    A kill at any moment leaves the old file or the new one. A temporary file that a killed
    process left behind is removed the next time the same target is written.

    Raises
    ------
    InputError : the folder does not exist, or it cannot be written to.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     target = Path(folder, "answer.txt")
    ...     with replace_file(target) as temporary:
    ...         _ = temporary.write_text("42")
    ...     target.read_text(), len(list(Path(folder).iterdir()))
    ('42', 1)
    """
    path = Path(path)
    if path.is_dir():
        raise InputError(f"{path}: is a directory; give the name of a file to write")
    if not path.parent.is_dir():
        raise InputError(
            f"{path}: cannot be written, no such folder; make it first, or write elsewhere"
        )
    remove_leftovers(path)
    temporary = path.parent / f".{path.name}.{os.getpid()}.{secrets.token_hex(4)}{_SUFFIX}"
    try:
        try:
            yield temporary
            _sync(temporary)
            temporary.replace(path)
            _sync(path.parent)
        except PermissionError as error:
            where = error.filename or path
            raise InputError(f"{where}: cannot be written ({error.strerror})") from None
        except OSError as error:
            raise InputError(f"{path}: cannot be written ({error.strerror or error})") from None
    finally:
        temporary.unlink(missing_ok=True)


def write_atomically(path: str | os.PathLike[str], data: bytes) -> None:
    """Write a file so that at any moment the old one or the whole new one stands at ``path``.

    Raises
    ------
    InputError : the folder is missing or cannot be written to.
    """
    with replace_file(path) as temporary:
        temporary.write_bytes(data)


def remove_leftovers(path: Path) -> None:
    """Remove temporary files of ``path`` whose writer is no longer alive."""
    for leftover in path.parent.glob(f".{_glob_escape(path.name)}.*{_SUFFIX}"):
        pid = leftover.name.removeprefix(f".{path.name}.").split(".")[0]
        if pid.isdecimal() and not _is_alive(int(pid)):
            leftover.unlink(missing_ok=True)


def _glob_escape(name: str) -> str:
    return "".join(f"[{c}]" if c in "*?[" else c for c in name)


def _is_alive(pid: int) -> bool:
    if os.name != "posix":
        return True  # elsewhere signal 0 is no harmless question
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        return True
    return True


def _sync(path: Path) -> None:
    """Push a file, or the entries of a folder, to the disk."""
    if path.is_dir() and os.name != "posix":
        return
    handle = os.open(path, os.O_RDONLY)
    try:
        with contextlib.suppress(OSError):
            os.fsync(handle)
    finally:
        os.close(handle)
