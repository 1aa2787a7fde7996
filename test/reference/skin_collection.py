# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Data collection of [1] on a specimen of the package: every head at every place, some presses."""

from collections.abc import Sequence

import numpy as np

from tactile_ros.sensors.multipole_skin.config import layout
from tactile_ros.sensors.multipole_skin.specimen import POWERS, Specimen
from tactile_ros.sensors.multipole_skin.twin import DEPTH, NOISE
from tactile_ros.types import Outline, Recording

TARE, WINDOW = 5, 10  # frames of a stream
RISE = (4.0, 12.0)  # frames in which a head comes down


def collected(
    specimen: Specimen, heads: Sequence[Outline], places: np.ndarray, seed: int, samples: int
) -> Recording:
    """A stream of tare and window for each press, with labels; head by head, place by place."""
    rng = np.random.default_rng([47, seed])
    what = [(i, place) for i in range(len(heads)) for place in places for _ in range(samples)]
    terms = {
        (i, *place): specimen.terms(heads[i], np.array([*place, 0.0]))
        for i in range(len(heads)) for place in places
    }  # fmt: skip
    begun, rise = rng.uniform(0.3, 1.0, (len(what), 1)), rng.uniform(*RISE, (len(what), 1))
    depth = rng.uniform(*DEPTH, (len(what), 1))
    depth = depth * np.clip((np.arange(WINDOW) + begun) / rise, 0.0, 1.0)
    every = np.array([terms[(i, *place)] for i, place in what])
    change = np.einsum('nwp,nptc->nwtc', depth[..., None] ** POWERS, every)
    values = np.tile(specimen.rest(), (len(what), TARE + WINDOW, 1, 1))
    values[:, TARE:] += change
    values = (values + NOISE * rng.normal(size=values.shape)).reshape(-1, *values.shape[2:])
    press = np.repeat(np.arange(len(what)), TARE + WINDOW)
    touched = np.arange(len(press)) % (TARE + WINDOW) >= TARE
    label = np.where(touched, np.array([i for i, _ in what])[press], -1)
    return Recording.from_arrays(
        layout(specimen.config), values, stream=press, tare=~touched,
        stamp_ns=np.arange(len(press)) * 12_500_000 + press * 2_000_000_000,
        truth={'label': label, 'in_contact': touched.astype(np.int8), 'repetition': press},
    )  # fmt: skip
