"""One .npz of plain arrays: written atomically, read without trust.

Before anything is unpacked the directory of the file is capped, members are counted, their names
must fit a pattern and their stated sizes a cap. Members are unpacked to their stated size at most
and must be what that size allows: a plain header of numbers or text, and exactly its data.
"""

from __future__ import annotations

import io
import math
import os
import re
import struct
import zipfile
import zlib
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tactile_ros.calibration.beside import write_beside
from tactile_ros.calibration.tree import Arrays
from tactile_ros.errors import CalibrationError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

SCHEMA = 1
MOST_MEMBERS = 20_000
MOST_BYTES = 512 * 1024 * 1024
MOST_DIRECTORY_BYTES = 300 * MOST_MEMBERS
NAME = re.compile(r'[A-Za-z0-9_./ +\-]{1,200}\.npy')
PLAIN = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
# numpy.lib.format version 1.0, as numpy writes it: nothing is evaluated
HEADER = re.compile(
    rb"\x93NUMPY\x01\x00..\{'descr': '([<>|][biufU]\d{1,6})', 'fortran_order': (True|False), "
    rb"'shape': \((\d{0,18}(?:, \d{1,18})*),?\), \} *\n",
    re.DOTALL,
)
DAMAGE = (
    zipfile.BadZipFile, zlib.error, struct.error, OSError, EOFError, ValueError, TypeError,
    LookupError, RuntimeError, OverflowError, MemoryError,
)  # fmt: skip


def write(path: str | Path, arrays: Mapping[str, npt.NDArray[np.generic]]) -> None:
    """Write the arrays beside `path` and rename, so that no reader sees half a file.

    Parameters
    ----------
    path : str or Path
        Where the calibration goes (.npz).
    arrays : mapping of str to ndarray
        Numbers and text only.
    """
    buffer = io.BytesIO()
    np.savez_compressed(buffer, schema=np.array(SCHEMA), **dict(arrays))  # type: ignore[arg-type]
    write_beside(path, buffer.getvalue())


def read(path: str | Path) -> Arrays:
    """Read a calibration without trusting it.

    Parameters
    ----------
    path : str or Path
        A file written by `write`.

    Returns
    -------
    dict of str to ndarray
        Its members.

    Raises
    ------
    CalibrationError
        If the file is missing, damaged, too large, of another schema version, or holds anything
        but plain arrays.
    """
    target = Path(path)
    try:
        arrays = _members(target)
    except FileNotFoundError as error:
        msg = f'calibration {target} does not exist; make one with `tactile calibrate`'
        raise CalibrationError(msg) from error
    except DAMAGE as error:
        msg = f'calibration {target} cannot be read as plain arrays ({error}); calibrate again'
        raise CalibrationError(msg) from error
    version = arrays.pop('schema', np.zeros(0))
    if version.shape != () or version.dtype.kind not in 'iu' or version != SCHEMA:
        found = repr(version.tolist())[:40] if version.size else 'none'
        msg = f'calibration {target} must have schema {SCHEMA}; received {found}; calibrate again'
        raise CalibrationError(msg)
    return arrays


def _members(target: Path) -> Arrays:
    """Arrays of all members by name."""
    if target.exists() and not target.is_file():
        msg = 'it is no file'
        raise ValueError(msg)
    with target.open('rb') as file:
        _refuse_long_directory(file)
        with zipfile.ZipFile(file) as archive:
            listed = archive.infolist()
            _refuse_bombs(target, listed)
            arrays: Arrays = {}
            for member in listed:
                with archive.open(member) as stream:
                    # with a count: without one, all that lies behind the stated size is unpacked
                    content = stream.read(member.file_size)
                arrays[member.filename[: -len('.npy')]] = _array(content)
    return arrays


def _refuse_long_directory(file: io.BufferedReader) -> None:
    """Cap the directory by its last record, which zipfile would read in one go."""
    size = file.seek(0, os.SEEK_END)
    file.seek(max(size - 42, 0))
    tail = file.read(42).rjust(42, b'\0')
    length = struct.unpack('<I', tail[32:36])[0]
    if tail[20:24] != b'PK\x05\x06' or tail[:4] == b'PK\x06\x07':
        msg = 'it does not end as an .npz does'
        raise ValueError(msg)
    if length > MOST_DIRECTORY_BYTES:
        msg = f'its directory has {length} bytes'
        raise ValueError(msg)
    file.seek(0)


def _refuse_bombs(target: Path, listed: Sequence[zipfile.ZipInfo]) -> None:
    """Cap the count, the names and the unpacked size of members before unpacking any."""
    unpacked = sum(member.file_size for member in listed)
    if len(listed) > MOST_MEMBERS or unpacked > MOST_BYTES:
        msg = (
            f'calibration {target} must hold at most {MOST_MEMBERS} members and {MOST_BYTES} '
            f'bytes; received {len(listed)} and {unpacked}'
        )
        raise CalibrationError(msg)
    seen: set[str] = set()
    for member in listed:
        name = member.filename
        plain = NAME.fullmatch(name) and '..' not in name and not name.startswith('/')
        if not plain or name in seen or member.compress_type not in PLAIN:
            msg = f'calibration {target} holds a member named {name[:40]!r}; refused'
            raise CalibrationError(msg)
        seen.add(name)


def _array(content: bytes) -> npt.NDArray[np.generic]:
    """Array of one .npy member whose data are exactly as long as its header says."""
    match = HEADER.match(content)
    if match is None:
        msg = 'a member is no plain array of numbers or text'
        raise ValueError(msg)
    kind, major, lengths = match.groups()
    dtype = np.dtype(kind.decode())
    shape = tuple(int(n) for n in lengths.split(b',') if n)
    if dtype.itemsize == 0 or math.prod(shape) * dtype.itemsize != len(content) - match.end():
        msg = f'a member of shape {shape} holds {len(content) - match.end()} bytes'
        raise ValueError(msg)
    array: npt.NDArray[np.generic] = np.empty(shape, dtype, 'F' if major == b'True' else 'C')
    if array.size:
        array.reshape(-1, order='A')[:] = np.frombuffer(content, dtype, offset=match.end())
    return array
