# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Sessions of `tactile bench magnet_pad`: presses of the world, what learns from them, bounds.

The world is `test/reference/magnet_pad_world.py`. Its bounds are the posterior over many touches
of the world itself, with its own readings and slopes.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.worlds.cell_knn import CellKnn
from tactile_ros.estimators.gaussian_sum_table import GaussianSumTable, Linearised
from tactile_ros.evaluation.metrics import accuracy
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig, surface_cells

if TYPE_CHECKING:
    from types import ModuleType

    from tactile_ros.pipeline import Pipeline
    from tactile_ros.types import Array, ContactStates, Integers, Recording

SPEC = load_sensor('magnet_pad')
GRIDS = {6: (3, 2), 15: (5, 3), 25: (5, 5)}
STRAY, TIP, REST = 0.5e-3, 3e-3, 60
DENSE = {0.1: 2500, 1.0: 6000}
LEARN, JUDGE, WORLD_SEED = 1, 2, 0


@dataclass(frozen=True)
class Session:
    """Presses with what was read."""

    config: MagnetPadConfig
    touches: object
    recording: Recording

    @property
    def change(self) -> Array:
        """Readings less the tare, shape (s, d) (T)."""
        values = self.recording.values.reshape(len(self.recording), -1)
        return values[REST:] - values[:REST].mean(axis=0)


def session(
    cells: int, count: int, spread: float, seed: int, *, tip: float = TIP, stray: float = 0.0,
    cone: float = 0.0, number: int = 0, specimen: int = WORLD_SEED, warm: float | None = None,
    **pad: float,
) -> Session:  # fmt: skip
    """Presses within `spread` of the width of their cells, by a tip of a radius (m).

    `warm` degrees above the tare, as the chips tell; None: they tell nothing.
    """
    module, config = _world(), _config(cells)
    touches = module.Touches.in_cells(config, GRIDS[cells], count, spread, seed, cone=cone)
    pad_world = module.PadWorld(config, specimen, **pad)
    recording = pad_world.record(
        touches, seed + 1000, tip=tip, stray=stray, layout=SPEC.layout(config), session=number
    )
    if warm is not None:
        rise = np.where(np.arange(len(recording)) < REST, 0.0, warm)
        recording = pad_world.warmed(recording, rise, seed, layout=SPEC.layout(config))
    return Session(config, touches, recording)


def joined(*parts: Session) -> tuple[Pipeline, CellKnn]:
    """Ours and [2]'s, learned from sessions of one config."""
    ours = SPEC.pipeline(parts[0].config).fit(*(part.recording for part in parts))
    x = np.concatenate([part.change for part in parts])
    named = np.concatenate([part.touches.cell for part in parts])
    return ours, CellKnn(5).fit(x, named)


@lru_cache
def learned(cells: int, spread: float, count: int) -> tuple[Pipeline, CellKnn, float]:
    """Ours and [2]'s, learned from one session, and how long both took (s)."""
    train = session(cells, count, spread, LEARN)
    began = time.process_time()
    ours, peer = joined(train)
    return ours, peer, time.process_time() - began


def pair(cells: int, spread: float, count: int) -> tuple[ContactStates, Integers, Session]:
    """What ours and the neighbours say of fresh touches."""
    ours, peer, _ = learned(cells, spread, count)
    test = session(cells, count, spread, JUDGE)
    return ours.process_batch(test.recording), peer.predict(test.change), test


def right(states: ContactStates, one: Session) -> float:
    """Per cent of cells that are named rightly."""
    return accuracy(states.cell[REST:], one.touches.cell)


def away(states: ContactStates, one: Session) -> float:
    """Mean distance of places from the truth (mm)."""
    return 1e3 * float(
        np.nanmean(np.linalg.norm(states.position[REST:] - one.touches.place, axis=1))
    )


def off_force(states: ContactStates, one: Session) -> float:
    """Root mean square of how far forces are from the truth (N); NaN where none is told."""
    error = states.force[REST:] - one.touches.force
    told = np.isfinite(error).all(axis=1)
    return float(np.sqrt((error[told] ** 2).sum(axis=1).mean())) if told.any() else float('nan')


@lru_cache
def _truth(cells: int, spread: float) -> tuple[GaussianSumTable, GaussianSumTable]:
    """Touches of the world itself, without and with an outside field of the size in use."""
    module, config = _world(), _config(cells)
    pad, step = module.PadWorld(config, WORLD_SEED), (2e-5, 2e-5, 1e-3)
    touches = module.Touches.in_cells(config, GRIDS[cells], DENSE[spread], spread, 77)
    readings = pad.change(touches, TIP)
    reach = 0.5e-3 if spread == 1.0 else 0.1e-3
    slopes, leads = [], []
    for i, size in enumerate((reach, reach, reach / 20e-3)):
        shift = np.eye(3)[i] * step[i]
        moved = touches.shifted(*shift)
        slopes.append((pad.change(moved, TIP) - readings) / step[i] * size)
        leads.append((moved.place - touches.place) / step[i] * size)
    count = len(readings)
    rows = Linearised(
        readings.reshape(count, -1), np.stack(slopes, axis=-1).reshape(count, -1, 3),
        touches.place, np.stack(leads, axis=-1), np.full(count, pad.noise),
        np.full(count, 1 / count),
    )  # fmt: skip
    common = np.vstack([np.eye(3)] * len(config.positions))
    plain = GaussianSumTable(rows, neighbours=48)
    return plain, GaussianSumTable(rows, common, STRAY / np.sqrt(3), neighbours=192)


def bounds(cells: int, spread: float, test: Session, stray: Session) -> tuple[float, ...]:
    """Mean error of a place (mm), cells right (%) and with an outside field, by the posterior."""
    # anywhere is the same for all cells
    plain, blind = _truth(cells if spread < 1.0 else 15, spread)
    centres = test.config.cells * np.array([1.0, 1.0, 0.0])
    seen, met = plain(test.change), blind(stray.change)
    away = 1e3 * float(np.linalg.norm(seen.mean - test.touches.place, axis=1).mean())
    named = (t.shares(s, centres).argmax(axis=1) for t, s in ((plain, seen), (blind, met)))
    return away, *(accuracy(one, test.touches.cell) for one in named)


def times(pipeline: Pipeline, test: Recording) -> tuple[float, float]:
    """Microseconds per frame of the whole pipeline: one at a time, and in a batch."""
    single = least_us(pipeline.process, [test.frame(row) for row in range(REST, REST + 200)])
    batch = least_us(pipeline.process_batch, [test])
    return single, batch / len(test)


def least_us(call: object, inputs: list[Array]) -> float:
    """Microseconds of processor time of a call, the least mean of many rounds."""
    rounds = []
    for _ in range(8):
        began = time.process_time()
        for one in inputs:
            call(one)
        rounds.append((time.process_time() - began) / len(inputs))
    return 1e6 * min(rounds)


def _world() -> ModuleType:
    """The world, which needs magpylib and the sources."""
    from reference import magnet_pad_world

    return magnet_pad_world


def _config(cells: int) -> MagnetPadConfig:
    config = replace(SPEC.config(), cells=surface_cells(*GRIDS[cells]))
    assert isinstance(config, MagnetPadConfig)
    return config
