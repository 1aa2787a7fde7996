"""The ROS edge: lifecycle nodes around the pure core. The only room that imports rclpy."""

import os

# One frame is a few dozen numbers: threads of BLAS only steal time from the loop that reads it.
# They are counted when numpy loads, which is after this line in every node.
for _name in ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS'):
    os.environ.setdefault(_name, '1')
