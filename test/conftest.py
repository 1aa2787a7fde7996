"""Every test process is alone: its own ROS domain, one thread, no files at home, no deadlines."""

from __future__ import annotations

import importlib.util
import os
import socket
import tempfile

from hypothesis import HealthCheck, settings

DOMAINS = range(1, 101)
FIRST_PORT = 21_000


def claim_domain() -> tuple[int, socket.socket | None]:
    """Take a domain that no other test process holds; the open socket is the claim.

    Counted from the process id, so that the processes of one machine rarely meet at all.
    """
    for step in DOMAINS:
        domain = DOMAINS[(os.getpid() + step) % len(DOMAINS)]
        claim = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        try:
            claim.bind(('127.0.0.1', FIRST_PORT + domain))
        except OSError:
            claim.close()
        else:
            return domain, claim
    return DOMAINS[os.getpid() % len(DOMAINS)], None


# Before numpy and rclpy are imported anywhere: both read these once.
for name in ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS'):
    os.environ[name] = '1'
DOMAIN, _CLAIM = claim_domain()
os.environ['ROS_DOMAIN_ID'] = str(DOMAIN)
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
_HOME = tempfile.TemporaryDirectory(prefix='tactile_ros_test_')
os.environ['ROS_LOG_DIR'] = _HOME.name
os.environ['MPLCONFIGDIR'] = _HOME.name
os.environ['MPLBACKEND'] = 'Agg'

# A loaded machine is slow now and then, which is no failure.
settings.register_profile('patient', deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile('patient')

# What cannot be tested without a package (make test-oldest has neither); the header says so.
NEEDS = {
    'rclpy': ['nodes', 'reference/grip_roads.py'],
    'magpylib': [
        'physics/test_fidelity.py', 'physics/test_magnet_blocks.py', 'physics/test_magnetics.py',
        'physics/test_multipole_sheet.py', 'reference/gradiometer_world.py',
        'reference/magnet_pad_world.py', 'reference/test_gradiometer_world.py',
        'sensors/test_fidelity.py', 'sensors/test_gradiometer.py',
    ],
}  # fmt: skip
LEFT_OUT = {name: x for name, x in NEEDS.items() if importlib.util.find_spec(name) is None}
collect_ignore = [path for paths in LEFT_OUT.values() for path in paths]


def pytest_report_header() -> list[str]:
    """Say which domain this is, and what is left out."""
    without = [f'without {name}: test/{{{",".join(x)}}} left out' for name, x in LEFT_OUT.items()]
    return [f'ROS domain {DOMAIN}', *without]
