# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""What `tactile bench gradiometer` asks of a pipeline: which presses are valid, how far off."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.sensors import load_sensor

if TYPE_CHECKING:
    from tactile_ros.pipeline import Pipeline
    from tactile_ros.types import Array, Bools, ContactStates, Recording

SENSOR = load_sensor('gradiometer')
SPECIMENS = {'quick': (11,), 'normal': tuple(range(11, 19)), 'full': tuple(range(11, 27))}
MILLI = 1e3
FULL = 3.5  # N [3]


def rms(error: Array) -> Array:
    """Root mean square of every component."""
    return np.asarray(np.sqrt((error**2).mean(axis=0)))


def judged(pipeline: Pipeline, recording: Recording, rest: int) -> tuple[ContactStates, Bools]:
    """States, and which of them are valid presses."""
    states = pipeline.process_batch(recording)
    asked = states.valid.copy()
    asked[:rest] = False
    return states, asked


def errors(pipeline: Pipeline, recording: Recording, rest: int) -> tuple[Array, Array]:
    """Errors (s, 5) of the answers (N, Nm) and their sigmas, of valid presses; NaN: not told."""
    states, asked = judged(pipeline, recording, rest)
    error, sigma = [], []
    for name, count in (('force', 3), ('torque', 2)):
        spread = np.sqrt(np.diagonal(getattr(states, f'{name}_cov'), axis1=1, axis2=2))
        error.append((getattr(states, name) - recording.truth[name])[asked, :count])
        sigma.append(spread[asked, :count])
    return np.hstack(error), np.hstack(sigma)
