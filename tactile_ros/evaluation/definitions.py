"""Message definitions: where the .msg files are, their concatenated text, and a codec for bags.

A bag carries the text of every type that it holds (ros2msg: the definition, then the definitions
that it needs, parted by a line of 80 equal signs), so that a reader without our package opens it.
"""

from __future__ import annotations

import os
import re
import sys
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from tactile_ros.errors import MissingPackageError, RecordingError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rosbags.typesys.store import Typestore

PACKAGE = 'tactile_ros'
_RULE = '=' * 80
_FIELD = re.compile(r'^([A-Za-z][\w/]*)(<=\d+)?(\[[^\]]*\])?\s+[A-Za-z]\w*(\s|=|$)')
_PRIMITIVE = re.compile(r'bool|byte|char|w?string|float(32|64)|u?int(8|16|32|64)')


def missing(package: str, purpose: str) -> MissingPackageError:
    """One sentence for an optional package that is not installed."""
    return MissingPackageError(f'{purpose} needs {package}: pip install {package}')


def message_folder() -> Path:
    """Folder of our .msg files, beside the source or in the share of an installation.

    Raises
    ------
    RecordingError
        If neither is there.
    """
    here = Path(__file__).resolve()
    places = [folder / 'msg' for folder in here.parents[2:3]]
    places += [folder / 'share' / PACKAGE / 'msg' for folder in here.parents[2:8]]
    places += [folder / PACKAGE / 'msg' for folder in _share_folders()]
    for place in places:
        if (place / 'TactileFrame.msg').is_file():
            return place
    msg = 'the message definitions of tactile_ros (TactileFrame.msg) were not found; reinstall it'
    raise RecordingError(msg)


def _share_folders() -> Iterator[Path]:
    """Where ROS installations and environments keep what their packages share."""
    for prefix in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep):
        if prefix:
            yield Path(prefix) / 'share'
    yield Path(sys.prefix) / 'share'


def split_name(type_name: str) -> tuple[str, str]:
    """Package and message of `std_msgs/msg/Header` or `std_msgs/Header`."""
    parts = type_name.split('/')
    return parts[0], parts[-1]


@lru_cache(maxsize=256)
def definition(type_name: str) -> str:
    """Text of one .msg file: ours, of a ROS installation, else as rosbags knows it.

    Raises
    ------
    MissingPackageError
        If the type is not ours, no ROS is there, and rosbags is not installed.
    RecordingError
        If nobody knows the type.
    """
    package, name = split_name(type_name)
    ours = [message_folder().parent.parent] if package == PACKAGE else []
    files = [message_folder() / f'{name}.msg'] if ours else []
    files += [folder / package / 'msg' / f'{name}.msg' for folder in _share_folders()]
    for file in files:
        if file.is_file():
            return file.read_text(encoding='utf-8')
    return _known_to_rosbags(f'{package}/msg/{name}')


def _known_to_rosbags(type_name: str) -> str:
    """Definition of a standard type as rosbags holds it, without those that it needs."""
    try:
        text = standard_types().generate_msgdef(type_name, ros_version=2)[0]
    except KeyError as err:
        msg = f'no definition of message type {type_name!r} was found'
        raise RecordingError(msg) from err
    return text.split(_RULE)[0]


def needed_types(type_name: str, text: str) -> list[str]:
    """Types of the fields of a definition, primitives left out."""
    package, _ = split_name(type_name)
    found = []
    for line in text.splitlines():
        match = _FIELD.match(line.split('#')[0].strip())
        if match and not _PRIMITIVE.fullmatch(match[1]):
            field = 'std_msgs/Header' if match[1] == 'Header' else match[1]
            found.append('/'.join(split_name(field if '/' in field else f'{package}/{field}')))
    return list(dict.fromkeys(found))


@lru_cache(maxsize=256)
def schema_text(type_name: str) -> str:
    """Concatenated ros2msg text of a type and all that it needs.

    Parameters
    ----------
    type_name : str
        Such as 'tactile_ros/msg/TactileFrame'.

    Returns
    -------
    str
        The definition first, the others in order of appearance.
    """
    parts = [definition(type_name).rstrip()]
    waiting = needed_types(type_name, parts[0])
    done: set[str] = set()
    while waiting:
        name = waiting.pop(0)
        if name not in done:
            done.add(name)
            text = definition(name).rstrip()
            parts += [_RULE, f'MSG: {name}', text]
            waiting += needed_types(name, text)
    return '\n'.join(parts) + '\n'


def same_fields(type_name: str, text: str) -> bool:
    """Whether a bag's own text of a type has the fields that ours has, comments aside."""
    return _fields(text.split(_RULE, maxsplit=1)[0]) == _fields(definition(type_name))


def _fields(text: str) -> list[str]:
    """Field lines of a definition without comments, constants, package names and spaces."""
    lines = (line.split('#')[0].strip() for line in text.splitlines())
    kept = [line.split() for line in lines if _FIELD.match(line) and '=' not in line]
    return [f'{split_name(words[0])[1]} {words[1]}' for words in kept]


@lru_cache(maxsize=1)
def standard_types() -> Typestore:
    """Codec of the standard ROS 2 types.

    Raises
    ------
    MissingPackageError
        If rosbags is not installed.
    """
    try:
        from rosbags.typesys import Stores, get_typestore
    except ImportError as err:
        msg = 'rosbags'
        raise missing(msg, 'reading the messages of a bag') from err
    return get_typestore(Stores.LATEST)


@lru_cache(maxsize=1)
def all_types() -> Typestore:
    """Codec of the standard types and of our own, registered from msg/*.msg.

    Returns
    -------
    Typestore
        With `deserialize_cdr(data, type_name)` and `serialize_cdr(message, type_name)`.
    """
    store = standard_types()
    from rosbags.typesys import get_types_from_msg

    found = {}
    for file in sorted(message_folder().glob('*.msg')):
        found.update(get_types_from_msg(file.read_text('utf-8'), f'{PACKAGE}/msg/{file.stem}'))
    known = store.fielddefs
    store.register({name: fields for name, fields in found.items() if name not in known})
    return store
