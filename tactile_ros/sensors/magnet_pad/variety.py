"""How much touches of a recording differ: held-out ones judge nothing that none of them tried."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.sensors.magnet_pad.loads import RATIO
from tactile_ros.sensors.magnet_pad.untold import KIND, untouched

if TYPE_CHECKING:
    from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig
    from tactile_ros.types import Array, Bools, Columns, Report

SPARSE = 0.5  # share of the pad that is far from all touches: regressors are not judged there
LIGHT = 1e-9  # N


@dataclass(frozen=True)
class Variety:
    """Of the places and loads that truth tells.

    Attributes
    ----------
    untouched : float
        Share of the pad that no touch came near; 0 where places were not told.
    ratio : float
        Largest load over the least; infinite where loads were not told.
    """

    untouched: float = 0.0
    ratio: float = np.inf

    @classmethod
    def of(cls, config: MagnetPadConfig, truth: Columns, good: Bools) -> Variety:
        """Of good rows (s,) of a truth."""
        share, ratio = 0.0, np.inf
        place, force = (_known(truth, name, good) for name in ('position', 'force'))
        if len(place):
            around = np.arctan2(place[:, 2], place[:, 1])
            share = untouched(config, np.column_stack([place[:, 0], around]))
        if len(force):
            load = np.linalg.norm(force, axis=1)
            ratio = float(load.max() / max(float(load.min()), LIGHT))
        return cls(share, ratio)

    @property
    def enough(self) -> bool:
        """Whether held-out touches say what regressors err by."""
        return self.untouched <= SPARSE and self.ratio >= RATIO

    @property
    def report(self) -> Report:
        """What regressors were never asked, a sentence for each."""
        found: Report = {}
        if self.untouched > SPARSE:
            share = {'share of the pad': self.untouched}
            found[f'{KIND}places half a radius from the next touch'] = share
        if self.ratio < RATIO:
            found[f'{KIND}loads other than one'] = {'most over least': self.ratio}
        return found

    def widen(self, known: Columns, config: MagnetPadConfig, targets: tuple[str, ...]) -> None:
        """Widen covariances of regressors, in place, by what a pad's places and loads may be."""
        if 'position' in targets and self.untouched > SPARSE:
            spread = np.array([config.length**2 / 12, config.radius**2 / 3, config.radius**2 / 12])
            cov = np.asarray(known['position_cov'], np.float64)
            known['position_cov'] = cov + np.diag(self.untouched * spread)
        if 'force' in targets and not self.enough:
            force = np.asarray(known['force'], np.float64)
            size = np.nansum(force * force, axis=1)[:, None, None]
            known['force_cov'] = np.asarray(known['force_cov'], np.float64) + size * np.eye(3)


def _known(truth: Columns, name: str, good: Bools) -> Array:
    """Rows of a column that are good and wholly told."""
    column = np.asarray(truth.get(name, np.full((len(good), 3), np.nan)), np.float64)
    return np.asarray(column[good & np.isfinite(column).all(axis=1)])
