"""Unpacked size of a binary file, found before it is unpacked: a gigabyte of zeros is a megabyte of zlib, and an HDF5
dataset that was never written takes no room.

Datasets whose samples lie in other files are refused: a recording must not name files that its reader never chose.
"""

import io
import math
import zlib
from typing import Any, Literal

import numpy as np

from deatwin.plant.errors import DataError
from deatwin.plant.files.formats.optional import require
from deatwin.plant.safe_read import RECORDING_BYTES, clipped, in_words

_MOST_PACKED = 1032  # Largest number of bytes that zlib unpacks from one (RFC 1951: 258 bytes from 2 bits)
_PIECE = 1 << 20
_HEAD = 64  # Number of bytes at the start of an array that include its flags
_COMPRESSED = 15  # Type of a compressed element
_INTEGERS = (5, 6)  # Types of elements that hold dimensions
_OF_ARRAYS = (1, 2, 3)  # Classes of arrays whose entries are arrays: cell, struct, object
_TYPES = frozenset({1, 2, 3, 4, 5, 6, 7, 9, 12, 13, 14, 15, 16, 17, 18})  # Types that an element may have
_ARRAY = 14  # Type of an element that is an array
_CLASSES = range(1, 16)  # Classes of arrays that are read: no functions, nor classes that MathWorks does not describe
_COMPLEX = 0x0800  # Flag of an array with an imaginary part
_ORDERS: dict[bytes, Literal["little", "big"]] = {b"IM": "little", b"MI": "big"}


def too_much(path: str, count: float) -> DataError:
    """Return an error for a file that unpacks to more than can be read."""
    most = in_words(RECORDING_BYTES)
    return DataError(f"{path}: it unpacks to {in_words(count)} or more; at most {most} can be read")


class Metered(io.BytesIO):
    """A file that counts the bytes read from it, because a header may name the same samples many times."""

    def __init__(self, content: bytes, path: str) -> None:
        super().__init__(content)
        self._path, self._read = path, 0
        self._most = 3 * len(content) + 1_000_000  # headers are read twice, and samples may be, too

    def read(self, size: int | None = -1, /) -> bytes:
        """Return the next bytes, unless too many have been read."""
        found = super().read(size)
        self._read += len(found)
        if self._read > self._most:
            raise DataError(f"{self._path}: it declares more samples than it holds; it is damaged")
        return found


def require_plain_hdf5(file: Any, path: str) -> None:
    """Refuse an HDF5 file that unpacks to too much, or whose samples lie in other files."""
    h5py, count = require("h5py", path), 0

    def look(name: str, link: Any) -> DataError | None:
        nonlocal count
        if isinstance(link, h5py.ExternalLink):
            return _elsewhere(path, name)
        if isinstance(link, h5py.SoftLink):
            return None
        node = file[name]
        if not isinstance(node, h5py.Dataset) or node.shape is None:
            return None
        if node.is_virtual or node.external:
            return _elsewhere(path, name)
        size = node.dtype.itemsize
        chunk = size
        for length in node.chunks or ():
            chunk *= length
        for length in node.shape:
            size *= length
        count += max(size, chunk)
        return too_much(path, count) if count > RECORDING_BYTES else None

    if fault := file.visititems_links(look):  # returned, because HDF5 loses exceptions raised inside
        raise fault


def _elsewhere(path: str, name: str) -> DataError:
    return DataError(f'{path}: "{clipped(name)}" lies in another file; a recording must hold its samples itself')


def require_sound_level_5(content: bytes, path: str) -> None:
    """Refuse a MATLAB file of version 5 that unpacks to too much, or has more entries than it holds."""
    order: Literal["little", "big"] | None = _ORDERS.get(content[126:128])
    if order is None:
        return  # version 4, or not a MATLAB file
    surely_small = len(content) * _MOST_PACKED <= RECORDING_BYTES
    count, place = 0, 128
    while place + 8 <= len(content):
        kind, size = (int.from_bytes(content[k : k + 4], order) for k in (place, place + 4))
        held = content[place + 8 : place + 8 + size]
        if kind == _COMPRESSED:
            if not surely_small:
                count += _unpacked_size(held, count, path)
            head = zlib.decompressobj().decompress(held, _HEAD)
            flags = int.from_bytes(head[16:20], order)
            whole = flags & _COMPLEX or _of_structs(head[8:], order)
            held = zlib.decompressobj().decompress(held, RECORDING_BYTES if whole else _PIECE)[8:]
        if _of_structs(held, order):
            _require_entries(held, order, path)
        _require_types(held, order, path)
        place += 8 + size


def _require_types(matrix: bytes, order: Literal["little", "big"], path: str) -> None:
    """Raise an error for an array with unknown element types, for which SciPy would read beyond its table."""
    place = 0
    if int.from_bytes(matrix[8:12], order) & 0xFF not in _CLASSES:
        return
    while place + 8 <= len(matrix):
        kind, size = (int.from_bytes(matrix[k : k + 4], order) for k in (place, place + 4))
        # Up to four bytes of data may lie in the tag itself.
        begin, place = place + 8, place + 8 + (0 if kind >> 16 else -(-size // 8) * 8)
        if kind & 0xFFFF not in _TYPES:
            raise DataError(f"{path}: no element can be of type {kind & 0xFFFF}; it is damaged")
        if kind == _ARRAY:
            _require_types(matrix[begin : begin + size], order, path)


def _unpacked_size(packed: bytes, before: int, path: str) -> int:
    """Return the unpacked size of an element in bytes, found piece by piece without storing it."""
    count, stream = 0, zlib.decompressobj()
    while packed and not stream.eof:
        count += len(stream.decompress(packed, _PIECE))
        packed = stream.unconsumed_tail
        if before + count > RECORDING_BYTES:
            raise too_much(path, before + count)
    return count


def _of_structs(matrix: bytes, order: Literal["little", "big"]) -> bool:
    """Return whether an array contains arrays, from the class in its flags, which follow their own tag."""
    return int.from_bytes(matrix[8:12], order) & 0xFF in _OF_ARRAYS


def _require_entries(matrix: bytes, order: Literal["little", "big"], path: str) -> None:
    """Raise an error for cells and structs that declare more entries than fit, because SciPy allocates them."""
    words = np.frombuffer(matrix[: len(matrix) // 4 * 4], dtype="<u4" if order == "little" else ">u4")
    flags, kinds, sizes = words[:-4:2] & 0xFF, words[2:-2:2], words[3:-1:2]
    fitting = np.isin(flags, _OF_ARRAYS) & np.isin(kinds, _INTEGERS) & (sizes % 4 == 0) & (sizes >= 8) & (sizes <= 256)
    for place in np.flatnonzero(fitting).tolist():
        lengths = words[2 * place + 4 : 2 * place + 4 + int(sizes[place]) // 4]
        if math.prod(lengths.tolist()) * 8 > len(matrix):
            raise DataError(f"{path}: it declares more entries of a cell or struct than it holds; it is damaged")
