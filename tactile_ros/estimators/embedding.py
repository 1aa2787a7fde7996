# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Features of windows by a network in ONNX, as that of [1] (Table I)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.errors import load_package

if TYPE_CHECKING:
    from pathlib import Path

    from tactile_ros.types import Array


class Embedding:
    """A network in a file: windows (n, 1, d, w) float32 -> features (n, p).

    MissingPackageError if onnxruntime is not installed.
    """

    def __init__(self, path: Path) -> None:
        runtime = load_package('onnxruntime', 'a network needs onnxruntime')
        options = runtime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 3
        self.session = runtime.InferenceSession(
            str(path), options, providers=['CPUExecutionProvider']
        )
        self.name = self.session.get_inputs()[0].name

    def __deepcopy__(self, _: object) -> Embedding:
        """Itself: nothing changes a network."""
        return self

    def features(self, windows: Array) -> Array:
        """Features (n, p) of windows (n, w, d) of changes of field (T)."""
        turned = np.ascontiguousarray(np.swapaxes(windows, 1, 2)[:, None], np.float32)
        return np.asarray(self.session.run(None, {self.name: turned})[0], np.float64)
