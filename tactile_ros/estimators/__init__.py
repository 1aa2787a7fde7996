# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Estimators: fit / predict, one published method per file, and how one of them is chosen.

Every estimator keeps one contract, which `test/estimators/test_conformity.py` checks for all:

- `fit(x (s, d), y (s, k), groups (s,) or None)` returns itself; rows that are not finite are left
  out; the order of rows and the numbers that name groups do not matter.
- `predict(x (s, d))` gives (s, k), NaN for rows that are not finite, the same numbers for one row
  as for many; before a fit it raises NotCalibratedError.
- Hyper-parameters are set in `__init__` without logic; what is fitted stands in attributes that
  end in `_` and is numbers, text, arrays, or other such objects, so that a calibration stores it.
"""
