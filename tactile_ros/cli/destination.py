"""Where a command writes: refused before long work, not after it."""

from __future__ import annotations

import tempfile
from typing import TYPE_CHECKING

from tactile_ros.errors import TactileError
from tactile_ros.evaluation.browser import find_browser

if TYPE_CHECKING:
    from pathlib import Path


def refuse_unwritable(path: Path) -> None:
    """Refuse a file or new folder that could not be written at the end; nothing is made or left.

    Raises
    ------
    TactileError
        With the system's reason, or where `path` is a folder.
    """
    try:
        if path.is_dir():
            msg = f'{path} is a folder; name a file in it'
            raise TactileError(msg)
        folder = next(place for place in path.absolute().parents if place.exists())
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        msg = f'{path} cannot be written: {error.strerror}; name another place'
        raise TactileError(msg) from error


def refuse_no_pictures(folder: Path) -> None:
    """Refuse a folder of pictures that could not be made or written, before the work.

    Raises
    ------
    TactileError
        With the system's reason, or where there is no browser.
    """
    find_browser()
    refuse_unwritable(folder / 'picture.png')
