"""The film's resistance R - Rx on a sheet, with an Rx that a recording may mend."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_ros.estimators.smooth_fields import MOST_WAVES, cosines_at
from tactile_ros.physics.resistive import SeriesResistance
from tactile_ros.types import Array

BEYOND = 0.15  # of the range of the logarithm, in which the curve goes on
LEAST_FILM = 0.02  # of R


@dataclass(frozen=True)
class FilmResistance:
    """Rx over the sheet, and the range of what it leaves of R; in units of the divider's R0.

    Attributes
    ----------
    nominal : SeriesResistance
        Rx before it is mended.
    series : ndarray, shape (n, n)
        Factors of cosines of what mending adds to it.
    mended : ndarray, shape (n, n)
        Factors of what mending has taken out of the logarithm of a force, times the film.
    range : ndarray, shape (3,)
        Least and largest film that count, and the middle of its logarithm.
    """

    nominal: SeriesResistance
    series: Array
    mended: Array
    range: Array

    @classmethod
    def seen(cls, nominal: SeriesResistance, x: Array) -> FilmResistance:
        """With a nominal Rx, for features (s, 3..) that were seen."""
        none = np.zeros((MOST_WAVES, MOST_WAVES))
        return cls(nominal, none, none, _range_of(x, nominal.at(x[:, :2])))

    def mend(self, x: Array, wrong: Array, slope: float) -> FilmResistance:
        """With an Rx that a linear fit about the nominal one has found.

        Parameters
        ----------
        x : ndarray, shape (s, 3..)
            Features that were seen.
        wrong : ndarray, shape (n, n)
            Factors of cosines of what is over the film in the logarithm of force: the slope
            times what the nominal Rx has too much.
        slope : float
            Of the logarithm of force over that of the film.
        """
        series = self.series - (wrong - self.mended) / slope
        mended = self.nominal.at(x[:, :2]) + cosines_at(x[:, :2], series)
        return FilmResistance(self.nominal, series, wrong, _range_of(x, mended))

    def at(self, x: Array) -> Array:
        """The film (s,) of features (s, 3..), within what was seen."""
        film = x[:, 2] - self.series_at(x[:, :2])
        return np.asarray(np.minimum(np.maximum(film, self.range[0]), self.range[1]))

    def shapes(self, x: Array) -> Array:
        """The five shapes (s, 5) of a power law for features (s, 3..)."""
        film, (low, high, middle) = self.at(x), self.range
        level = np.log(film) - middle
        return np.stack([np.ones_like(level), level, low / film, film / high, level**2], axis=1)

    def series_at(self, places: Array) -> Array:
        """Rx (s,) at places (s, 2) in units of the edges."""
        return self.nominal.at(places) + cosines_at(places, self.series)

    @property
    def levels(self) -> tuple[float, float]:
        """Least and largest logarithm of the film, less its middle."""
        low, high, middle = self.range
        return float(np.log(low) - middle), float(np.log(high) - middle)

    @property
    def middle(self) -> float:
        """Rx in the middle of the sheet."""
        return float(self.series_at(np.full((1, 2), 0.5))[0])

    def told(self, x: Array) -> Array:
        """What mending has taken out of the logarithm of a force (s,)."""
        return np.asarray(cosines_at(x[:, :2], self.mended) / self.at(x))


def _range_of(x: Array, series: Array) -> Array:
    """Range of the film that was seen in features (s, 3..) with Rx (s,), and a little more."""
    film = x[:, 2] - series
    level = np.log(np.maximum(film, np.maximum(LEAST_FILM * x[:, 2], 1e-6)))
    low, high = float(level.min()), float(level.max())
    more = BEYOND * max((high - low) / 2, 1e-3)
    return np.array([np.exp(low - more), np.exp(high + more), (low + high) / 2])
