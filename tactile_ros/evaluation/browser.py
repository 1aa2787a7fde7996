"""A headless browser, where there is one: pages and drawings as pictures."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from tactile_ros.calibration import write_beside
from tactile_ros.errors import MissingPackageError, TactileError

NAMES = ('chromium', 'chromium-browser', 'google-chrome', 'google-chrome-stable', 'chrome')
FLAGS: tuple[str, ...] = (
    '--headless', '--disable-gpu', '--disable-quic', '--no-first-run',
    '--disable-sync', '--disable-background-networking', '--disable-component-update',
    '--hide-scrollbars',
)  # fmt: skip
if hasattr(os, 'geteuid') and os.geteuid() == 0:
    FLAGS = (*FLAGS, '--no-sandbox')  # root, as in a container, has none
PATIENCE_S = 120.0
SCALE = 2  # pixels of a picture for each of the page


def find_browser() -> str:
    """Path of a browser.

    Raises
    ------
    MissingPackageError
        If there is none.
    """
    for name in NAMES:
        if found := shutil.which(name):
            return found
    msg = f'pictures need one of {", ".join(NAMES)} on the PATH; install chromium'
    raise MissingPackageError(msg)


def photograph(page: str, picture: Path, size: tuple[int, int]) -> Path:
    """Write what a page (HTML) looks like in a window (width, height) as PNG.

    Returns
    -------
    Path
        Of the picture.

    Raises
    ------
    MissingPackageError
        If there is no browser.
    TactileError
        If it wrote no picture.
    """
    browser = find_browser()
    picture.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        source = write_beside(Path(folder) / 'page.html', page.encode())
        command = [
            browser, *FLAGS, f'--user-data-dir={folder}/user', f'--screenshot={picture.resolve()}',
            f'--window-size={size[0]},{size[1]}', f'--force-device-scale-factor={SCALE}',
            source.as_uri(),
        ]  # fmt: skip
        try:
            done = subprocess.run(
                command, capture_output=True, text=True, timeout=PATIENCE_S, check=False
            )
        except subprocess.TimeoutExpired as error:
            msg = f'{browser} took more than {PATIENCE_S:g} s for {picture}'
            raise TactileError(msg) from error
    if done.returncode or not picture.is_file():
        msg = f'{browser} wrote no {picture}: code {done.returncode}'
        raise TactileError(msg)
    return picture
