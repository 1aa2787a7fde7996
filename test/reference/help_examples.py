"""Examples of every command's --help, as a reader would type them."""

from __future__ import annotations

import importlib

from tactile_ros.cli.main import COMMANDS


def examples() -> list[str]:
    """Lines below 'example:'; each command has some."""
    found = []
    for name in COMMANDS:
        text = importlib.import_module(f'tactile_ros.cli.{name}').__doc__ or ''
        _, _, below = text.partition('example:\n')
        assert below.strip(), f'tactile {name} --help has no example'
        found += [line.strip() for line in below.splitlines() if line.strip()]
    return found
