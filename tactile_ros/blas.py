"""One thread for BLAS: frames are a few dozen numbers, and threads only steal time from a loop."""

from __future__ import annotations

import os


def use_one_thread() -> None:
    """Keep BLAS on one thread unless the user said otherwise; call before numpy is loaded."""
    for name in ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS'):
        os.environ.setdefault(name, '1')
