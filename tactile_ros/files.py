# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Files of the user: written whole or not at all, and yaml read without trust."""

from __future__ import annotations

import os
import secrets
import shutil
import stat
import tempfile
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

import yaml

from tactile_ros.errors import TactileError

if TYPE_CHECKING:
    from collections.abc import Iterator

KINDS = (
    (stat.S_ISDIR, 'a folder'), (stat.S_ISLNK, 'a link'), (stat.S_ISFIFO, 'a pipe'),
    (stat.S_ISCHR, 'a device'), (stat.S_ISBLK, 'a device'), (stat.S_ISSOCK, 'a socket'),
)  # fmt: skip
UNFINISHED: set[str] = set()  # files under way, removed where a program is interrupted
LOADER = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)  # the same in C, where it was built
HEAD = 4096  # bytes, in which every file of this package has its mark
MOST_YAML_BYTES, MOST_YAML_NODES = 1_000_000, 100_000
MOST_YAML_DEPTH = 100  # of lists in lists; thousands would end the parser, and Python with it


def write_atomically(path: str | os.PathLike[str], data: bytes) -> Path:
    """Write a file so that no reader, and no interrupted program, ever sees half of it.

    It is on the disk when this returns: after a loss of power it is the new one or the old one.
    Its folder is made. Raises TactileError where `path` is there and no plain file: a link, a
    device, a pipe.
    """
    target = Path(path)
    refuse_special(target)
    target.parent.mkdir(parents=True, exist_ok=True)
    name = str(target.parent / f'.{target.name}.{secrets.token_hex(8)}.part')
    UNFINISHED.add(name)
    try:
        with Path(name).open('xb') as file:  # a new file, and no link
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        Path(name).replace(target)
        with suppress(OSError):  # the name outlasts a loss of power where the file system can
            folder = os.open(target.parent, os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)
    finally:
        Path(name).unlink(missing_ok=True)
        UNFINISHED.discard(name)
    return target


@contextmanager
def temporary_folder(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Give the place of a folder to make, which gets the name `path` once it is whole.

    Raises TactileError where something has that name already.
    """
    target = Path(path)
    if os.path.lexists(target):
        msg = f'{target} exists already; name a folder that does not'
        raise TactileError(msg)
    target.parent.mkdir(parents=True, exist_ok=True)
    part = tempfile.mkdtemp('.part', f'.{target.name}.', target.parent)
    UNFINISHED.add(part)
    try:
        fresh = Path(part, target.name)
        yield fresh
        fresh.rename(target)
    finally:
        shutil.rmtree(part, ignore_errors=True)
        UNFINISHED.discard(part)


def refuse_special(path: Path) -> None:
    """Raise TactileError where something other than a plain file has that name."""
    try:
        kind = path.lstat().st_mode
    except OSError:  # nothing is there, or nothing can be: writing says why
        return
    if not stat.S_ISREG(kind):
        found = next((word for is_such, word in KINDS if is_such(kind)), 'no plain file')
        msg = f'{path} is {found}; name a plain file or a new one'
        raise TactileError(msg)


def refuse_misfit(path: Path, mark: bytes) -> None:
    """Raise TactileError where a file is there without the mark of those that replace it."""
    if path.is_file() and path.stat().st_size and not has_mark(path, mark):
        msg = f'{path} is a file of another kind; name another one, or give a command --overwrite'
        raise TactileError(msg)


def has_mark(path: Path, mark: bytes) -> bool:
    """Tell whether a file begins as those that hold the mark, the rest of it unread."""
    with path.open('rb') as file:
        return mark in file.read(HEAD)


def read_yaml(text: str | bytes) -> object:
    """Plain yaml of at most a million bytes and, with its aliases expanded, 100 000 nodes.

    Raises ValueError with one sentence.
    """
    if len(text) > MOST_YAML_BYTES:
        msg = f'no plain yaml: at most {MOST_YAML_BYTES} bytes are read, not {len(text)}'
        raise ValueError(msg)
    try:
        depth = 0
        for event in yaml.parse(text, LOADER):
            depth += isinstance(event, yaml.CollectionStartEvent)
            depth -= isinstance(event, yaml.CollectionEndEvent)
            if depth > MOST_YAML_DEPTH:
                msg = f'no plain yaml: more than {MOST_YAML_DEPTH} lists in one another'
                raise ValueError(msg)
        loader = LOADER(text)
        node = loader.get_single_node()
        if _expanded(node, {}) > MOST_YAML_NODES:
            msg = f'no plain yaml: more than {MOST_YAML_NODES} nodes, aliases expanded'
            raise ValueError(msg)
        return None if node is None else loader.construct_document(node)
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        msg = f'no plain yaml: {str(error).splitlines()[0]}'
        raise ValueError(msg) from error


def _expanded(node: yaml.Node | None, counts: dict[int, int]) -> int:
    """Nodes below and with a node, every alias counted as what it stands for."""
    if node is None or isinstance(node, yaml.ScalarNode):
        return 1
    if id(node) not in counts:
        counts[id(node)] = MOST_YAML_NODES  # of a node inside itself
        below = node.value if isinstance(node, yaml.SequenceNode) else sum(node.value, ())
        counts[id(node)] = 1 + sum(_expanded(child, counts) for child in below)
    return counts[id(node)]
