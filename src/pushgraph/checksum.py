"""Checksums that end a file: a line with the CRC-32 of all bytes before it.

HDF5 ignores what follows its own bytes, and cuts it off where it changes a file: files that other programs changed, or
made, have no checksum.
"""

import os
import zlib
from pathlib import Path

_MARK = b"\npushgraph crc32 "
_LENGTH = len(_MARK) + 9
_CHUNK = 1 << 18


def checksum_line(content: bytes) -> bytes:
    """What to append to this content."""
    return _line(zlib.crc32(content))


def is_intact(path: Path) -> bool | None:
    """Whether a file's bytes are those that its checksum was made of; None if it has no checksum."""
    with path.open("rb", buffering=0) as file:
        start = max(file.seek(0, os.SEEK_END) - _LENGTH, 0)
        file.seek(start)
        end = file.read(_LENGTH)
        before, mark, _ = end.partition(_MARK)
        if not mark:
            return None
        left, value, chunk = start + len(before), 0, memoryview(bytearray(_CHUNK))
        file.seek(0)
        while left and (count := file.readinto(chunk[:left])):
            value = zlib.crc32(chunk[:count], value)
            left -= count
    return end[len(before) :] == _line(value)


def _line(value: int) -> bytes:
    return _MARK + b"%08x\n" % value
