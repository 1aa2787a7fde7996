"""Files that are whole or not there: written beside their place and renamed into it."""

from __future__ import annotations

import os
from pathlib import Path


def write_beside(path: str | os.PathLike[str], data: bytes) -> Path:
    """Write a file so that no reader, and no interrupted program, ever sees half of it.

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
        beside.write_bytes(data)
        beside.replace(target)
    finally:
        beside.unlink(missing_ok=True)
    return target
