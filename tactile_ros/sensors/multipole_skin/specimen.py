# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""One multipole skin as it was made, and what heads of any outline do to it.

No skin is as its drawing: chips lie and point aside and differ in gain, the sheet is uneven and
its bands are not quite where they should be. The body is a bonded layer under a rigid punch,
solved wave by wave, and the sheet the carpet of dipoles that is needed at the noise of the chips
(`fidelity`): what the templates of `press_templates` approximate by series on a coarser grid.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from tactile_ros.estimators.sheet_calibration import bands_of
from tactile_ros.physics.elastomer import Layer, PunchedCarpet
from tactile_ros.physics.magnet_sheet import Sheet, carpet
from tactile_ros.physics.magnetics import dipole_field

if TYPE_CHECKING:
    from tactile_ros.sensors.multipole_skin.config import MultipoleSkinConfig
    from tactile_ros.types import Array, Outline

PITCH, LEVELS, POINTS = 1.25e-3, 2, 2  # of the carpet that `fidelity` chooses at 4 uT
POWERS = np.arange(1, 4)  # of the depth, in which the change of field is a sum
UNDULATION = 60e-3  # m, wavelength of what is uneven along a band
MOST = 0.4999  # Poisson ratio


@dataclass(frozen=True)
class Flaws:
    """Standard deviations of a skin from its drawing."""

    # of each chip to any side, of all bands along y, of all chips along z (m)
    misplaced: float = 0.15e-3
    aside: float = 0.2e-3
    gap: float = 0.1e-3
    tilt: float = 0.02  # of each chip about any axis (rad)
    gain: float = 0.03  # of each channel, as a share
    # from band to band and along them, and of the whole sheet, as shares of the remanence
    uneven: float = 0.05
    remanence: float = 0.1
    stray: float = 30e-6  # resting field of the Earth, in each component (T)
    turning: float = 0.0  # share of the body's turns that magnets follow: no deviation


