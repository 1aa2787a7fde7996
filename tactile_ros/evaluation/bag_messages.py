"""Serialised messages of a bag as objects; what cannot be decoded is counted by topic."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, NamedTuple

from tactile_ros.evaluation.definitions import PACKAGE, all_types, same_fields, split_name

if TYPE_CHECKING:
    from tactile_ros.evaluation.bag_reader import BagContent


class Heard(NamedTuple):
    """One decoded message with its type and log time (ns)."""

    message: object
    type_name: str
    log_ns: int


def decode(content: BagContent) -> dict[str, list[Heard]]:
    """Messages of every topic that was read.

    Parameters
    ----------
    content : BagContent
        Its problems grow by what cannot be decoded, and by types of another version.

    Returns
    -------
    dict of str to list of Heard
        In the order of the bag.

    Raises
    ------
    MissingPackageError
        If rosbags is not installed.
    """
    store = all_types()
    refused = _other_versions(content)
    heard: dict[str, list[Heard]] = {}
    failed: Counter[str] = Counter()
    for topic, type_name, log_ns, data in content.messages:
        if type_name in refused:
            continue
        try:
            message = store.deserialize_cdr(data, type_name)
        except Exception:
            failed[topic] += 1
            continue
        heard.setdefault(topic, []).append(Heard(message, type_name, log_ns))
    content.problems += [f'{n} messages of {topic} are damaged' for topic, n in failed.items()]
    return heard


def _other_versions(content: BagContent) -> set[str]:
    """Our types whose fields in the bag are not those of this version."""
    refused = set()
    for type_name, text in content.texts.items():
        if split_name(type_name)[0] == PACKAGE and not same_fields(type_name, text):
            refused.add(type_name)
            content.problems.append(f'{type_name} of the bag is of another version; left out')
    return refused
