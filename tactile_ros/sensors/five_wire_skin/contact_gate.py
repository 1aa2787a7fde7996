"""Contact by the divider, and readings less the drift of their rest.

Contact shows in the divider alone: the foil of an untouched skin may float, and its potentials
then read garbage, in the baseline too. Where rests show that, potentials are taken as they are
read, and only the divider is less its baseline.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.conditioning.contact import contact_scale
from tactile_ros.physics.compiled import compiled

if TYPE_CHECKING:
    import numpy.typing as npt

    from tactile_ros.types import Array, Bools, Columns, Signals

TOUCHED = 0.01  # divider's reading above which a skin that was never fitted is touched
STILL = 0.01  # spread of a resting potential below which the foil does not float
LIGHTEST = 0.01
DIVIDER = 2  # its channel
CONSTANT = 1e-6  # of the supply: readings that move less are one constant, in 16 bits too
LEAST, POSSIBLE = -1.0, 2.0  # of the supply: no wire reads more than twice of it
BELOW = -0.1  # of the supply: a converter reads no less than ground, but for its offset
RAIL = 1.0  # of the divider: no resistance at all, so a short or a converter at its end
TINY = 1e-300


@compiled
def settle_rows(x: Array, moved: Array, doubt: Array, quiet: Bools) -> None:
    """Take off readings (s, c) what their rest has moved."""
    for s in range(len(x)):
        for i in range(x.shape[1]):
            square = moved[s, i] * moved[s, i]
            if quiet[i] and doubt[i] < square < math.inf:
                x[s, i] -= (1.0 - doubt[i] / (square + TINY)) * moved[s, i]
            x[s, i] = min(max(x[s, i], LEAST), POSSIBLE)


def implausible_taxels(values: Array) -> Bools:
    """Readings (..., c) of which no wire can read so much or so little, or a divider at its end.

    Examples
    --------
    >>> implausible_taxels(np.array([[0.5, 0.5, 0.9], [0.5, 0.5, 1.0], [3.0, 0.5, 0.2]])).tolist()
    [False, True, True]
    >>> implausible_taxels(np.array([[0.5, -0.5, 0.2]])).tolist()
    [True]
    """
    beyond = (values > POSSIBLE) | (values < BELOW)
    return np.asarray(beyond.any(axis=-1) | (values[..., DIVIDER] >= RAIL))


class ContactGate:
    """What the divider says of contact.

    Parameters
    ----------
    noise : float
        Of the divider's reading; NaN: estimated from rest.
    channels : int
        Readings of a frame (c): two potentials, the divider, and more potentials.

    Attributes
    ----------
    threshold_ : float
        Of the divider's reading; NaN: unknown.
    blind_ : bool
        Whether the fit had no rest to tell contact from.
    quiet_ : ndarray, shape (c,)
        Readings that rest at a level.
    rest_ : ndarray, shape (c,)
        That level; 0 where it is none, or unknown.
    doubt_ : ndarray, shape (c,)
        Variance of a reading at rest.
    subthreshold_ : float
        Mean square of forces that do not close the air gap (N2).
    report_ : dict of str to float
        `threshold_divider`; `lightest_felt` and `threshold_force` of the air gap (N).
    """

    def __init__(self, noise: float, channels: int = 3) -> None:
        self.noise = noise
        self.threshold_ = np.nan
        self.blind_ = False
        self.quiet_ = np.arange(channels) == DIVIDER
        self.rest_ = np.zeros(channels)
        self.doubt_ = np.zeros(channels)
        self.subthreshold_ = 0.0
        self.report_: dict[str, float] = {}

    def fit(self, signals: Signals, truth: Columns) -> ContactGate:
        """Learn rest and threshold from frames, and the touches that truth (s, ...) tells."""
        blank = np.full((len(signals.good), 3), np.nan)
        position = np.asarray(truth.get('position', blank), np.float64)
        force = np.asarray(truth.get('force', blank), np.float64)[:, 2]
        told = np.asarray(truth.get('in_contact', np.full(len(blank), -1)), np.int64)
        self.blind_ = bool((signals.in_contact[signals.good] < 0).all())
        touched = (np.isfinite(position).any(axis=1) & (told != 0)) | (told == 1)
        loaded = np.nan_to_num(force) > 0
        resting = (told == 0) | ((signals.in_contact == 0) & ~touched & ~loaded)
        resting &= signals.good
        values = signals.values[resting, 0]
        potentials = np.arange(len(self.rest_)) != DIVIDER
        still = len(values) > 1 and bool((values[:, potentials].std(axis=0) < STILL).all())
        self.quiet_ = ~potentials | still
        if len(values) > 1:
            self.rest_ = np.where(self.quiet_, values.mean(axis=0), 0.0)
            self.doubt_ = np.where(self.quiet_, values.var(axis=0), 0.0)
        divider = self._felt(self.readings(signals))
        rest, felt = divider[resting], divider[touched & signals.good]
        seen = float(np.sqrt((rest**2).mean())) if len(rest) > 1 else np.nan
        self.noise = seen if np.isnan(self.noise) else self.noise
        known = felt[:, None, None] if len(felt) else None
        self.threshold_ = float(contact_scale(np.array([[self.noise]]), known)[0, 0])
        above = divider > self.threshold_
        pressed = signals.good & loaded
        self._tell(force[pressed & ~above], force[pressed & above])
        return self

    def readings(self, signals: Signals) -> Array:
        """Potentials and divider (s, c), less what of their rest has moved since the fit.

        A rest that lies within its noise of the fit's has not moved: a short tare would add its
        own noise to every frame.
        """
        moved = signals.baseline[:, 0] - self.rest_
        x = signals.values[:, 0].copy()
        settle_rows(x, moved, self.doubt_, self.quiet_)
        return x

    def _felt(self, x: Array) -> Array:
        """Distance (s,) of the divider's reading from its rest."""
        return np.asarray(np.abs(x[:, DIVIDER] - self.rest_[DIVIDER]))

    def contact(self, signals: Signals, x: Array) -> npt.NDArray[np.int8]:
        """Contact (s,) by the divider of readings x (s, c): 1, 0, -1 unknown.

        Where a fit had no rest to judge by, and of unusable frames, it is as the pipeline says.
        """
        if self.blind_:
            return signals.in_contact
        limit = TOUCHED if np.isnan(self.threshold_) else self.threshold_
        size = self._felt(x)
        # a frame called untouched may be a tare row, so that more than the threshold is asked
        felt = (size > limit) & ((signals.in_contact != 0) | (size > TOUCHED))
        return np.where(signals.good, felt.view(np.int8), signals.in_contact)

    def _tell(self, light: Array, heavy: Array) -> None:
        """Forces (N) below and above the threshold: what the air gap swallows."""
        lightest = float(np.quantile(heavy, LIGHTEST)) if len(heavy) else 0.0
        self.subthreshold_ = float((light**2).mean()) if len(light) else (0.1 * lightest) ** 2
        told = {'threshold_divider': self.threshold_, 'lightest_felt': lightest}
        if len(light):
            told['threshold_force'] = float(np.quantile(light, 0.95))
        self.report_ = {name: value for name, value in told.items() if np.isfinite(value)}
