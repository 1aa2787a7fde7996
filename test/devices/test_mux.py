"""Switches of a bus: one channel open at a time, and no byte more than needed."""

from __future__ import annotations

import errno

import pytest
from smbus2 import i2c_msg

from tactile_ros.devices.mlx90393 import ChipPlace, Switches, clusters, refuse_conflicts
from tactile_ros.devices.transport import I2cBus
from tactile_ros.errors import NotAcknowledged


class Writes:
    """Keeps what was written."""

    def __init__(self) -> None:
        self.seen: list[tuple[int, bytes]] = []
        self.silent = False

    def i2c_rdwr(self, *messages: i2c_msg) -> None:
        if self.silent:
            raise OSError(errno.EREMOTEIO, 'remote')
        self.seen += [(m.addr, bytes(m)) for m in messages]

    def close(self) -> None:
        pass


def behind(mux: int, channel: int = 0) -> ChipPlace:
    return ChipPlace(0x0C, 0, mux, channel)


@pytest.fixture
def wires() -> Writes:
    return Writes()


@pytest.fixture
def bus(wires: Writes) -> I2cBus:
    bus = I2cBus('wires', smbus=wires)
    bus.open()
    return bus


def test_only_changes_are_written(wires: Writes, bus: I2cBus) -> None:
    switches = Switches(bus, [behind(0x70)])
    for channel in (0, 0, 3, 3, 7):
        switches.select(behind(0x70, channel))
    switches.select(ChipPlace())
    assert wires.seen == [(0x70, b'\x01'), (0x70, b'\x08'), (0x70, b'\x80')]


def test_the_other_switch_is_closed_first(wires: Writes, bus: I2cBus) -> None:
    switches = Switches(bus, [behind(0x71), behind(0x70)])
    switches.select(behind(0x70, 1))
    switches.select(behind(0x71, 2))
    switches.select(behind(0x71, 3))
    assert wires.seen == [
        (0x71, b'\x00'), (0x70, b'\x02'), (0x70, b'\x00'), (0x71, b'\x04'), (0x71, b'\x08'),
    ]  # fmt: skip


def test_what_failed_is_written_again(wires: Writes, bus: I2cBus) -> None:
    switches = Switches(bus, [behind(0x70)])
    switches.select(behind(0x70, 1))
    wires.silent = True
    with pytest.raises(NotAcknowledged, match='nothing answers at 0x70'):
        switches.select(behind(0x70, 2))
    wires.silent = False
    switches.select(behind(0x70, 1))
    switches.forget()
    switches.select(behind(0x70, 1))
    assert wires.seen == [(0x70, b'\x02')] * 3


def test_twenty_chips_are_five_clusters_of_four() -> None:
    places = clusters()
    refuse_conflicts(places)
    assert len(set(places)) == 20
    assert {place.channel for place in places} == set(range(5))
    assert {place.address for place in places} == {0x0C, 0x0D, 0x0E, 0x0F}
    assert str(places[4]) == '0x0c on bus 0 behind channel 1 of 0x70'
    assert str(ChipPlace(0x13, 1)) == '0x13 on bus 1'


@pytest.mark.parametrize(
    'places',
    [
        [ChipPlace(0x0C), ChipPlace(0x0C)],
        [ChipPlace(0x0C, 0, 0x70, 1), ChipPlace(0x0C)],
        [ChipPlace(0x0C, 0, 0x70, 1), ChipPlace(0x70)],
    ],
)
def test_two_that_would_answer_are_refused(places: list[ChipPlace]) -> None:
    with pytest.raises(ValueError, match='two would answer as'):
        refuse_conflicts(places)
    refuse_conflicts([ChipPlace(0x0C), ChipPlace(0x0C, 1)])


@pytest.mark.parametrize(
    'place',
    [(0x07,), (0x78,), (0x0C, -1), (0x0C, 0, 0x70), (0x0C, 0, 0x6F, 1), (0x0C, 0, 0x70, 8)],
)
def test_places_that_cannot_be_are_refused(place: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match='of ChipPlace must be'):
        ChipPlace(*place)
