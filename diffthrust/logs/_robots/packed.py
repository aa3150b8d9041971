"""Count the unpacked size of a bag's chunks before its reader unpacks each at once."""

from __future__ import annotations

import struct
import sys
from bz2 import BZ2File
from collections.abc import Callable, Iterator
from importlib import import_module
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

from diffthrust.logs._kinds import BAG_1, MCAP, kind_of
from diffthrust.logs._untrusted import MemoryBudget

_CHUNK_MCAP, _CHUNK_1 = 0x06, 0x05
_PIECE = 2**20
"""Bytes that are unpacked at a time."""
_DENSE = 50
"""No real log packs better than this ratio; whatever exceeds it counts against the limit."""

Chunk = tuple[str, BinaryIO, int]
"""Its compression, a stream at its first byte, and its length."""


def check_unpacked(path: Path) -> None:
    """Raise InputError if a bag, a file or a folder, does not fit in memory once unpacked.

    A chunk counts, and the excess of implausibly dense chunks together.
    """
    budget = MemoryBudget(path)
    for packing, stream, length in _chunks(path):
        unpacker, most, size = _unpacker(packing), budget.remaining, 0
        if unpacker is None:
            continue
        if length > most:
            budget.take(length)
        for piece in _pieces(unpacker, stream.read(length)):
            size += piece
            if size > most:
                budget.take(size)
        # Only the implausible excess adds up over chunks: a long bag may well be larger than the
        # limit, for its reader unpacks one chunk at a time.
        budget.take(max(0, size - _DENSE * length))


def _chunks(path: Path) -> Iterator[Chunk]:
    for file in sorted(path.iterdir()) if path.is_dir() else [path]:
        if not file.is_file():
            continue
        with file.open("rb") as stream:
            end = file.stat().st_size
            if file.suffix == ".zstd":
                yield "zstd", stream, end
            elif stream.read(8) == MCAP.begins[0]:
                yield from _mcap_chunks(stream, end)
            elif kind_of(file) is BAG_1:
                yield from _bag_1_chunks(stream, end)


def _mcap_chunks(stream: BinaryIO, end: int) -> Iterator[Chunk]:
    while (at := stream.tell()) + 9 <= end:
        kind, length = struct.unpack("<BQ", stream.read(9))
        # Start and end time, size and checksum (28 bytes), then the length of the compression's
        # name.
        head = stream.read(32) if kind == _CHUNK_MCAP and length >= 40 else b""
        if len(head) == 32:
            words = struct.unpack_from("<I", head, 28)[0]
            packing = stream.read(min(words, 16)).decode("latin-1")
            packed = stream.read(8)
            if len(packed) == 8:
                yield packing, stream, min(struct.unpack("<Q", packed)[0], end - stream.tell())
        if at + 9 + length > end:  # cut off: its reader reports it
            return
        stream.seek(at + 9 + length)


def _bag_1_chunks(stream: BinaryIO, end: int) -> Iterator[Chunk]:
    stream.seek(len("#ROSBAG V2.0\n"))
    while (at := stream.tell()) + 4 <= end:
        size = struct.unpack("<I", stream.read(4))[0]
        if at + 8 + size > end:
            return
        header, fields, place = stream.read(size), {}, 0
        while place + 4 <= size:
            length = struct.unpack_from("<I", header, place)[0]
            name, _, value = header[place + 4 : place + 4 + length].partition(b"=")
            fields[name] = value
            place += 4 + length
        length = struct.unpack("<I", stream.read(4))[0]
        begin = stream.tell()
        if fields.get(b"op") == bytes([_CHUNK_1]):
            packing = fields.get(b"compression", b"").decode("latin-1")
            yield packing, stream, min(length, end - begin)
        stream.seek(begin + length)


def _pieces(unpacker: Callable[[BinaryIO], BinaryIO], packed: bytes) -> Iterator[int]:
    """Unpack a chunk, of any number of frames; yields the size of each piece."""
    try:
        with unpacker(BytesIO(packed)) as unpacked:
            while piece := unpacked.read(_PIECE):
                yield len(piece)
    except Exception:  # damaged: its reader reports it
        return


def _unpacker(packing: str) -> Any:
    """What opens a packed file, of the libraries that rosbags needs; None if there is none."""
    if packing == "bz2":
        return BZ2File
    if packing == "lz4":
        from lz4.frame import LZ4FrameFile

        return LZ4FrameFile
    if packing == "zstd":
        built_in = sys.version_info >= (3, 14)  # part of the standard library since then
        return import_module("compression.zstd" if built_in else "backports.zstd").ZstdFile
    return None
