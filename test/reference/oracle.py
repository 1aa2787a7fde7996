# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Seeded recordings of every sensor and the states that its pipeline gave for them.

`pytest test/test_oracle.py --write-oracle` writes them anew, after a change of numbers on purpose.
"""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tactile_ros.sensors import load_sensor
from tactile_ros.types import ContactStates, Recording

FOLDER = Path(__file__).parents[1] / 'data' / 'oracle'
ASKED = 240  # rows whose states are kept
COLUMNS = ('values', 'stamp_ns', 'temperature_c', 'stream', 'tare')
STATES = (
    'force', 'torque', 'position', 'yaw', 'cell', 'label', 'in_contact', 'valid', 'status',
    'stray_field', 'force_cov', 'position_cov', 'taxel_force',
)  # fmt: skip
Sides = tuple[object, Recording, Recording]


def gradiometer() -> Sides:
    """A specimen in a stray field after its calibration."""
    from reference.gradiometer_world import Scene, World

    world = World(3)
    scene = Scene(stray=(3e-4, -2e-4, 4e-4))
    return world.config, world.record(200, 1), world.record(ASKED - 60, 2, scene)


def magnet_pad() -> Sides:
    """A specimen touched within its cells, from 1.5 to 10 N."""
    from reference.magnet_pad_world import PadWorld, Touches

    spec = load_sensor('magnet_pad')
    config = spec.config()
    world, layout = PadWorld(config, 2), spec.layout(config)

    def side(count: int, seed: int) -> Recording:
        touches = Touches.in_cells(config, (5, 5), count, 0.8, seed)
        return world.record(touches, seed, layout=layout)

    return config, side(400, 1), side(ASKED - 60, 2)


def five_wire_skin() -> Sides:
    """A stream of presses on an uneven sheet with a film that creeps."""
    from reference.five_wire_sheet import SheetWorld, pressed

    spec = load_sensor('five_wire_skin')
    config = dataclasses.replace(spec.config(), size=np.array([0.1, 0.1]))
    world, layout = SheetWorld(4), spec.layout(config)

    def side(count: int, seed: int) -> Recording:
        rng = np.random.default_rng(seed)
        places, loads = rng.uniform(0.02, 0.08, (count, 2)), rng.uniform(2, 12, count)
        return pressed(world, layout, places, loads, seed, hold_s=0.6)

    return config, side(40, 1), side(6, 2)


def multipole_skin() -> Sides:
    """Presses of the twin without drawings of its heads."""
    spec = load_sensor('multipole_skin')
    config = dataclasses.replace(spec.config(), objects=())
    rows = 80 + 8 * 96
    train = spec.presses(config, 1).select(slice(0, rows))
    truth = {name: train.truth[name] for name in ('label', 'in_contact', 'repetition')}
    asked = spec.presses(config, 2).select(slice(0, ASKED))
    return config, dataclasses.replace(train, truth=truth), asked


def taxel_array() -> Sides:
    """Presses of the twin."""
    spec = load_sensor('taxel_array')
    config = spec.config()
    return config, spec.presses(config, 0, 8), spec.presses(config, 1, 3)


def reskin_board() -> Sides:
    """Every sixth frame of a real recording of forces; the last quarter is asked."""
    spec = load_sensor('reskin_board')
    name = next(name for name in spec.recordings() if 'shear' in name)
    whole = spec.recordings()[name]
    config = spec.config()
    config = dataclasses.replace(config, positions=whole.layout.positions)
    first = whole.select(slice(0, 4800, 6))
    return config, first, whole.select(slice(4800, 4800 + ASKED * 4, 4))


def packed(sides: Sides) -> dict[str, np.ndarray]:
    """Arrays of the recordings, readings with nine digits as they are stored."""
    arrays: dict[str, np.ndarray] = {}
    for name, side in zip(('fit', 'asked'), sides[1:], strict=True):
        for column in COLUMNS:
            if (value := getattr(side, column)) is not None:
                arrays[f'{name}/{column}'] = value
        for key, value in side.truth.items():
            if not (value.dtype.kind == 'f' and np.isnan(value).all()):
                arrays[f'{name}/truth/{key}'] = value
    return {
        key: value.astype(np.float32) if value.dtype.kind == 'f' else value
        for key, value in arrays.items()
    }


def side(arrays: dict[str, np.ndarray], name: str, layout: object) -> Recording:
    """Recording that was packed as `name`."""
    columns = {
        column: arrays[f'{name}/{column}'] for column in COLUMNS if f'{name}/{column}' in arrays
    }
    truth = {
        key.removeprefix(f'{name}/truth/'): value
        for key, value in arrays.items()
        if key.startswith(f'{name}/truth/')
    }
    wide = {
        key: value.astype(np.float64) if value.dtype.kind == 'f' else value
        for key, value in columns.items()
    }
    values = wide.pop('values')
    return Recording.from_arrays(layout, values, truth=truth, **wide)  # type: ignore[arg-type]


def answers(sensor: str, config: object, arrays: dict[str, np.ndarray]) -> ContactStates:
    """States of the asked recording after a fit on the other one."""
    spec = load_sensor(sensor)
    layout = spec.layout(config)  # type: ignore[arg-type]
    pipeline = spec.pipeline(config).fit(side(arrays, 'fit', layout))  # type: ignore[arg-type]
    return pipeline.process_batch(side(arrays, 'asked', layout))


SCENES: dict[str, Callable[[], Sides]] = {
    scene.__name__: scene
    for scene in (
        gradiometer, magnet_pad, five_wire_skin, multipole_skin, taxel_array, reskin_board,
    )
}  # fmt: skip


def write(sensor: str) -> None:
    """Store the recordings of a sensor and the states that it gives now."""
    sides = SCENES[sensor]()
    arrays = packed(sides)
    states = answers(sensor, sides[0], arrays)
    for name in STATES:
        value = getattr(states, name)
        if not (value.dtype.kind == 'f' and np.isnan(value).all()):
            arrays[f'states/{name}'] = value
    np.savez_compressed(FOLDER / f'{sensor}.npz', **arrays)