NONE = Flaws(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class Specimen:
    """A skin with flaws of some size; `seed` says which one.

    `chips` (t, 3) are Hall elements (m), `responses` (t, 3, 3) field in sensor axes -> reading,
    and `sheet` has the strengths and the place of its bands, even along them.
    """

    def __init__(
        self, config: MultipoleSkinConfig, flaws: Flaws | None = None, seed: int = 0
    ) -> None:
        flaws, rng = Flaws() if flaws is None else flaws, np.random.default_rng([43, seed])
        self.config, self.flaws = config, flaws
        count = len(config.positions)
        self.chips = config.positions + flaws.misplaced * rng.normal(size=(count, 3))
        self.chips[:, 2] += flaws.gap * rng.normal()
        self.responses = _responses(config, flaws, rng)
        self.sheet = _sheet(config, flaws, rng)
        self.places, moments = carpet(self.sheet, PITCH, LEVELS, POINTS)
        wave = np.sin(2 * np.pi * self.places[:, 0] / UNDULATION + rng.uniform(0, 2 * np.pi))
        more = flaws.uneven * wave[:, None] * moments
        self.moments, stray = moments + more, flaws.stray * rng.normal(size=3)
        # blocks are exact where a carpet is coarse; what is uneven along them is small
        self.still = self.sheet.field(self.chips) + self._field(more) + stray
        nodes = (np.unique(axis) for axis in self.places.T)
        self.punched = PunchedCarpet(self._layer(), *nodes)
        self._unpressed = self._field(self.moments)
        self._loads: dict[int, tuple[Outline, Array, Array]] = {}

    @property
    def top(self) -> float:
        """Height of the face that is touched (m)."""
        return self.config.layer_thickness + self.config.sheet_thickness

    def rest(self) -> Array:
        """Readings at rest (T), shape (t, 3)."""
        return self._read(self.still)

    def stray(self, field: Array) -> Array:
        """Change of the readings (t, 3) by a uniform field (3,) (T)."""
        return self._read(np.broadcast_to(field, self.chips.shape))

    def stiffness(self, outline: Outline) -> float:
        """Force over depth (N / m) of a head."""
        return float(self._punch(outline)[1].sum())

    def terms(self, outline: Outline, pose: Array, deepest: float = 1e-3) -> Array:
        """Change of the readings under a flat head, by powers of its depth.

        Shape (3, t, 3) (T / m, T / m2, T / m3); `pose` (3,) is of the outline's origin (m, rad),
        and the sum holds down to the `deepest` depth (m).
        """
        moved, turned = self.punched.under(*self._punch(outline), pose)
        depths = deepest * POWERS / POWERS[-1]
        change = [self._carried(depth * moved, depth * turned) for depth in depths]
        flat = np.reshape(change, (len(depths), -1))
        found = np.linalg.solve(depths[:, None] ** POWERS, flat)
        return self._read(found.reshape(len(depths), *self.chips.shape))

    def press(self, outline: Outline, pose: Array, depths: Array) -> Array:
        """Readings (s, t, 3) (T) while a head stands at depths (s,) (m); see `terms`."""
        terms = self.terms(outline, pose, max(float(np.max(depths)), PITCH))
        powers = np.asarray(depths)[:, None] ** POWERS
        return np.asarray(self.rest() + np.tensordot(powers, terms, axes=1))

    def _punch(self, outline: Outline) -> tuple[Array, Array]:
        """Points and loads of a head, made once."""
        key = id(outline)
        if key not in self._loads:
            self._loads[key] = (outline, *self.punched.loads(outline))
        return self._loads[key][1:]

    def _carried(self, moved: Array, turned: Array) -> Array:
        """Change of the field (t, 3) where the body has carried the dipoles."""
        turned = self.flaws.turning * turned
        moments = self.moments + np.cross(turned, self.moments) if turned.any() else self.moments
        return dipole_field(self.chips, self.places + moved, moments) - self._unpressed

    def _field(self, moments: Array) -> Array:
        """Field (t, 3) of the carpet at rest."""
        return dipole_field(self.chips, self.places, moments)

    def _read(self, field: Array) -> Array:
        """Readings of fields (..., t, 3)."""
        return np.asarray(np.einsum('tij,...tj->...ti', self.responses, field))

    def _layer(self) -> Layer:
        """Layer and sheet, one elastic body."""
        poisson = min(self.config.poisson_ratio, MOST)
        return Layer(self.top, self.config.youngs_modulus / (2 * (1 + poisson)), poisson)


def _responses(config: MultipoleSkinConfig, flaws: Flaws, rng: np.random.Generator) -> Array:
    """Field in sensor axes -> readings of chips that are tilted and of unlike gain (t, 3, 3)."""
    count = len(config.positions)
    tilted = Rotation.from_rotvec(flaws.tilt * rng.normal(size=(count, 3))).as_matrix()
    gain = 1 + flaws.gain * rng.normal(size=(count, 3, 1))
    axes = tilted if config.rotations is None else tilted @ config.rotations
    return np.asarray(gain * np.swapaxes(axes, 1, 2))


def _sheet(config: MultipoleSkinConfig, flaws: Flaws, rng: np.random.Generator) -> Sheet:
    """Sheet of bands of unlike strength that lie aside."""
    size = np.asarray(config.sheet_size, np.float64)
    bands = bands_of(size, config.pole_pitch, config.magnetisation)
    whole = config.remanence * (1 + flaws.remanence * rng.normal())
    strengths = whole * (1 + flaws.uneven * rng.normal(size=bands))
    return Sheet(
        size, config.layer_thickness, config.sheet_thickness, config.pole_pitch,
        config.magnetisation, strengths, flaws.aside * rng.normal(),
    )  # fmt: skip


def snr(change: Array, noise: float) -> Array:
    """Signal over noise (dB), [1] Eq. (1): of changes (...) by contact, noise without load (T).

    Examples
    --------
    >>> snr(np.array([-4e-5]), 4e-6).round(9).tolist()
    [20.0]
    """
    return np.asarray(20 * np.log10(np.abs(change) / noise))
