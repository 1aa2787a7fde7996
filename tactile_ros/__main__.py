# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""`python -m tactile_ros`: the command `tactile`."""

import sys

from tactile_ros.cli import start

sys.exit(start())
