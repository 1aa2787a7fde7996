# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Bags as a live run writes them, from messages of rosbags."""

from __future__ import annotations

from array import array
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tactile_ros.evaluation.bag import BagWriter, all_types
from tactile_ros.messages import fill_contacts
from tactile_ros.nodes.contact_loop import ContactLoop

if TYPE_CHECKING:
    from collections.abc import Callable, Container, Sequence
    from pathlib import Path

    from tactile_ros.pipeline import Pipeline
    from tactile_ros.types import Frame

    Truth = Callable[[int, Frame, Callable[..., None]], None]

TAXELS = 5
STEP_NS = 10_000_000
START_NS = 1_000_000_000
LIVE_STEP_NS = 20_000_000
UNKNOWN = (np.nan, np.nan, np.nan)


class MessageMaker:
    """Serialised messages of one small sensor."""

    def __init__(self) -> None:
        self.store = all_types()

    def new(self, name: str, fill: float = 0.0, **known: object) -> object:
        """Message whose other fields are empty, zero, or numbers of some value."""
        kind = next(key for key in self.store.types if key.endswith(f'/msg/{name}'))
        fields = self.store.fielddefs[kind][1]
        blank = {f: self._blank(fill, *what) for f, what in fields if f not in known}
        return self.store.types[kind](**blank, **known)

    def _blank(self, fill: float, kind: int, what: object) -> object:
        if kind == 2:
            return self.new(what.rpartition('/')[2], fill)
        if kind == 1:
            number = np.dtype(what[0] if what[0] != 'string' else 'U')
            return number.type(fill if number.kind == 'f' else 0).item() if number.itemsize else ''
        (inner, name), count = what
        if inner != 1 or name[0] == 'string':
            return []
        return np.full(count, fill if 'float' in name[0] else 0, name[0])

    def header(self, stamp_ns: int) -> object:
        second, rest = divmod(stamp_ns, 1_000_000_000)
        return self.new('Header', stamp=self.new('Time', sec=second, nanosec=rest), frame_id='pad')

    def cdr(self, message: object) -> bytes:
        """CDR of a message, whose arrays may be those that rclpy takes."""
        for name, value in vars(message).items():
            if isinstance(value, array):
                setattr(message, name, np.array(value))
        return bytes(self.store.serialize_cdr(message, message.__msgtype__))

    def xyz(self, name: str, values: Sequence[float]) -> object:
        return self.new(name, **dict(zip('xyz', map(float, values), strict=True)))

    def frame(self, sequence: int, values: np.ndarray, stamp_ns: int) -> object:
        values = np.ravel(values).astype(np.float64)
        return self.new(
            'TactileFrame', header=self.header(stamp_ns), sequence=sequence, values=values,
            valid=True,
        )  # fmt: skip

    def layout(self, taxels: int = TAXELS) -> object:
        turn = self.new('Quaternion', w=1.0)
        return self.new(
            'TactileLayout', sensor='reskin_board', serial='7', unit='T',
            channels=['Bx', 'By', 'Bz'], orientations=[turn] * taxels,
            positions=[self.xyz('Point', (0.01 * i, 0, 0)) for i in range(taxels)],
            saturation=np.full(3, np.inf), rate_hz=100.0,
        )  # fmt: skip

    def wrench(
        self, stamp_ns: int, force: Sequence[float], torque: Sequence[float] = UNKNOWN
    ) -> object:
        parts = {'force': self.xyz('Vector3', force), 'torque': self.xyz('Vector3', torque)}
        wrench = self.new('Wrench', **parts)
        return self.new('WrenchStamped', header=self.header(stamp_ns), wrench=wrench)

    def patch(self, position: Sequence[float] = UNKNOWN) -> object:
        return self.new('TactileContact', np.nan, id=1, position=self.xyz('Point', position))

    def contacts(
        self,
        sequence: int,
        stamp_ns: int,
        position: Sequence[float] = UNKNOWN,
        force: Sequence[float] = UNKNOWN,
    ) -> object:
        none = dict.fromkeys(('cell', 'label', 'slip', 'symmetry', 'session', 'repetition'), -1)
        wrench = self.new('Wrench', np.nan, force=self.xyz('Vector3', force))
        return self.new(
            'TactileContacts', np.nan, header=self.header(stamp_ns), sequence=sequence, valid=True,
            in_contact=1, contacts=[self.patch(position)], wrench=wrench, **none,
        )  # fmt: skip


