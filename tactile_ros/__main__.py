"""`python -m tactile_ros`: the command `tactile`."""

import sys

from tactile_ros.cli import start

sys.exit(start())
