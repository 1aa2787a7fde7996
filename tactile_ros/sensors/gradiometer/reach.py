"""How far a place of the disc lies beyond those that a calibration saw, and from rest."""

from __future__ import annotations

import numpy as np

from tactile_ros.types import Array

LEAST = 0.02  # gaps: places that differ by less are alike
MARGIN = 1.05  # of what was seen
UNSURE = 0.5  # of the steepest slope of an answer, beyond all that was seen
UNTOLD = 1e6  # spreads of an answer over gaps: presses at one place tell no slope


class Reach:
    """Ellipsoid around the places of a fit, and how unsure answers are outside it.

    Attributes
    ----------
    centre_, shape_ : ndarray, shape (3,) and (3, 3)
        Places in the ellipsoid have |shape (place - centre)| <= 1.
    directions_ : int
        Along how many the places differed.
    rest_ : ndarray, shape (3,)
        Place of the disc that nothing touches (gaps); NaN where none was seen.
    slope_ : ndarray, shape (k,)
        Steepest change of each answer with the place (unit of the answer, over gaps).
    """

    centre_: Array
    shape_: Array
    directions_: int
    rest_: Array
    slope_: Array

    def fit(self, place: Array, answers: Array, rest: Array) -> Reach:
        """Learn from places (s, 3) (gaps), answers (s, k) there, and places (r, 3) at rest."""
        rest = rest[np.isfinite(rest).all(axis=1)]
        self.rest_ = rest.mean(axis=0) if len(rest) else np.full(3, np.nan)
        self.centre_ = place.mean(axis=0)
        apart = place - self.centre_
        size, axes = np.linalg.eigh(apart.T @ apart / len(place))
        size = np.sqrt(np.maximum(size, 0.0))
        whole = axes.T / np.hypot(size, LEAST)[:, None]
        farthest = float(np.linalg.norm(apart @ whole.T, axis=1).max())
        self.shape_ = whole / (MARGIN * max(farthest, 1.0))
        told = axes[:, size > LEAST]
        self.directions_ = told.shape[1]
        slopes = np.linalg.lstsq(apart @ told, answers - answers.mean(axis=0), rcond=None)[0]
        steep = np.sqrt((slopes**2).sum(axis=0))
        self.slope_ = steep if self.directions_ else np.full(len(steep), UNTOLD)
        return self

    def beyond(self, place: Array) -> Array:
        """Distances (s,) (gaps) of places (s, 3) from the ellipsoid; 0 inside."""
        apart = place - self.centre_
        size = np.sqrt(((apart @ self.shape_.T) ** 2).sum(axis=1))
        outside = np.maximum(1 - 1 / np.maximum(size, 1.0), 0.0)
        return np.asarray(outside * np.sqrt((apart * apart).sum(axis=1)))

    def unfelt(self, place: Array) -> Array:
        """Distances (s,) (gaps) of places (s, 3), told to be untouched, that count as beyond.

        A touch lighter than all that a fit saw stays below the threshold of contact. Its force,
        told as 0, is as large as the steepest slope makes it.
        """
        away = np.nan_to_num(place - self.rest_)
        return np.asarray(np.sqrt((away * away).sum(axis=1)) / UNSURE)

    def doubt(self, beyond: Array) -> Array:
        """Standard deviations (s, k) of answers at distances (s,)."""
        return np.asarray(UNSURE * beyond[:, None] * self.slope_)