class MadeBag(BagWriter):
    """Bag of messages that are not yet serialised."""

    def __init__(self, path: Path, make: MessageMaker) -> None:
        super().__init__(path)
        self.make = make

    def put(self, topic: str, message: object, log_ns: int = 0, latched: bool = False) -> None:
        self.write(topic, message.__msgtype__, log_ns, self.make.cdr(message), latched)


def record(
    made: MadeBag, pipeline: Pipeline, frames: Sequence[Frame], tares: Container[int] = (),
    unseen: Container[int] = (), lost: Container[int] = (), truth: Truth | None = None,
) -> None:  # fmt: skip
    """Write the bag of a live run of frames, some unseen by the node or lost, with tares after."""
    make, at = made.make, iter(range(10**9, 10**12, LIVE_STEP_NS))
    now = [0]
    with made as bag:

        def put(leaf: str, message: object, late_ns: int = 0) -> None:
            bag.put(f'/{leaf}', message, now[0] + late_ns)

        def put_frame(leaf: str, frame: Frame) -> None:
            put(leaf, make.frame(frame.sequence, frame.values, frame.stamp_ns))

        stage = ContactLoop(pipeline, 5, False, lambda frame: put_frame('baseline', frame))
        stage.reset()
        put('layout', make.layout())
        put('calibration', make.new('String', data=f'{{"sha256": "{pipeline.digest}"}}'))
        for i, frame in enumerate(frames):
            now[0] = next(at)
            if truth is not None:
                truth(i, frame, put)
            if i in lost:
                continue
            put_frame('frame', frame)
            if i in unseen:
                continue
            message = make.contacts(frame.sequence, frame.stamp_ns)
            fill_contacts(message, stage.process([frame])[0], make.patch)
            put('contacts', message, 5_000_000)
            if i in tares:
                stage.tare()


@pytest.fixture(scope='session')
def record_live() -> Callable[..., None]:
    """Function `record`."""
    return record


@pytest.fixture(scope='session')
def make() -> MessageMaker:
    return MessageMaker()


@pytest.fixture(scope='session')
def open_bag(make: MessageMaker) -> Callable[[Path], MadeBag]:
    return lambda path: MadeBag(path, make)


@pytest.fixture(scope='session')
def write_bag(make: MessageMaker) -> Callable[..., Path]:
    """Writer of a bag of n frames with contacts and truth; frames in `lost` are left out."""

    def write(path: Path, n: int = 50, lost: tuple[int, ...] = ()) -> Path:
        rng = np.random.default_rng(7)
        with MadeBag(path, make) as bag:
            bag.put('/layout', make.layout(), START_NS, latched=True)
            digest = make.new('String', data=f'{"a" * 64} reskin_board position: ridge')
            bag.put('/calibration', digest, START_NS, latched=True)
            baseline = make.frame(0, np.full(15, 1e-6), 0)
            baseline.temperature_c, baseline.device_time_ns = 25.0 + np.arange(5), 8
            bag.put('/baseline', baseline, START_NS, latched=True)
            for k in range(n):
                stamp = START_NS + k * STEP_NS
                values = rng.normal(0.0, 1e-5, 15)
                if k not in lost:
                    bag.put('/frame', make.frame(k, values, stamp), stamp + 1_000_000)
                    spot = (values[0], values[1], np.nan)
                    bag.put('/contacts', make.contacts(k, stamp, spot), stamp + 3_000_000)
                spot = (values[0] + 1e-6, values[1], np.nan)
                bag.put('/truth/contacts', make.contacts(k, 0, spot, (np.nan, np.nan, k)), stamp)
        return path

    return write
