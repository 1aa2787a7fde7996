# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""`tactile doctor` on twins, on nothing, on a machine made of files, and on bags."""

from __future__ import annotations

import dataclasses
import json
import os
import re
from pathlib import Path

import numpy as np
import pytest

from reference.wires import Wires
from tactile_ros.cli import doctor
from tactile_ros.cli.main import main
from tactile_ros.devices.mlx90393 import ChipPlace
from tactile_ros.devices.simulated_i2c import SimulatedChip, SimulatedI2cBus
from tactile_ros.devices.timestamps import VirtualClock
from tactile_ros.devices.transport import I2cBus
from tactile_ros.errors import DeviceError
from tactile_ros.evaluation.bag_check import check_bag
from tactile_ros.sensors import list_sensors
from tactile_ros.types import Device, Frame, Layout, TaxelStatus

LAYOUT = Layout(np.zeros((3, 3)), ('Bx', 'By', 'Bz'), 'T', rate_hz=100.0)


def look(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, dict[str, dict]]:
    """Exit code and findings of the command."""
    code = main(['doctor', '--json', *arguments])
    return code, {found['where']: found for found in json.loads(capsys.readouterr().out)}


@pytest.mark.parametrize('sensor', list_sensors())
def test_every_twin_is_well(sensor: str, capsys: pytest.CaptureFixture[str]) -> None:
    code, found = look(capsys, '--sensor', sensor, '--simulated', '--seconds', '1.0')
    assert code == 0, found
    assert {'rate', 'jitter', 'noise', 'temperature'} <= found.keys()
    assert found['noise']['state'] == doctor.OK
    assert 'serial ports' not in found


def test_a_fault_of_a_twin_is_told_with_what_to_do(capsys: pytest.CaptureFixture[str]) -> None:
    words = '--sensor gradiometer --simulated --seconds 1.0 --fault flipped:3'
    _, found = look(capsys, *words.split())
    assert int(found['dropped']['what']) >= 3  # more where the machine pauses
    assert 'frames are lost' in found['dropped']['remedy']
    assert found['crc errors']['state'] == doctor.WARN


def test_nothing_connected_fails_and_says_what_to_do(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, 'list_ports', lambda: ['/dev/ttyS0'])
    monkeypatch.setattr(doctor, 'list_buses', list)
    code, found = look(capsys)
    assert code == 1
    assert found['sensor']['state'] == doctor.BAD
    assert '--simulated' in found['sensor']['remedy']
    assert found['serial ports']['what'] == 'none but /dev/ttyS*'
    assert found['serial ports']['state'] == found['I2C buses']['state'] == doctor.NOTE
    assert 'i2c-dev' in found['I2C buses']['remedy']


def test_a_sensor_that_is_not_there_fails(capsys: pytest.CaptureFixture[str]) -> None:
    for sensor, option in (('reskin_board', 'port=/nowhere'), ('magnet_pad', 'buses=[/nowhere]')):
        code, found = look(capsys, '--sensor', sensor, '--set', option, '--seconds', '0.1')
        assert code == 1
        assert '/nowhere does not exist' in found['frames']['remedy']
        assert sensor not in found  # nothing was read
    words = ['doctor', '--sensor', 'reskin_board', '--port', '/tmp', '--seconds', '0.1']
    assert main(words) == 1
    said = capsys.readouterr().out
    assert '\nframes: port /tmp cannot be opened (Is a directory); ' in said


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (['--simulated'], '--sensor must name'),
        (['--sensor', 'none'], 'sensor must be one of'),
        (['--sensor', 'gradiometer', '--set', 'nonsense=1'], '--set must name one of'),
        (['--sensor', 'gradiometer', '--set', 'baud'], 'must be NAME=VALUE'),
        (['--sensor', 'gradiometer', '--simulated', '--fault', 'fire'], 'fire'),
        (['--repair', 'out'], '--repair must come with the bag'),
        (['bag', '--sensor', 'gradiometer'], '--sensor must stand without a bag'),
    ],
)
def test_wrong_use_is_one_sentence(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['doctor', *arguments]) == 2
    printed = capsys.readouterr()
    assert words in printed.err
    assert len(printed.err.splitlines()) == 1


