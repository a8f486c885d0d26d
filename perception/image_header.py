"""What an image file says of itself before it is decoded: its size, its levels, its end.

A decoder believes the header and takes the memory it asks for, and some draw what is left of a
damaged file without a word. So size and wholeness are looked at first.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass

_PNG = b"\x89PNG\r\n\x1a\n"
_PNM = re.compile(
    rb"P(?P<kind>[1-6])(?:\s|#[^\n]*\n)+(?P<w>\d+)(?:\s|#[^\n]*\n)+(?P<h>\d+)"
    rb"(?:(?:\s|#[^\n]*\n)+(?P<most>\d+))?"
)
_JPEG_SIZES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}
_JPEG_BARE = {0x01, *range(0xD0, 0xD8)}


@dataclass(frozen=True)
class ImageHeader:
    """What the header of an image file says.

    Attributes
    ----------
    kind : ``"png"``, ``"pnm"``, ``"jpeg"``, ``"bmp"``, ``"tiff"``, ``"webp"`` or ``"gif"``.
    width, height : in cells.
    most_level : the level that stands for white, where the format lets the file choose it.
    """

    kind: str
    width: int
    height: int
    most_level: int | None = None


def read_image_header(data: bytes) -> ImageHeader | None:
    r"""Read the header of an image; None if there is none of a known kind.

    Parameters
    ----------
    data : the file, or its first 64 kB (of JPEG and TIFF files the header may lie deeper).

    Examples
    --------
    >>> read_image_header(b"P5 # made by hand\n3 2\n255\n......")
    ImageHeader(kind='pnm', width=3, height=2, most_level=255)
    >>> read_image_header(b"no image") is None
    True
    """
    for magic, read in _READERS:
        if data.startswith(magic):
            try:
                return read(data)
            except (struct.error, IndexError, KeyError):
                return None
    return None


def find_damage(data: bytes, header: ImageHeader) -> str | None:
    """Tell what is wrong with the body of an image file, as far as its format shows; else None."""
    if header.kind == "png":
        return _check_png(data)
    if header.kind == "jpeg" and b"\xff\xd9" not in data[-4096:]:
        return "it ends before its end marker"
    if header.kind == "bmp" and len(data) < struct.unpack("<I", data[2:6])[0]:
        return "it is shorter than its header says"
    return None


def _check_png(data: bytes) -> str | None:
    place = len(_PNG)
    while place + 12 <= len(data):
        (length,) = struct.unpack(">I", data[place : place + 4])
        end = place + 8 + length
        if end + 4 > len(data):
            break
        if zlib.crc32(data[place + 4 : end]) != struct.unpack(">I", data[end : end + 4])[0]:
            return f"its bytes {place} to {end + 4} are damaged (wrong checksum)"
        if data[place + 4 : place + 8] == b"IEND":
            return None
        place = end + 4
    return f"it is cut off after {len(data)} bytes"


def _read_png(data: bytes) -> ImageHeader:
    width, height = struct.unpack(">II", data[16:24])
    return ImageHeader("png", width, height)


def _read_pnm(data: bytes) -> ImageHeader | None:
    match = _PNM.match(data[:65536])
    if match is None:
        return None
    most = 1 if match["kind"] in b"14" else int(match["most"] or 255)
    return ImageHeader("pnm", int(match["w"]), int(match["h"]), most)


def _read_jpeg(data: bytes) -> ImageHeader | None:
    place = 2
    while place + 4 <= len(data):
        if data[place] != 0xFF:
            return None
        marker = data[place + 1]
        if marker == 0xFF:
            place += 1
        elif marker in _JPEG_BARE:
            place += 2
        elif marker in _JPEG_SIZES:
            height, width = struct.unpack(">HH", data[place + 5 : place + 9])
            return ImageHeader("jpeg", width, height)
        else:
            place += 2 + struct.unpack(">H", data[place + 2 : place + 4])[0]
    return None


def _read_bmp(data: bytes) -> ImageHeader:
    if struct.unpack("<I", data[14:18])[0] == 12:
        width, height = struct.unpack("<HH", data[18:22])
    else:
        width, height = struct.unpack("<ii", data[18:26])
    return ImageHeader("bmp", abs(width), abs(height))


def _read_tiff(data: bytes) -> ImageHeader:
    order = "<" if data[:2] == b"II" else ">"
    (place,) = struct.unpack(order + "I", data[4:8])
    (count,) = struct.unpack(order + "H", data[place : place + 2])
    found = dict[int, int]()
    for k in range(count):
        entry = data[place + 2 + 12 * k : place + 14 + 12 * k]
        tag, kind = struct.unpack(order + "HH", entry[:4])
        if tag in (256, 257):
            layout = {3: "H", 4: "I"}[kind]
            (found[tag],) = struct.unpack(order + layout, entry[8 : 8 + struct.calcsize(layout)])
    return ImageHeader("tiff", found[256], found[257])


def _read_webp(data: bytes) -> ImageHeader | None:
    if data[8:12] != b"WEBP":
        return None
    if data[12:16] == b"VP8X":
        width = int.from_bytes(data[24:27], "little") + 1
        height = int.from_bytes(data[27:30], "little") + 1
    elif data[12:16] == b"VP8L":
        (bits,) = struct.unpack("<I", data[21:25])
        width, height = (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    else:
        width, height = (side & 0x3FFF for side in struct.unpack("<HH", data[26:30]))
    return ImageHeader("webp", width, height)


def _read_gif(data: bytes) -> ImageHeader:
    width, height = struct.unpack("<HH", data[6:10])
    return ImageHeader("gif", width, height)


_READERS: tuple[tuple[bytes, Callable[[bytes], ImageHeader | None]], ...] = (
    (_PNG, _read_png),
    *((b"P%d" % kind, _read_pnm) for kind in range(1, 7)),
    (b"\xff\xd8", _read_jpeg),
    (b"BM", _read_bmp),
    (b"II*\x00", _read_tiff),
    (b"MM\x00*", _read_tiff),
    (b"RIFF", _read_webp),
    (b"GIF8", _read_gif),
)
