# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Estimators that fail at some frames, when they have changed their memory."""

import numpy as np
import pytest

from tactile_ros.pipeline import Pipeline
from tactile_ros.types import Columns, Signals


def fail_at(monkeypatch: pytest.MonkeyPatch, pipeline: Pipeline, stamps: object) -> None:
    """Let the estimation of a pipeline fail at frames of such stamps (ns)."""
    kind = type(pipeline.estimation)
    healthy = kind.estimate

    def estimate(self: object, signals: Signals, memory: object) -> Columns:
        known = healthy(self, signals, memory)
        if np.isin(signals.stamp_ns, stamps).any():
            msg = 'Singular matrix'
            raise np.linalg.LinAlgError(msg)
        return known

    monkeypatch.setattr(kind, 'estimate', estimate)
