"""Compressed chunks of an MCAP file, unpacked to no more than they announce."""

from __future__ import annotations

import io

from tactile_ros.errors import MissingPackageError, RecordingError
from tactile_ros.evaluation import container
from tactile_ros.evaluation.definitions import missing


def unpack(compression: str, data: bytes, size: int) -> bytes:
    """Records of a chunk, at most as long as it says.

    Raises
    ------
    RecordingError
        If the length is absurd or the compression unknown or damaged.
    MissingPackageError
        If the package for its compression is not installed.
    """
    if size > container.LARGEST_CHUNK:
        msg = f'it claims {size} bytes'
        raise RecordingError(msg)
    try:
        if compression == '':
            return data[:size]
        if compression == 'zstd':
            return _unzstd(data, size)
        if compression == 'lz4':
            return _unlz4(data, size)
    except (MissingPackageError, MemoryError):
        raise
    except Exception as err:
        msg = f'its {compression} data are damaged'
        raise RecordingError(msg) from err
    msg = f'its compression {compression[:20]!r} is not known'
    raise RecordingError(msg)


def _unzstd(data: bytes, size: int) -> bytes:
    """Unpack Zstandard data up to `size`, also of a cut frame."""
    try:
        import zstandard
    except ImportError as err:
        msg = 'zstandard'
        raise missing(msg, 'reading a bag compressed with zstd') from err
    unpacked: bytes = zstandard.ZstdDecompressor().stream_reader(io.BytesIO(data)).read(size)
    return unpacked


def _unlz4(data: bytes, size: int) -> bytes:
    """Unpack LZ4 data up to `size`, also of a cut frame."""
    try:
        from lz4.frame import LZ4FrameDecompressor
    except ImportError as err:
        msg = 'lz4'
        raise missing(msg, 'reading a bag compressed with lz4') from err
    unpacked: bytes = LZ4FrameDecompressor().decompress(data, max_length=size)
    return unpacked
