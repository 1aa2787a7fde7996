"""The nominal model as a table of touches that answers readings before any truth is told.

What is stated of errors is measured on pads that differ from the config as specimens do.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from tactile_ros.estimators.stated_spread import StatedSpread
from tactile_ros.estimators.touch_mixture import Linearised
from tactile_ros.sensors.magnet_pad.nominal import (
    LEAST_NOISE,
    NOISE,
    Presses,
    change_of_field,
    nominal_choice,
    spread_presses,
    uniform_response,
)
from tactile_ros.sensors.magnet_pad.specimens import specimens
from tactile_ros.sensors.magnet_pad.telling import READING, SIGMAS, Telling, Told
from tactile_ros.types import Array, Bools

if TYPE_CHECKING:
    from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig
    from tactile_ros.types import Columns

COUNT = 8000
STEP = 1e-2  # radii and rad, by which slopes are measured
LOAD = 2.0  # radii that a factor e of load counts as
NEAR = 6  # neighbour whose distance is the reach of a touch
RIGHT = 0.06  # of a reading: what the model may be wrong by
UNLIKE = 4.0  # misfit of a channel, from which a stray field is thought of
STIFF = 0.2  # share by which a modulus from a hardness, and thus a force, may be wrong
LEAST = 1e-4  # m; N times shear modulus and radius follow


class NominalPad:
    """Touches of the nominal model as a table that answers readings.

    Parameters
    ----------
    config : MagnetPadConfig
        Geometry and materials.

    Attributes
    ----------
    telling : Telling
        Of the touches.
    spread : StatedSpread
        Of place and force, measured on specimens.
    """

    def __init__(self, config: MagnetPadConfig) -> None:
        self.cells = config.cells
        noise = NOISE if config.noise is None else max(float(np.max(config.noise)), LEAST_NOISE)
        presses = spread_presses(config, COUNT)
        several = len(config.positions) > 1 and config.stray_term
        common = uniform_response(config) if several else None
        rows = self._rows(config, presses, noise)
        usual = float(rows.readings.shape[1])
        self.telling = Telling(
            rows, common, noise, SIGMAS * noise, usual, UNLIKE * usual,
            config.gain_spread, neighbours=32,
        )  # fmt: skip
        force = LEAST * config.shear_modulus * config.radius
        self.floor = np.diag(np.repeat([LEAST, force], 3) ** 2)
        self.spread = self._measured(config, noise)

    def _measured(self, config: MagnetPadConfig, noise: float) -> StatedSpread:
        """What is said of touches of specimens, beside what they are."""
        x, true = specimens(config, noise)
        mean, cov, _ = self._told(x)
        sigma = np.sqrt(np.diagonal(cov, axis1=1, axis2=2))
        return StatedSpread().fit(sigma, mean - true)

    def _told(self, x: Array) -> tuple[Array, Array, Told]:
        """Mean (s, 6) and covariance (s, 6, 6) of place and force, as the table has them."""
        told = self.telling(x, self.cells)
        cov = told.cov + self.floor
        stiffer = STIFF * told.mean[:, 3:]
        cov[:, 3:, 3:] += stiffer[:, :, None] * stiffer[:, None, :]
        return told.mean, cov, told

    @staticmethod
    def _rows(config: MagnetPadConfig, presses: Presses, noise: float) -> Linearised:
        """Touches with their readings, and both a little further along, around and harder."""
        nodes, radius = nominal_choice(config).size[0], config.radius
        spots = np.column_stack(
            [presses.along / radius, presses.around, LOAD * np.log(presses.size)]
        )
        reach = cKDTree(spots).query(spots, k=[NEAR + 1])[0][:, 0]
        reach = np.clip(reach, 0.005, 0.3)[:, None]
        steps = (
            replace(presses, along=presses.along + STEP * radius),
            presses.turned(STEP),
            replace(presses, force=presses.force * (1 + STEP / LOAD)),
        )
        level = change_of_field(config, presses, nodes).reshape(len(reach), -1)
        sigma = np.sqrt(noise**2 + RIGHT**2 * (level**2).mean(axis=1))
        beside = np.column_stack([np.ones(len(level)), np.zeros(len(level)), (noise / sigma) ** 2])
        start = np.column_stack([presses.places(radius), presses.force, beside, level])
        rises = []
        for step in steps:
            change = change_of_field(config, step, nodes).reshape(len(reach), -1)
            moved = np.column_stack([step.places(radius), step.force, beside, change])
            rises.append(moved - start)
        leads = np.stack(rises, axis=-1) / STEP * reach[:, None]
        share = np.full(len(level), 1 / len(level))
        return Linearised(level, leads[:, READING:], start, leads, sigma, share)

    def _hidden(self, x: Array) -> Array:
        """Covariance (s, 3, 3) (N2) of saying that nothing touches, of readings (s, d)."""
        return (1 + STIFF) ** 2 * self.telling.hidden(x)

    def estimate(self, x: Array, rest: Bools, doubt: Array | float = 0.0) -> Columns:
        """Place, force and cell of changes of field x (s, d) (T); NaN and -1 where x is not.

        Rows of `rest` (s,) are untouched; `doubt` (s,) is the baseline's variance over a frame's.
        """
        there = np.asarray(np.isfinite(x).all(axis=1))
        mean, cov = np.full((len(x), 6), np.nan), np.full((len(x), 6, 6), np.nan)
        cell, share = np.full(len(x), -1), np.full(len(x), np.nan)
        stray, odd = np.full((len(x), 3), np.nan), np.zeros(len(x), np.int8)
        if there.any():
            mean[there], wide, told = self._told(x[there])
            sigma = np.sqrt(np.diagonal(wide, axis1=1, axis2=2))
            factor = self.spread(sigma) / sigma
            noisy = 1 + (doubt * np.ones(len(x)))[there] * told.noisy
            cov[there] = wide * factor[:, :, None] * factor[:, None, :] * noisy[:, None, None]
            cell[there], share[there] = told.shares.argmax(axis=1), told.shares.max(axis=1)
            stray[there], odd[there] = told.stray, told.odd
            if (rest & there).any():
                cov[rest & there, 3:, 3:] = self._hidden(x[rest & there])
            if self.telling.part is not None and (rest & there).any():
                stray[rest & there] = self.telling.resting_field(x[rest & there])
        known = {
            'position': mean[:, :3], 'position_cov': cov[:, :3, :3],
            'force': mean[:, 3:], 'force_cov': cov[:, 3:, 3:],
            'cell': cell, 'cell_probability': share, 'odd': odd,
        }  # fmt: skip
        return known if self.telling.part is None else {**known, 'stray_field': stray}
