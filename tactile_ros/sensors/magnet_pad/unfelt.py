"""What force may hide below the threshold of contact, where 0 is told.

Light touches read in proportion to their load. A reading at rest says how large a load could be at
each place, and how likely that place is; places at which the pad feels little hide most.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tactile_ros.types import Array, Columns

MOST = 256  # touches
BLOCK = 1024


class Unfelt:
    """Second moments of forces that readings at rest may hide.

    Parameters
    ----------
    readings, forces : ndarray, shape (n, d) and (n, 3)
        Of touches (T, N), all as likely; the lighter half of them is taken.
    noise : float
        Of a channel (T).
    """

    def __init__(self, readings: Array, forces: Array, noise: float) -> None:
        size = np.sqrt((forces * forces).sum(axis=1))
        light = np.argsort(size, kind='stable')[: max(len(size) // 2, 1)]
        light = light[:: -(-len(light) // MOST)]
        load = np.maximum(size[light], 1e-12)[:, None]
        self.forces_, self.units_ = forces[light] / load, readings[light] / load
        self.noise = max(noise, 1e-9)

    def __call__(self, x: Array) -> Array:
        """Covariance (s, 3, 3) (N2) of saying 0 of readings (s, d) (T)."""
        square = np.maximum((self.units_**2).sum(axis=1), 1e-30)
        outer = (self.forces_[:, :, None] * self.forces_[:, None]).reshape(-1, 9)
        cov = np.empty((len(x), 3, 3))
        for i in range(0, len(x), BLOCK):
            part = x[i : i + BLOCK]
            # a row at a time: the same bits alone and among others
            load = np.maximum(np.matmul(part[:, None], self.units_.T)[:, 0] / square, 0.0)
            gain = load * load * square / self.noise**2
            likely = np.exp(0.5 * (gain - gain.max(axis=1, keepdims=True)))
            likely /= likely.sum(axis=1, keepdims=True)
            hidden = likely * (load * load + self.noise**2 / square)
            cov[i : i + BLOCK] = np.matmul(hidden[:, None], outer)[:, 0].reshape(-1, 3, 3)
        return cov


def truth_of_touches(truth: Columns) -> Columns:
    """Truth without the forces of untouched rows, which are 0 in use whatever is learned."""
    free = [np.asarray(truth['in_contact']) == 0] if 'in_contact' in truth else []
    if 'force' in truth:
        free.append((np.nan_to_num(np.asarray(truth['force'], float)) == 0).all(axis=1))
    if not free:
        return truth
    loads = {name: truth[name] for name in ('force', 'torque') if name in truth}
    gone = np.any(free, axis=0)[:, None]
    return {**truth, **{name: np.where(gone, np.nan, load) for name, load in loads.items()}}