def port_of(root: Path, name: str) -> Path:
    """A port of an Arduino and its folder of a device, in a machine made of files."""
    device = root / 'sys/class/tty' / name / 'device'
    device.mkdir(parents=True)
    (device.parent / 'idVendor').write_text('2341\n')
    (device.parent / 'idProduct').write_text('8054\n')
    (root / 'dev').mkdir()
    (root / 'dev' / name).touch()
    return device


def test_latency_timer_of_a_port(tmp_path: Path) -> None:
    timer = port_of(tmp_path, 'ttyUSB0') / 'latency_timer'
    timer.write_text('16\n')
    port, slow = doctor.serial_ports(['/dev/ttyUSB0'], tmp_path)
    assert (port.state, slow.state) == (doctor.OK, doctor.WARN)
    assert 'up to 16 ms' in slow.what
    assert 'ATTR{latency_timer}="1"' in slow.remedy
    timer.write_text('1\n')
    assert doctor.serial_ports(['/dev/ttyUSB0'], tmp_path)[1].state == doctor.OK


@pytest.mark.parametrize(
    ('group', 'words'),
    [
        ('dialout', 'usermod -aG dialout'),
        ('root', 'ATTRS{idVendor}=="2341", ATTRS{idProduct}=="8054", GROUP="dialout"'),
    ],
)
def test_a_port_that_may_not_be_used(
    group: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    port_of(tmp_path, 'ttyACM0')
    monkeypatch.setattr(os, 'access', lambda *_: False)
    monkeypatch.setattr(Path, 'group', lambda _: group)
    (found,) = doctor.serial_ports(['/dev/ttyACM0'], tmp_path)
    assert found.state == doctor.BAD
    assert words in found.remedy
    assert doctor.permission(tmp_path / 'none', 'dialout', '').what == 'does not exist'


def test_a_bus_is_asked_without_changing_anything() -> None:
    rng = np.random.default_rng(0)
    places = (ChipPlace(0x0C), ChipPlace(0x0E, 0, 0x70, 1))
    chips = {p: SimulatedChip(lambda _: (np.zeros(3), 25.0), rng, np.zeros(3)) for p in places}
    found = doctor.probe(I2cBus('twin', SimulatedI2cBus(VirtualClock(), chips)))
    assert found.state == doctor.OK
    assert found.what == 'answers come from 0x0c, 0x70 (switch)'
    nobody = Wires(121)
    assert doctor.probe(I2cBus('empty', nobody)).state == doctor.WARN
    written = {data for sent in nobody.seen for _, reads, data in sent if not reads}
    assert written == {b'\x00'}
    assert doctor.probe(I2cBus('stuck', Wires(110))).state == doctor.BAD


def check_of(values: np.ndarray, period_s: float = 0.01, **more: object) -> doctor.DeviceCheck:
    frames = [Frame(round(k * period_s * 1e9), k, row) for k, row in enumerate(values)]
    return doctor.DeviceCheck(LAYOUT, frames, **{'failure': '', 'counters': {}, **more})


def named(found: list[doctor.Finding]) -> dict[str, doctor.Finding]:
    return {finding.where: finding for finding in found}


def test_noise_is_that_of_the_readings_whatever_presses() -> None:
    rng = np.random.default_rng(0)
    slow = 1e-3 * np.sin(np.linspace(0, 6, 2000))[:, None, None]
    check = check_of(slow + 2e-6 * rng.standard_normal((2000, 3, 3)))
    np.testing.assert_allclose(doctor.noise_of(check), 2e-6, rtol=0.15)


@pytest.mark.parametrize(('stale', 'state'), [(10, None), (11, doctor.WARN), (101, doctor.BAD)])
def test_repeats_are_told_where_they_are_more_than_a_quiet_chip_has(
    stale: int, state: str | None
) -> None:
    """More than one frame of twenty; a bit that is always wrong is told from its first frame."""
    check = check_of(1e-6 * np.random.default_rng(0).standard_normal((200, 3, 3)))
    bits = np.zeros((200, 3), np.uint8)
    bits[:stale, 1] = TaxelStatus.STALE
    bits[0, 2] |= TaxelStatus.STUCK
    bits[:, 0] = TaxelStatus.SATURATED
    frames = [dataclasses.replace(f, status=b) for f, b in zip(check.frames, bits, strict=True)]
    found = named(doctor.findings(dataclasses.replace(check, frames=frames)))
    assert found['stuck'].what.startswith('taxels [2]')
    assert found['saturated'].what == 'taxels [0], in up to 100 % of the frames'
    assert ('stale' in found) == (state is not None)
    if state is not None:
        assert found['stale'].state == state
        assert found['stale'].what.startswith('taxels [1]')
        assert 'lower the rate' in found['stale'].remedy


def test_noisy_dead_slow_lossy_and_silent_streams_are_told() -> None:
    rng = np.random.default_rng(0)
    values = 1e-6 * rng.standard_normal((200, 3, 3))
    values[:, 1] *= 30
    assert 'taxels [1]' in named(doctor.findings(check_of(values)))['noise'].remedy
    values[:, 1] = 0.0
    assert 'never change' in named(doctor.findings(check_of(values)))['noise'].remedy
    slow = check_of(rng.standard_normal((50, 3, 3)), 0.05, counters={'reconnects': 2})
    found = named(doctor.findings(slow))
    assert found['rate'].state == doctor.WARN
    assert found['rate'].what == '20 Hz, nominal 100 Hz'
    assert 'plug' in found['reconnects'].remedy
    silent = check_of(np.zeros((9, 3, 3)), failure='gone')
    assert named(doctor.findings(silent))['connection'].remedy == 'gone'


def test_a_device_that_fails_is_no_traceback() -> None:
    class Broken(Device):
        layout = LAYOUT

        def __enter__(self) -> Broken:
            msg = 'no such port'
            raise DeviceError(msg)

        def __exit__(self, *_: object) -> None:
            pass

    assert doctor.watch(Broken(), 1.0).failure == 'no such port'


@pytest.mark.parametrize('text', ['-1', '0', 'nan', 'inf', 'soon'])
def test_a_duration_that_cannot_be_is_refused(
    text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main(['doctor', '--seconds', text])
    assert 'seconds' in capsys.readouterr().err


def test_a_bag_is_shown_with_its_topics_and_what_is_wrong(
    bag: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['doctor', str(bag)]) == 1
    shown = capsys.readouterr().out
    assert re.search(r'/finger/frame +tactile_ros/msg/TactileFrame +17 +84.2 ', shown)
    assert re.search(r'/finger gaps +bad +3 frames are lost in 2 gaps, at most 2 at once', shown)
    assert re.search(r'/finger repeats +ok +none', shown)
    assert re.search(r'replay +note +leaves out /\\x1b\[31mred', shown)
    assert '\x1b' not in shown
    assert main(['doctor', str(bag), '--json']) == 1
    assert {'topics', 'findings'} == set(json.loads(capsys.readouterr().out))


def test_a_torn_bag_is_repaired_into_a_new_folder(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    torn, out = tmp_path / 'torn.mcap', tmp_path / 'saved'
    data = (bag / 'bag_0.mcap').read_bytes()
    torn.write_bytes(data[: len(data) // 2])
    command = ['doctor', str(torn), '--repair', str(out)]
    assert main(command[:2]) == 1
    assert doctor.ADVICE in capsys.readouterr().out
    assert main(command) == 0
    printed = capsys.readouterr()
    assert doctor.ADVICE not in printed.out
    assert re.search(r'file +bad +torn.mcap is cut off', printed.out)
    assert 'messages of 2 topics' in printed.err
    assert check_bag(out).damage == ()
    assert main(command) == 1
    assert 'exists already' in capsys.readouterr().err
    assert main(['doctor', str(bag), '--repair', str(bag / 'saved')]) == 1
    assert 'is inside' in capsys.readouterr().err
    torn.write_bytes(b'')
    assert main(['doctor', str(torn)]) == 1
    assert doctor.ADVICE not in capsys.readouterr().out  # there is nothing to save
    assert main(['doctor', str(tmp_path / 'nowhere')]) == 1
    assert 'nowhere does not exist' in capsys.readouterr().err
