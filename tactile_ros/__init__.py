"""Tactile sensors on robot hands: from the bytes of the chip to contacts and grip commands."""

import pkgutil

__version__ = '0.1.0'

# The interfaces generated from msg/ lie in the install tree under this same name: found there also
# when this source folder comes first on the path.
__path__ = pkgutil.extend_path(__path__, __name__)
