"""The command `tactile`: one file per command."""

from tactile_ros import use_one_thread

use_one_thread()
