"""Files that are whole or not there: written beside their place and renamed into it."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path


def write_beside(path: str | os.PathLike[str], data: bytes) -> Path:
    """Write a file so that no reader, and no interrupted program, ever sees half of it.

    It is on the disk when this returns: after a loss of power it is the new one or the old one.

    Parameters
    ----------
    path : path-like
        Of the file; its folder is made.
    data : bytes
        All of it.

    Returns
    -------
    Path
        Of the file.
    """
    target = Path(path)
    target.parent.mkdir(parents=True, exist_ok=True)
    beside = target.with_name(f'.{target.name}.{os.getpid()}.part')
    try:
        with beside.open('wb') as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        beside.replace(target)
        _keep_names(target.parent)
    finally:
        beside.unlink(missing_ok=True)
    return target


def _keep_names(folder: Path) -> None:
    """Let the names in a folder outlast a loss of power, where the file system can."""
    with suppress(OSError):
        opened = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(opened)
        finally:
            os.close(opened)
