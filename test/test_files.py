# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Files of the user: whole or not at all, never through a link; yaml without trust."""

import os
import socket
import time
from pathlib import Path

import pytest

from tactile_ros import files
from tactile_ros.errors import TactileError
from tactile_ros.files import UNFINISHED, read_yaml, write_atomically


def test_write_atomically_is_whole_or_not_at_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_atomically(tmp_path / 'deep' / 'a.json', b'old')
    os.umask(mask := os.umask(0o022))
    assert path.stat().st_mode & 0o777 == 0o666 & ~mask

    def full(*_: object) -> None:
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr(os, 'fsync', full)
    with pytest.raises(OSError, match='No space'):
        write_atomically(path, b'new')
    assert path.read_bytes() == b'old'
    assert [one.name for one in path.parent.iterdir()] == ['a.json']
    assert not UNFINISHED


def test_write_atomically_refuses_what_is_no_plain_file(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / 'pipe')
    (tmp_path / 'link').symlink_to(tmp_path / 'elsewhere')
    (tmp_path / 'folder').mkdir()
    with socket.socket(socket.AF_UNIX) as one:
        one.bind(str(tmp_path / 'socket'))
    for kind in ('pipe', 'link', 'folder', 'socket'):
        with pytest.raises(TactileError, match=f'{kind} is a {kind}; name a plain file'):
            write_atomically(tmp_path / kind, b'x')
    with pytest.raises(TactileError, match='/dev/null is a device'):
        write_atomically('/dev/null', b'x')
    assert not (tmp_path / 'elsewhere').exists()


def test_write_atomically_does_not_follow_a_planted_link(tmp_path: Path) -> None:
    victim = tmp_path / 'victim'
    victim.write_bytes(b'mine')
    (tmp_path / f'.a.json.{os.getpid()}.part').symlink_to(victim)
    write_atomically(tmp_path / 'a.json', b'x')
    assert victim.read_bytes() == b'mine'


def test_the_mark_of_a_file_is_in_its_head(tmp_path: Path) -> None:
    (tmp_path / 'a').write_bytes(b'x' * files.HEAD + b'mark')
    with pytest.raises(TactileError, match='another kind'):
        files.refuse_misfit(tmp_path / 'a', b'mark')


BOMB = 'a: &a [x,x,x,x,x,x,x,x,x]\n' + ''.join(
    f'{new}: &{new} [{",".join([f"*{old}"] * 9)}]\n'
    for old, new in zip('abcdefg', 'bcdefgh', strict=True)
)


@pytest.mark.parametrize(
    'text',
    [
        BOMB, 'a: &a [*a]', '[' * 50_000, 'x' * 1_000_001, 'a: !!python/name:os.system', '{',
        b'\xff',
    ],
    ids=['aliases', 'loop', 'deep', 'long', 'code', 'broken', 'bytes'],
)  # fmt: skip
def test_read_yaml_refuses_at_once(text: str | bytes) -> None:
    began = time.process_time()
    with pytest.raises(ValueError, match='no plain yaml'):
        read_yaml(text)
    assert time.process_time() - began < 10.0


def test_read_yaml_takes_as_many_nodes_as_it_says(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, 'MOST_YAML_NODES', 1000)
    assert read_yaml('a: &x [1, 2]\nb: *x\n') == {'a': [1, 2], 'b': [1, 2]}
    assert read_yaml('') is None
    text = '[' + '1,' * 998 + ']'
    assert len(read_yaml(text)) == 998
    with pytest.raises(ValueError, match='more than'):
        read_yaml(text.replace('[', '[1,1,'))
