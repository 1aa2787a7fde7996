"""Recordings as .npz of plain arrays: written for others to read, read without trust."""

from __future__ import annotations

import io
import math
import os
import struct
import zipfile
import zlib
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np
import numpy.typing as npt

from tactile_ros.calibration import HEADER, write_beside
from tactile_ros.errors import RecordingError
from tactile_ros.types import Layout, Recording

if TYPE_CHECKING:
    from tactile_ros.types import Array, Bools, Bytes, Integers

SCHEMA = 1
MOST_MEMBERS = 64
MOST_BYTES = 2 << 30
_COLUMNS = ('stamp_ns', 'sequence', 'temperature_c', 'status', 'stream', 'tare')
LONGEST_ENTRY = 300
END = struct.Struct('<4s6xHI6x')

Arrays = dict[str, npt.NDArray[np.generic]]


def save_recording(recording: Recording, path: str | os.PathLike[str]) -> None:
    """Write a recording with its layout and truth into one .npz.

    Parameters
    ----------
    recording : Recording
        Every array is kept as it is.
    path : path-like
        Of the file.
    """
    arrays: Arrays = {'recording_schema': np.array(SCHEMA), 'values': recording.values}
    for field in fields(Layout):
        value = getattr(recording.layout, field.name)
        if value is not None:
            arrays[f'layout_{field.name}'] = np.asarray(value)
    for name in _COLUMNS:
        if getattr(recording, name) is not None:
            arrays[name] = np.asarray(getattr(recording, name))
    arrays.update({f'truth_{key}': value for key, value in recording.truth.items()})
    save_arrays(arrays, path)


def save_arrays(arrays: Arrays, path: str | os.PathLike[str]) -> Path:
    """Write plain arrays into one .npz, whole or not at all."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)  # type: ignore[arg-type]
    return write_beside(path, buffer.getvalue())


def load_recording(path: str | os.PathLike[str]) -> Recording:
    """Read a recording that `save_recording` wrote.

    Parameters
    ----------
    path : path-like
        Of the file; it may be damaged or hostile.

    Returns
    -------
    Recording
        With its layout.

    Raises
    ------
    RecordingError
        If it is no such file, holds objects, or unpacks to more than is sensible.
    """
    file = Path(path)
    arrays = read_arrays(file)
    if arrays.get('recording_schema', np.array(0)).tolist() != SCHEMA:
        msg = f'{file} is no recording of tactile_ros (schema {SCHEMA})'
        raise RecordingError(msg)
    try:
        return _recording(arrays)
    except (ValueError, KeyError, TypeError, IndexError) as err:
        msg = f'{file} is no recording: {err}'
        raise RecordingError(msg) from err


def _recording(arrays: Arrays) -> Recording:
    """Put a recording together from its arrays."""

    def number(name: str) -> float:
        return float(cast('float', arrays[name].item()))

    def text(name: str) -> str:
        return str(arrays[name].item())

    layout = Layout(
        positions=cast('Array', arrays['layout_positions']),
        channels=tuple(str(name) for name in arrays['layout_channels']),
        unit=text('layout_unit'),
        rotations=cast('Array | None', arrays.get('layout_rotations')),
        saturation=cast('Array | None', arrays.get('layout_saturation')),
        rate_hz=number('layout_rate_hz'),
        frame_id=text('layout_frame_id'),
        sensor=text('layout_sensor'),
        serial=text('layout_serial'),
    )
    head = len('truth_')
    return Recording.from_arrays(
        layout,
        cast('Array', arrays['values']),
        stamp_ns=cast('Integers | None', arrays.get('stamp_ns')),
        sequence=cast('Integers | None', arrays.get('sequence')),
        temperature_c=cast('Array | None', arrays.get('temperature_c')),
        status=cast('Bytes | None', arrays.get('status')),
        stream=cast('Integers | None', arrays.get('stream')),
        tare=cast('Bools | None', arrays.get('tare')),
        truth={
            key[head:]: cast('Array', value)
            for key, value in arrays.items()
            if key.startswith('truth_')
        },
    )


def read_arrays(path: Path) -> Arrays:
    """Plain arrays of an .npz: counted, measured and typed before anything is unpacked.

    Raises
    ------
    RecordingError
        If there are too many members, too many bytes, objects, or damage.
    """
    try:
        _refuse_long_directory(path)
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            size = sum(member.file_size for member in members)
            if len(members) > MOST_MEMBERS or size > MOST_BYTES:
                msg = (
                    f'{path} unpacks to {len(members)} members of {size} bytes together; '
                    f'at most {MOST_MEMBERS} of {MOST_BYTES} bytes are read'
                )
                raise RecordingError(msg)
            return {
                member.filename[: -len('.npy')]: _read_member(archive, member)
                for member in members
                if member.filename.endswith('.npy')
            }
    except OSError as err:
        msg = f'{path} cannot be read: {err.strerror or err}'
        raise RecordingError(msg) from err
    except (zipfile.BadZipFile, ValueError, EOFError, NotImplementedError, RuntimeError) as err:
        msg = f'{path} is damaged: {err}'
        raise RecordingError(msg) from err
    except (MemoryError, zlib.error, SyntaxError, TypeError) as err:
        msg = f'{path} is damaged: {type(err).__name__}'
        raise RecordingError(msg) from err


def _refuse_long_directory(path: Path) -> None:
    """The last record must announce a short directory, which zipfile reads in one go."""
    with path.open('rb') as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(size - END.size, 0))
        last = file.read().ljust(END.size, b'\0')
    mark, members, length = END.unpack(last)
    if mark != b'PK\x05\x06':
        msg = 'it does not end as an .npz does'
        raise ValueError(msg)
    if members > MOST_MEMBERS or length > MOST_MEMBERS * LONGEST_ENTRY:
        msg = f'{path} lists {members} members; at most {MOST_MEMBERS} are read'
        raise RecordingError(msg)


def _read_member(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> npt.NDArray[np.generic]:
    """One array; its header must be plain and announce exactly the bytes that follow."""
    with archive.open(member) as file:
        # with a count: without one, all that lies behind the stated size is unpacked
        content = file.read(member.file_size)
    match = HEADER.match(content)
    if match is None:
        msg = f'{member.filename} holds objects or no plain array'
        raise ValueError(msg)
    kind, by_column, lengths = match.groups()
    dtype = np.dtype(kind.decode())
    shape = tuple(int(n) for n in lengths.split(b',') if n)
    count = math.prod(shape)
    if count * dtype.itemsize != len(content) - match.end():
        msg = f'{member.filename} announces {shape}, which does not fit its size'
        raise ValueError(msg)
    flat = np.frombuffer(content, dtype, offset=match.end()) if count else np.zeros(0, dtype)
    return flat.reshape(shape, order='F' if by_column == b'True' else 'C')
