"""A multipole skin as it is: its sheet, its chips, and the body between them."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tactile_ros.estimators.press_bank import PressBank
from tactile_ros.physics.layer_response import Layer
from tactile_ros.physics.magnetic_sheet import Sheet
from tactile_ros.physics.punch_dents import PunchDents
from tactile_ros.types import Array, Outline

MOST_KEPT = 2  # banks, which cost seconds each and tens of megabytes
_KEPT: dict[bytes, PressBank] = {}
_KEPT_LOCK = threading.Lock()  # a class is learned beside the stream


@dataclass(frozen=True)
class SkinModel:
    """Everything that the answer of a multipole skin to a flat head depends on.

    Attributes
    ----------
    size : ndarray, shape (2,)
        Of the sheet (m).
    layer, thickness : float
        Soft layer under the sheet, and the sheet (m); the base is at z = 0.
    pole_pitch, magnetisation : float, str
        Width of a band (m); 'M1' to 'M4'.
    youngs, poisson : float
        Of the body (Pa, 1).
    strengths : ndarray, shape (b,)
        Remanence of the bands (T).
    shift : float
        Of the bands along y (m).
    chips : ndarray, shape (t, 3)
        Hall elements (m).
    responses : ndarray, shape (t, 3, 3)
        Field in sensor axes -> reading.
    turning : float
        Share of the body's turns that the magnets follow.
    """

    size: Array
    layer: float
    thickness: float
    pole_pitch: float
    magnetisation: str
    youngs: float
    poisson: float
    strengths: Array
    shift: float
    chips: Array
    responses: Array
    turning: float

    @property
    def body(self) -> float:
        """Height of layer and sheet (m)."""
        return self.layer + self.thickness

    @cached_property
    def sheet(self) -> Sheet:
        """The sheet at rest."""
        return Sheet(
            self.size, self.layer, self.thickness, self.pole_pitch, self.magnetisation,
            self.strengths, self.shift,
        )  # fmt: skip

    @cached_property
    def dents(self) -> PunchDents:
        """Of the body."""
        shear_modulus = self.youngs / (2 * (1 + self.poisson))
        return PunchDents(self.sheet, 0.0, Layer(self.body, shear_modulus, self.poisson))

    @property
    def common(self) -> Array:
        """What a uniform field does to all readings, shape (t 3, 3)."""
        return self.responses.reshape(-1, 3)

    def rest(self) -> Array:
        """Readings at rest (T), shape (t, 3)."""
        return np.asarray(np.einsum('tij,tj->ti', self.responses, self.sheet.field(self.chips)))

    def bank(self, outlines: tuple[Outline, ...]) -> PressBank:
        """Templates of heads; the last ones made are kept."""
        key = self._key(outlines)
        with _KEPT_LOCK:
            if key not in _KEPT:
                made = PressBank(
                    self.sheet, self.dents, self.chips, self.responses, self.turning, outlines
                )
                while len(_KEPT) >= MOST_KEPT:
                    _KEPT.pop(next(iter(_KEPT)))
                _KEPT[key] = made
            return _KEPT[key]

    def _key(self, outlines: tuple[Outline, ...]) -> bytes:
        """What a bank is made from."""
        numbers = [
            self.size, self.strengths, self.chips, self.responses,
            np.array([
                self.layer, self.thickness, self.pole_pitch, self.youngs, self.poisson,
                self.shift, self.turning,
            ]),
            *(np.asarray(loop) for outline in outlines for loop in outline.loops),
        ]  # fmt: skip
        loops = repr([len(outline.loops) for outline in outlines]).encode()
        whole = b'|'.join(np.ascontiguousarray(n, np.float64).tobytes() for n in numbers)
        return self.magnetisation.encode() + loops + whole


def bands_of(size: Array, pole_pitch: float, magnetisation: str) -> int:
    """How many bands a sheet has."""
    if magnetisation == 'M4':
        return int(np.ceil(float(size[1]) / pole_pitch - 1e-9)) + 1
    return 2 if magnetisation == 'M3' else 1
