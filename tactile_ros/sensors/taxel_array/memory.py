"""What a stream of an array remembers, and outputs above its tare."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.conditioning.history import History
from tactile_ros.regression.estimation import TIME_CONSTANTS

if TYPE_CHECKING:
    from tactile_ros.conditioning.patch_ids import PatchIds
    from tactile_ros.conditioning.viscoelastic import CreepState
    from tactile_ros.types import Array, Bools, Signals


class Memory(History):
    """The past of regressors, strains of the skin, ids of patches, level of the last tare.

    A baseline that follows what rests would follow a skin that creeps back as well, and take it
    for drift: where creep is undone, outputs are above the level at which the stream began. A
    baseline that a fit made of rests between touches has some creep in it: `rest` is that baseline
    (t,), and how far a skin that was never pressed is above it.
    """

    def __init__(
        self, creep: CreepState | None, ids: PatchIds, rest: tuple[Array, Array] | None = None
    ) -> None:
        super().__init__(np.array(TIME_CONSTANTS))
        self.creep = creep
        self.ids = ids
        self.rest = rest
        self.level: Array | None = None

    def above_tare(self, signals: Signals) -> Array:
        """Outputs (s, t) above the baseline (t,) with which their stream began.

        Parameters
        ----------
        signals : Signals
            Conditioned frames; independent ones are as they are.

        Returns
        -------
        ndarray, shape (s, t)
            NaN where unusable.
        """
        delta = signals.delta[..., 0]
        if signals.stamp_ns is None or not len(delta):
            return delta
        base = signals.baseline[..., 0]
        first = np.maximum.accumulate(np.where(signals.restart, np.arange(len(base)), -1))
        held = base[np.maximum(first, 0)]
        if self.rest is not None:
            baseline, above = self.rest
            untared = np.all((held == baseline) | np.isnan(baseline), axis=1)
            held = np.where(untared[:, None], held + above, held)
        if self.level is not None:
            held[first < 0] = self.level
        self.level = held[-1]
        return np.where(np.isnan(delta), np.nan, signals.values[..., 0] - held)


def beginnings(signals: Signals) -> Bools:
    """Good rows (n,) before which the past is forgotten."""
    # a row that is left out hands the beginning of a stream on to the next
    return np.asarray(np.diff(np.cumsum(signals.restart)[signals.good], prepend=0) > 0)
