"""Tactile sensors on robot hands: from the bytes of the chip to contacts and grip commands."""

import os
import pkgutil

__version__ = '0.1.0'

# The interfaces generated from msg/ lie in the install tree under this same name: found there also
# when this source folder comes first on the path.
__path__ = pkgutil.extend_path(__path__, __name__)


def use_one_thread() -> None:
    """Keep BLAS on one thread unless the user said otherwise; call before numpy is loaded.

    Frames are a few dozen numbers: threads only steal time from a loop.
    """
    for name in ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS'):
        os.environ.setdefault(name, '1')
