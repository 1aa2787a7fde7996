"""Twins that a fake hand presses: readings over force, ports that come and go."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from tactile_ros.nodes.mock_hand import PressedTwins, PressTable
from tactile_ros.sensors import load_sensor

if TYPE_CHECKING:
    from pathlib import Path


def test_a_calibrated_sensor_reads_the_force_that_presses() -> None:
    spec = load_sensor('reskin_board')
    pipeline = spec.pipeline(estimator='ridge').fit(spec.presses(spec.config(), 1))
    table = PressTable(spec.presses(spec.config(), 0))
    rest = table.at(0.0)
    np.testing.assert_allclose(table.at(-1.0), rest)
    np.testing.assert_allclose(table.at(1e9), table.at(table.force[-1]))
    forces = np.linspace(0.3, 0.9, 4) * table.force[-1]
    read = [pipeline.process(_frame(k, table.at(f))).force[2] for k, f in enumerate(forces)]
    assert (np.diff(read) > 0).all()
    np.testing.assert_allclose(read, forces, rtol=0.25)


def _frame(sequence: int, values: np.ndarray) -> object:
    from tactile_ros.types import Frame

    return Frame(sequence * 10_000_000, sequence, values)


def test_a_port_appears_at_its_path_and_a_press_is_on_it(tmp_path: Path) -> None:
    port = tmp_path / 'thumb'
    spec = load_sensor('reskin_board')
    with PressedTwins('reskin_board', [str(port)], seed=3) as pressed:
        assert port.is_symlink()
        readings = []
        for force in (0.0, 5.0):
            pressed.force[0] = force
            with pressed.twins[0].device(lambda: 0) as device:
                device.read(1.0)
                readings.append(device.read(1.0).values)
    assert np.abs(readings[1] - readings[0]).max() > 1e-5
    assert readings[0].shape == spec.layout(spec.config()).shape
    assert not port.is_symlink()


def test_a_sensor_without_a_port_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="must have a serial port; received 'magnet_pad'"):
        PressedTwins('magnet_pad', [str(tmp_path / 'x')])
