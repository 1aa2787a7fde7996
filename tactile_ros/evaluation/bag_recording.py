"""A bag as recordings: frames by namespace, what was said about them, and what was true."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tactile_ros.errors import RecordingError
from tactile_ros.evaluation.bag_messages import Heard, decode
from tactile_ros.evaluation.bag_reader import read_bag
from tactile_ros.evaluation.class_changes import read_changes
from tactile_ros.evaluation.loaded import LiveContacts, Loaded, LoadedRecording
from tactile_ros.evaluation.topics import (
    CONTACTS,
    FRAME,
    ROLES,
    digests_in,
    ends_as,
    split_topic,
)
from tactile_ros.evaluation.truth_topics import (
    contacts_truth,
    is_truth_type,
    other_truth,
    unknown,
)
from tactile_ros.messages import read_contacts, read_frame, read_layout
from tactile_ros.types import STATE_FIELDS, ContactStates, Recording

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from tactile_ros.types import Frame, Integers, Layout


def load_bag(path: Path, layout: Layout | None, truth_topics: Sequence[str]) -> Loaded:
    """Recordings of every namespace of a bag that holds frames."""

    def wanted(topic: str, kind: str) -> bool:
        truth = is_truth_type(kind) and any(ends_as(topic, name) for name in truth_topics)
        return truth or (split_topic(topic)[1], kind) in ROLES

    content = read_bag(path, wanted)
    heard = decode(content)
    problems = list(content.problems)
    foreign = sorted(name for name, kind in content.types.items() if not wanted(name, kind))
    if foreign:
        problems.append(f'topics that are not ours were left out: {", ".join(foreign)}')
    frames = [t for t in heard if split_topic(t)[1] == 'frame' and content.types[t] == FRAME]
    if not frames:
        why = '; '.join(problems[:3]) or 'it is empty'
        msg = f'{path} holds no frames that could be read ({why})'
        raise RecordingError(msg)
    found = []
    for topic in sorted(frames):
        try:
            found.append(_sensor(topic, heard, layout, truth_topics, alone=len(frames) == 1))
        except RecordingError as err:
            problems.append(f'{topic} was left out: {err}')
    if not found:
        msg = f'{path}: {"; ".join(problems)}'
        raise RecordingError(msg)
    return Loaded(tuple(found), tuple(problems))


def _sensor(
    topic: str,
    heard: dict[str, list[Heard]],
    layout: Layout | None,
    truth_topics: Sequence[str],
    alone: bool,
) -> LoadedRecording:
    """Recording of one namespace."""
    space, _ = split_topic(topic)
    problems: list[str] = []
    place = _layout(heard.get(f'{space}/layout', []), layout, problems)
    frames = _frames(heard[topic], place, problems)
    recording = _recording(place, frames)
    index = {key: row for row, key in enumerate(_keys(recording))}
    truth, names = _truth(
        [
            (name, messages)
            for name, messages in heard.items()
            if any(ends_as(name, wanted) for wanted in truth_topics)
            and (alone or name.startswith(f'{space}/'))
        ],
        recording,
        index,
        problems,
    )
    live = _live(heard.get(f'{space}/contacts', []), place, index, problems)
    recording = recording if live is None else live.as_taken(recording)
    told = heard.get(f'{space}/calibration', [])
    digests = [d for m in told for d in _digests(m)]
    return LoadedRecording(
        space.strip('/') or 'sensor',
        replace(recording, truth=truth),
        live,
        tuple(_frames(heard.get(f'{space}/baseline', []), place, problems, 'baselines')),
        tuple(dict.fromkeys(digests)),
        read_changes(m.message.data for m in told),  # type: ignore[attr-defined]
        names,
        tuple(problems),
    )


def _digests(heard: Heard) -> list[str]:
    """SHA-256 values that a message of text names."""
    return digests_in(str(heard.message.data).encode())  # type: ignore[attr-defined]


def _layout(heard: list[Heard], fallback: Layout | None, problems: list[str]) -> Layout:
    """Layout of the bag, else the one that was passed."""
    found = []
    for item in heard:
        try:
            found.append(read_layout(item.message))  # type: ignore[arg-type]
        except ValueError as err:
            problems.append(f'a layout makes no sense: {err}')
    if found:
        return found[-1]
    if fallback is None:
        msg = 'its layout is not in the bag; name the sensor'
        raise RecordingError(msg)
    problems.append('its layout is not in the bag; that of the named sensor is used')
    return fallback


def _frames(
    heard: list[Heard], layout: Layout, problems: list[str], what: str = 'frames'
) -> list[Frame]:
    """Frames of messages; those of another shape are counted."""
    found, refused, reason = [], 0, ''
    for item in heard:
        try:
            found.append(read_frame(item.message, layout.shape))  # type: ignore[arg-type]
        except ValueError as err:
            refused, reason = refused + 1, str(err)
    if refused:
        problems.append(f'{refused} {what} were left out: {reason}')
    return found


def _recording(layout: Layout, frames: list[Frame]) -> Recording:
    """Frames as arrays; a new stream begins where the counter or the clock went back."""
    if not frames:
        msg = 'none of its frames fits its layout'
        raise RecordingError(msg)
    stamps = np.array([frame.stamp_ns or 0 for frame in frames], np.int64)
    sequence = np.array([frame.sequence for frame in frames]).astype(np.int64)
    back = (np.diff(stamps) <= 0) | (np.diff(sequence) <= 0)
    stream = np.concatenate([[0], np.cumsum(back)])
    blank_c = np.full(layout.shape[0], np.nan)
    blank_bits = np.zeros(layout.shape[0], np.uint8)
    chips = [f.temperature_c for f in frames]
    bits = [f.status for f in frames]
    known_c = any(c is not None for c in chips)
    known_bits = any(b is not None for b in bits)
    return Recording.from_arrays(
        layout,
        np.stack([frame.values for frame in frames]),
        stamp_ns=stamps,
        sequence=sequence,
        temperature_c=[blank_c if c is None else c for c in chips] if known_c else None,
        status=[blank_bits if b is None else b for b in bits] if known_bits else None,
        stream=stream,
    )


def _keys(recording: Recording) -> list[tuple[int, int]]:
    """Stamp (ns) and sequence of every frame: together they name it in its bag."""
    if recording.stamp_ns is None or recording.sequence is None:
        return []
    return list(zip(recording.stamp_ns.tolist(), recording.sequence.tolist(), strict=True))


def _live(
    heard: list[Heard], layout: Layout, index: dict[tuple[int, int], int], problems: list[str]
) -> LiveContacts | None:
    """Contacts of the live run beside the frames that they are about."""
    if not heard:
        return None
    arrays, logs = read_contact_arrays(heard, layout.shape[0], problems)
    keys = zip(arrays['stamp_ns'].tolist(), arrays['sequence'].tolist(), strict=True)
    rows = np.array([index.get(key, -1) for key in keys], np.int64)
    kept = rows >= 0
    if not kept.all():
        problems.append(f'{int((~kept).sum())} contacts are about frames that were not recorded')
    known = {name: arrays[name][kept] for name in STATE_FIELDS}
    states = ContactStates.assemble(int(kept.sum()), layout.shape[0], known)
    return LiveContacts(rows[kept], states, logs[kept], int((~kept).sum()))


def read_contact_arrays(
    heard: list[Heard], taxels: int, problems: list[str]
) -> tuple[dict[str, npt.NDArray[np.generic]], Integers]:
    """Arrays and log times of contacts; messages of another shape are left out and counted."""
    good = [h for h in heard if _fits(h, taxels)]
    if len(good) < len(heard):
        lost = len(heard) - len(good)
        problems.append(f'{lost} contacts do not fit a sensor of {taxels} taxels')
    arrays = read_contacts([h.message for h in good], taxels)  # type: ignore[misc]
    return arrays, np.array([h.log_ns for h in good], np.int64)


def _fits(heard: Heard, taxels: int) -> bool:
    """Whether the per-taxel fields of a contacts message have the length of the sensor."""
    fields = ('taxel_force', 'deformation', 'taxel_status')
    return all(len(getattr(heard.message, name)) in (0, taxels) for name in fields)


def _truth(
    topics: list[tuple[str, list[Heard]]],
    recording: Recording,
    index: dict[tuple[int, int], int],
    problems: list[str],
) -> tuple[dict[str, npt.NDArray[np.generic]], tuple[str, ...]]:
    """Truth of all topics beside the frames; a later topic fills what an earlier left unknown."""
    merged: dict[str, npt.NDArray[np.generic]] = {}
    names: tuple[str, ...] = ()
    for topic, messages in topics:
        if messages and messages[0].type_name == CONTACTS:
            arrays, _ = read_contact_arrays(messages, recording.layout.shape[0], problems)
            part, found = contacts_truth(arrays, recording, index)
            lost = int((~found).sum())
        else:
            part, names, lost = other_truth(messages, recording, names)
        if lost:
            problems.append(f'{lost} messages of {topic} belong to no frame')
        for key, value in part.items():
            known = merged.get(key, value)
            merged[key] = np.where(unknown(known), value, known)
    return merged, names
