"""Reading files: compression is found by content."""

from __future__ import annotations

import bz2
import gzip
import lzma
import os
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

from perception.errors import InputError

_CHUNK_BYTES = 1 << 20
_LIMIT_BYTES = 2 << 30
_OPENERS: tuple[tuple[bytes, str, Callable[[IO[bytes]], Any]], ...] = (
    (b"\x1f\x8b", "gzip", lambda raw: gzip.GzipFile(fileobj=raw)),
    (b"\xfd7zXZ\x00", "xz", lzma.LZMAFile),
    (b"BZh", "bzip2", bz2.BZ2File),
)


def read_bytes(path: str | os.PathLike[str]) -> bytes:
    """Read a whole file, unpacking gzip, xz and bzip2, which are told by content, not by name.

    Raises
    ------
    InputError : missing, a directory, unreadable, empty, or packed data that are cut off or
        damaged; the message says how far reading came.
    """
    path = Path(path)
    if path.is_dir():
        raise InputError(f"{path}: is a directory, expected a file; name the file inside it")
    try:
        with path.open("rb") as raw:
            head = raw.read(8)
            raw.seek(0)
            for magic, name, opener in _OPENERS:
                if head.startswith(magic):
                    return _unpack(opener(raw), path, name)
            size = os.fstat(raw.fileno()).st_size
            data = raw.read(min(size, _LIMIT_BYTES) + 1)
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file; check the name") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from error
    if not data:
        raise InputError(f"{path}: the file is empty (0 bytes); record or copy it again")
    return _check_size(data, path)


def _unpack(stream: Any, path: Path, name: str) -> bytes:  # noqa: ANN401
    """Read a decompressing stream to its end, or say where it broke."""
    parts: list[bytes] = []
    size = 0
    try:
        while chunk := stream.read(_CHUNK_BYTES):
            parts.append(chunk)
            size += len(chunk)
            if size > _LIMIT_BYTES:
                break
    except (EOFError, OSError, lzma.LZMAError, zlib.error, ValueError) as error:
        line = 1 + sum(part.count(b"\n") for part in parts)
        raise InputError(
            f"{path}: the {name} data are cut off or damaged after byte {size} of the unpacked "
            f"text (line {line}); copy or download the file again"
        ) from error
    if not size:
        raise InputError(f"{path}: the {name} file holds 0 bytes; record or copy it again")
    return _check_size(b"".join(parts), path)


def _check_size(data: bytes, path: Path) -> bytes:
    if len(data) > _LIMIT_BYTES:
        raise InputError(
            f"{path}: more than {_LIMIT_BYTES >> 30} GiB of text, which is beyond what is read "
            "at once; split the log"
        )
    return data


def looks_like_json(path: str | Path) -> bool:
    """Tell a trace from a log by its first visible character; False if it cannot be read."""
    try:
        with Path(path).open("rb") as file:
            head = file.read(4096).removeprefix(b"\xef\xbb\xbf").lstrip()
    except OSError:
        return False
    return head[:1] in (b"{", b"[")
