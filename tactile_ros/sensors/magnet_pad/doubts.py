"""What answers of the pad may be wrong by, beyond what their method says: what was never seen."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.sensors.magnet_pad.beyond import OUT_OF_RANGE
from tactile_ros.sensors.magnet_pad.unfelt import Unfelt
from tactile_ros.sensors.magnet_pad.untold import (
    KIND,
    LEANS,
    elsewhere,
    lonely,
    outside,
    temperatures,
    upright,
)
from tactile_ros.sensors.magnet_pad.variety import Variety

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig
    from tactile_ros.types import Array, Bools, Columns, Report, Signals


class Doubts:
    """Of one recording.

    Parameters
    ----------
    config : MagnetPadConfig
        Of the pad.

    Attributes
    ----------
    variety_ : Variety
        How much recorded touches differ.
    upright_ : bool
        Whether no recorded force had a part along the axis.
    unfelt_ : Unfelt or None
        What regressors of force hide at rest, by recorded touches.
    span_ : tuple of float
        Least and highest temperature of the chips (degrees Celsius), NaN: none told; () unfitted.
    """

    span_: tuple[float, ...] = ()

    def __init__(self, config: MagnetPadConfig) -> None:
        self.config = config
        self.variety_ = Variety()
        self.upright_ = False
        self.unfelt_: Unfelt | None = None

    def fit(self, signals: Signals, x: Array, truth: Columns, noise: float) -> Doubts:
        """Learn from frames, their readings x (s, d) (T) and their truth; noise of a channel."""
        good, self.span_ = signals.good, temperatures(signals)
        self.variety_ = Variety.of(self.config, truth, good)
        if 'force' in truth:
            force = np.asarray(truth['force'], np.float64)
            self.upright_ = upright(force[good])
            known = good & np.isfinite(x).all(axis=1) & np.isfinite(force).any(axis=1)
            if known.any():
                self.unfelt_ = Unfelt(x[known], np.nan_to_num(force[known]), noise)
        return self

    @property
    def report(self) -> Report:
        """What was not told, a sentence for each."""
        leans: Report = {f'{KIND}forces along the surface': {'sigma over load': LEANS}}
        return {**(leans if self.upright_ else {}), **self.variety_.report}

    @property
    def scene(self) -> Report:
        """What neither touches nor the nominal model tell, a sentence for each."""
        return {**lonely(self.config), **elsewhere(self.span_)}

    def mark(self, known: Columns, signals: Signals) -> Columns:
        """The same answers, flagged where chips are warmer or colder than any of the fit."""
        rows = outside(self.span_, signals)
        if np.count_nonzero(rows):
            status = np.asarray(known.get('status', np.zeros(len(rows), np.int64)), np.int64)
            known['status'] = status | rows * OUT_OF_RANGE
        return known

    def widen(
        self,
        known: Columns,
        rest: Bools,
        x: Array,
        modelled: tuple[str, ...],
        hidden: Callable[[Array], Array],
    ) -> None:
        """Widen covariances, in place.

        Parameters
        ----------
        known : dict of str to ndarray, shape (s, ...)
            Answers.
        rest, x : ndarray, shape (s,) and (s, d)
            Rows that nothing touches; readings (T).
        modelled : tuple of str
            Targets that the response of the pad answers; regressors answer the others.
        hidden : callable
            Of readings at rest, the covariance of saying that nothing touches (N2).
        """
        regressed = tuple(name for name in known if name not in modelled)
        self.variety_.widen(known, self.config, regressed)
        if 'force_cov' not in known:
            return
        cov = np.array(known['force_cov'], np.float64)
        size = np.square(np.asarray(known['force'], np.float64)).sum(axis=1)
        if np.count_nonzero(rest):
            rows = np.flatnonzero(rest & np.isfinite(x).all(axis=1))
            cov[rows] = hidden(x[rows])
            size[rows] = np.trace(cov[rows], axis1=1, axis2=2)
        if self.upright_:
            # what leans was never seen: its share of forces is that of the nominal touches
            cov[:, 0, 0] += LEANS**2 * size
        known['force_cov'] = cov
