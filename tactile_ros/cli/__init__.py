"""The command `tactile`: one file per command."""

from tactile_ros.blas import use_one_thread

use_one_thread()
