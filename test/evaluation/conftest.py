"""Bags as a live run writes them, from messages of rosbags."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from tactile_ros.evaluation.bag import BagWriter, all_types

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

TAXELS = 5
STEP_NS = 10_000_000
START_NS = 1_000_000_000


class MessageMaker:
    """Serialised messages of one small sensor."""

    def __init__(self) -> None:
        self.store = all_types()

    def __getattr__(self, name: str) -> type:
        found = [kind for key, kind in self.store.types.items() if key.endswith(f'/msg/{name}')]
        return found[0]

    def header(self, stamp_ns: int) -> object:
        second, rest = divmod(stamp_ns, 1_000_000_000)
        return self.Header(stamp=self.Time(sec=second, nanosec=rest), frame_id='pad')

    def cdr(self, message: object) -> bytes:
        return bytes(self.store.serialize_cdr(message, message.__msgtype__))

    def frame(self, sequence: int, values: np.ndarray, stamp_ns: int) -> object:
        return self.TactileFrame(
            header=self.header(stamp_ns),
            sequence=sequence,
            device_time_ns=0,
            dropped=0,
            values=np.ravel(values).astype(np.float64),
            temperature_c=np.zeros(0),
            status=np.zeros(0, np.uint8),
            valid=True,
        )

    def layout(self, taxels: int = TAXELS) -> object:
        return self.TactileLayout(
            header=self.header(0),
            sensor='reskin_board',
            serial='7',
            unit='T',
            channels=['Bx', 'By', 'Bz'],
            positions=[self.Point(x=0.01 * i, y=0.0, z=0.0) for i in range(taxels)],
            orientations=[self.Quaternion(x=0.0, y=0.0, z=0.0, w=1.0) for _ in range(taxels)],
            saturation=np.full(3, np.inf),
            rate_hz=100.0,
        )

    def contacts(
        self,
        sequence: int,
        stamp_ns: int,
        position: object = (np.nan, np.nan, np.nan),
        force: object = (np.nan, np.nan, np.nan),
    ) -> object:
        def unknown() -> object:
            return self.Vector3(x=np.nan, y=np.nan, z=np.nan)

        patch = self.TactileContact(
            id=1,
            position=self.Point(**dict(zip('xyz', map(float, position), strict=True))),
            normal=unknown(),
            force=unknown(),
            position_covariance=np.full(9, np.nan),
            force_covariance=np.full(9, np.nan),
        )
        push = self.Vector3(**dict(zip('xyz', map(float, force), strict=True)))
        return self.TactileContacts(
            header=self.header(stamp_ns),
            sequence=sequence,
            valid=True,
            status=0,
            taxel_status=np.zeros(0, np.uint8),
            in_contact=1,
            contacts=[patch],
            wrench=self.Wrench(force=push, torque=unknown()),
            wrench_covariance=np.full(36, np.nan),
            cell=-1,
            cell_probability=np.nan,
            label=-1,
            label_name='',
            label_probability=np.nan,
            yaw=np.nan,
            yaw_std=np.nan,
            slip=-1,
            slip_probability=np.nan,
            taxel_force=np.zeros(0),
            deformation=np.zeros(0),
            stray_field=unknown(),
            symmetry=-1,
            session=-1,
            repetition=-1,
        )


@pytest.fixture(scope='session')
def make() -> MessageMaker:
    return MessageMaker()


@pytest.fixture(scope='session')
def write_bag(make: MessageMaker) -> Callable[..., Path]:
    """Writer of a bag of n frames with contacts and truth; frames in `lost` are left out."""

    def write(path: Path, n: int = 50, lost: tuple[int, ...] = (), space: str = '') -> Path:
        rng = np.random.default_rng(7)
        with BagWriter(path) as bag:

            def put(leaf: str, message: object, log_ns: int, latched: bool = False) -> None:
                bag.write(
                    f'{space}/{leaf}', message.__msgtype__, log_ns, make.cdr(message), latched
                )

            put('layout', make.layout(), START_NS, latched=True)
            digest = make.String(data=f'{"a" * 64} reskin_board position: ridge')
            put('calibration', digest, START_NS, latched=True)
            baseline = make.frame(0, np.full(15, 1e-6), 0)
            baseline.temperature_c, baseline.device_time_ns = 25.0 + np.arange(5), 8
            put('baseline', baseline, START_NS, latched=True)
            for k in range(n):
                stamp = START_NS + k * STEP_NS
                values = rng.normal(0.0, 1e-5, 15)
                if k not in lost:
                    put('frame', make.frame(k, values, stamp), stamp + 1_000_000)
                    spot = (values[0], values[1], np.nan)
                    put('contacts', make.contacts(k, stamp, spot), stamp + 3_000_000)
                spot = (values[0] + 1e-6, values[1], np.nan)
                put('truth/contacts', make.contacts(k, 0, spot, (np.nan, np.nan, k)), stamp)
        return path

    return write
