"""Names and types of the topics of a bag that mean something to an evaluation."""

from __future__ import annotations

import re

FRAME = 'tactile_ros/msg/TactileFrame'
LAYOUT = 'tactile_ros/msg/TactileLayout'
CONTACTS = 'tactile_ros/msg/TactileContacts'
STRING = 'std_msgs/msg/String'
ROLES = {('frame', FRAME), ('baseline', FRAME), ('layout', LAYOUT), ('contacts', CONTACTS)}
ROLES |= {('calibration', STRING)}
_DIGEST = re.compile(rb'\b[0-9a-f]{64}\b')


def split_topic(topic: str) -> tuple[str, str]:
    """Namespace and last part of a topic."""
    space, _, leaf = topic.rpartition('/')
    return space, leaf


def ends_as(topic: str, name: str) -> bool:
    """Whether a topic is the named one, absolute or relative to some namespace."""
    return topic == name or (not name.startswith('/') and topic.endswith(f'/{name}'))


def is_frame(topic: str, kind: str) -> bool:
    """Whether a topic holds the frames of a sensor."""
    return split_topic(topic)[1] == 'frame' and kind == FRAME


def digests_in(text: bytes) -> list[str]:
    """SHA-256 values (hex) that a text names."""
    return [found.decode() for found in _DIGEST.findall(text)]
