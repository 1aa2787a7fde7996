# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Bags as a live run writes them, from messages of rosbags."""

from collections import namedtuple
from collections.abc import Callable, Container, Sequence
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from tactile_ros.evaluation.bag import BagContent, BagWriter, all_types, blank_message, read_bag
from tactile_ros.evaluation.bag import cdr_of as cdr
from tactile_ros.messages import fill_contacts, fill_header, fill_layout
from tactile_ros.nodes.contact_loop import ContactLoop
from tactile_ros.pipeline import Pipeline
from tactile_ros.types import ContactState, Frame, Layout

Truth = Callable[[int, Frame, Callable[..., None]], None]

TAXELS = 5
STEP_NS = 10_000_000
START_NS = 1_000_000_000
LIVE_STEP_NS = 20_000_000
UNKNOWN = (np.nan, np.nan, np.nan)
Message = namedtuple('Message', 'topic type_name log_ns data')


def new(name: str, **known: object) -> object:
    """Message by its short name, whose other fields are empty or zero."""
    kind = next(key for key in all_types().types if key.endswith(f'/msg/{name}'))
    message = blank_message(kind)
    for field, value in known.items():
        setattr(message, field, value)
    return message


def header(stamp_ns: int) -> object:
    made = new('Header')
    fill_header(made, stamp_ns, 'pad')
    return made


def xyz(name: str, values: Sequence[float]) -> object:
    return new(name, **dict(zip('xyz', map(float, values), strict=True)))


def frame(sequence: int, values: np.ndarray, stamp_ns: int) -> object:
    values = np.ravel(values).astype(np.float64)
    return new('TactileFrame', header=header(stamp_ns), sequence=sequence, values=values)


def layout(taxels: int = TAXELS) -> object:
    places = np.arange(taxels)[:, None] * [0.01, 0.0, 0.0]
    board = Layout(
        places, ('Bx', 'By', 'Bz'), 'T', rate_hz=100.0, sensor='reskin_board', serial='7'
    )
    message = new('TactileLayout')
    fill_layout(message, board, *(partial(new, n) for n in ('Point', 'Quaternion')))
    return message


def wrench(stamp_ns: int, force: Sequence[float], torque: Sequence[float] = UNKNOWN) -> object:
    parts = {'force': xyz('Vector3', force), 'torque': xyz('Vector3', torque)}
    return new('WrenchStamped', header=header(stamp_ns), wrench=new('Wrench', **parts))


def patch(position: Sequence[float] = UNKNOWN) -> object:
    return new('TactileContact', id=1, position=xyz('Point', position))


def contacts(
    sequence: int, stamp_ns: int, position: Sequence[float] = UNKNOWN,
    force: Sequence[float] = UNKNOWN,
) -> object:  # fmt: skip
    known = {
        'position': [position], 'contacts_position': [[position]], 'contacts_id': [[1]],
        'force': [force], 'in_contact': [1], 'valid': [True],
    }  # fmt: skip
    known = {name: np.asarray(value) for name, value in known.items()}
    message = new('TactileContacts', sequence=sequence)
    fill_contacts(message, ContactState.assemble(TAXELS, known), patch)
    message.header = header(stamp_ns)
    return message


class Bag(BagWriter):
    """Bag of messages that are not yet cdr_of."""

    def put(self, topic: str, message: object, log_ns: int = 0, latched: bool = False) -> None:
        self.write(topic, message.__msgtype__, log_ns, cdr(message), latched)


def record(
    path: Path, pipeline: Pipeline, frames: Sequence[Frame], tares: Container[int] = (),
    unseen: Container[int] = (), lost: Container[int] = (), truth: Truth | None = None,
) -> None:  # fmt: skip
    """Write the bag of a live run of frames, some unseen by the node or lost, with tares after."""
    at = iter(range(10**9, 10**12, LIVE_STEP_NS))
    now = [0]
    with Bag(path) as bag:

        def put(leaf: str, message: object, late_ns: int = 0) -> None:
            bag.put(f'/{leaf}', message, now[0] + late_ns)

        def put_frame(leaf: str, one: Frame) -> None:
            put(leaf, frame(one.sequence, one.values, one.stamp_ns))

        stage = ContactLoop(pipeline, 5, False, lambda one: put_frame('baseline', one))
        stage.reset()
        put('layout', layout())
        put('calibration', new('String', data=f'{{"sha256": "{pipeline.digest}"}}'))
        for i, one in enumerate(frames):
            now[0] = next(at)
            if truth is not None:
                truth(i, one, put)
            if i in lost:
                continue
            put_frame('frame', one)
            if i in unseen:
                continue
            message = contacts(one.sequence, one.stamp_ns)
            fill_contacts(message, stage.process([one])[0], patch)
            put('contacts', message, 5_000_000)
            if i in tares:
                stage.tare()


def write_bag(path: Path, n: int = 50, lost: tuple[int, ...] = ()) -> Path:
    """Write a bag of n frames with contacts and truth; frames in `lost` are left out."""
    rng = np.random.default_rng(7)
    with Bag(path) as bag:
        bag.put('/layout', layout(), START_NS, latched=True)
        digest = new('String', data=f'{"a" * 64} reskin_board position: ridge')
        bag.put('/calibration', digest, START_NS, latched=True)
        baseline = frame(0, np.full(15, 1e-6), 0)
        baseline.temperature_c, baseline.device_time_ns = 25.0 + np.arange(5), 8
        bag.put('/baseline', baseline, START_NS, latched=True)
        for k in range(n):
            stamp = START_NS + k * STEP_NS
            values = rng.normal(0.0, 1e-5, 15)
            if k not in lost:
                bag.put('/frame', frame(k, values, stamp), stamp + 1_000_000)
                spot = (values[0], values[1], np.nan)
                bag.put('/contacts', contacts(k, stamp, spot), stamp + 3_000_000)
            spot = (values[0] + 1e-6, values[1], np.nan)
            bag.put('/truth/contacts', contacts(k, 0, spot, (np.nan, np.nan, k)), stamp)
    return path


def read_all(path: Path) -> SimpleNamespace:
    """Read every message of a bag (topic, type, log time, data), and what is said about it."""
    content, messages = BagContent(), []

    def taker(topic: str, kind: str) -> Callable[[int, bytes], None]:
        return lambda log_ns, data: messages.append(Message(topic, kind, log_ns, data))

    for _ in read_bag(path, content, taker):
        pass
    return SimpleNamespace(messages=messages, **vars(content))
