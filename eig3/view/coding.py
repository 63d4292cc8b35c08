"""Code arrays as compressed text, which the page decodes again.

Positions change little between frames. So they are rounded to integers, of which only the differences from a linear
prediction are stored: small numbers, which compress well. A page decodes them exactly.
"""

from __future__ import annotations

import base64
import zlib

import numpy as np

_LEVEL = 6  # of the compression: higher levels take several times as long for about 2 % less


def text_of(values: np.ndarray) -> str:
    """Return the bytes of an array, little endian, compressed, as base64."""
    data = np.ascontiguousarray(values).astype(values.dtype.newbyteorder("<"), copy=False)
    return base64.b64encode(zlib.compress(data.tobytes(), _LEVEL)).decode()


def rounded(x: np.ndarray, low: np.ndarray, size: np.ndarray, bits: int) -> np.ndarray:
    """Return positions, shape (frames, points, d), as integers: the number of a cell of the box of motion.

    The box has 2 ** bits cells along each axis. The centre of the cell is at most half a cell away from the position.
    """
    cells = 2**bits
    share = (x - low) / np.where(size > 0, size, 1.0)
    return np.asarray(np.clip(np.floor(share * cells), 0, cells - 1).astype(np.int32))


def differences(q: np.ndarray, bits: int) -> np.ndarray:
    """Return the bytes of integers, shape (frames, ...), as differences from a linear prediction.

    A difference d is taken modulo 2 ** bits and stored as 2 d or -2 d - 1. The low bytes of a frame are stored before
    its high bytes, most of which are 0.
    """
    first = np.concatenate([np.zeros_like(q[:1]), q])
    d = np.diff(first, axis=0)  # the first frame itself, then differences
    d[2:] = np.diff(d[1:], axis=0)
    half = 2 ** (bits - 1)
    d = (d + half) % (2 * half) - half
    unsigned = np.where(d >= 0, 2 * d, -2 * d - 1).astype(np.uint16).reshape(len(q), -1)
    if bits <= 8:
        return unsigned.astype(np.uint8)
    return np.concatenate([unsigned & 255, unsigned >> 8], axis=1).astype(np.uint8)
