# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Every test process is alone: its own ROS domain, one thread, no files at home, no deadlines."""

import importlib.util
import os
import re
import shutil
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from html import escape
from pathlib import Path
from types import SimpleNamespace

import pytest
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

# Else every process that a test starts compiles all that it imports.
sys.dont_write_bytecode = False
os.environ.pop('PYTHONDONTWRITEBYTECODE', None)

# A loaded machine is slow now and then, which is no failure; every run tries the same examples.
settings.register_profile(
    'patient', deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile('patient')

FOLDER = Path(__file__).parent
PATIENCE_S = 120.0
OPTIONAL = ('rclpy', 'magpylib')  # make test-oldest has neither


def needing(package: str) -> list[str]:
    """Files, and folders whose conftest is one, that import a package or a world that does."""
    texts = {path: path.read_text() for path in FOLDER.rglob('*.py')}
    own = re.compile(rf'^(?:import|from) {package}\b', re.MULTILINE)
    found = {path for path, text in texts.items() if own.search(text)}
    for _ in texts:
        worlds = '|'.join(path.stem for path in found if path.parent.name == 'reference') or '-'
        uses = re.compile(rf'^from reference\b.*\b(?:{worlds})\b', re.MULTILINE)
        more = {path for path, text in texts.items() if uses.search(text)} - found
        if not more:
            break
        found |= more
    whole = {path.parent for path in found if path.name == 'conftest.py'}
    places = {next((f for f in whole if f in path.parents), path) for path in found}
    return sorted(str(place.relative_to(FOLDER)) for place in places)


# What cannot be tested without a package; the header says so.
LEFT_OUT = {name: needing(name) for name in OPTIONAL if importlib.util.find_spec(name) is None}
collect_ignore = [path for paths in LEFT_OUT.values() for path in paths]
collect_ignore += ['launch/launched.py']  # launch_testing runs it: test/launch/test_launched.py


# A file stays in one process: those that take longest come first, so that none of them ends last.
# The first three share no compiled loop: others would build anew what the first builds.
LONGEST = (
    'sensors/test_gradiometer', 'sensors/test_taxel_array', 'sensors/test_five_wire_skin',
    'sensors/test_magnet_pad', 'cli/test_demo', 'simulation/test_trials',
    'sensors/test_conformity', 'sensors/test_multipole_skin', 'sensors/test_network_classes',
    'sensors/test_compiled_loops', 'cli/test_enrol', 'evaluation/test_replay',
    'nodes/test_grip_node', 'nodes/test_enrolment_server', 'nodes/test_stack', 'test_enrolment',
    'devices/test_device_conformity', 'sensors/test_reskin_board', 'sensors/test_slip',
    'cli/test_help_examples', 'cli/test_calibrate', 'evaluation/test_guided', 'test_oracle',
    'estimators/test_object_pose', 'nodes/test_sensor_node', 'nodes/test_graph', 'test_first_hour',
    'sensors/test_adding_a_sensor',
)  # fmt: skip


def pytest_configure(config: pytest.Config) -> None:
    """Let pytest-xdist keep the order of the files."""
    config.option.loadscopereorder = False


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Longest files first."""
    places = {f'test/{name}.py': place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: places.get(item.nodeid.partition('::')[0], len(places)))


def pytest_addoption(parser: pytest.Parser) -> None:
    """Let the states that test_oracle compares with be written anew."""
    parser.addoption('--write-oracle', action='store_true', help='write test/data/oracle anew')


def pytest_report_header() -> list[str]:
    """Say which domain this is, and what is left out."""
    without = [f'without {name}: test/{{{",".join(x)}}} left out' for name, x in LEFT_OUT.items()]
    return [f'ROS domain {DOMAIN}', *without]


@pytest.fixture(scope='session', autouse=True)
def patience() -> Iterator[None]:
    """Whoever starts and stops nodes gives them the time that a loaded machine needs."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr('tactile_ros.nodes.processes.STOP_S', PATIENCE_S)
        patch.setattr('tactile_ros.cli.record.START_S', PATIENCE_S)
        yield


@pytest.fixture(scope='session')
def taught_skin(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Calibration of a multipole skin that knows five heads; not to be written.

    Fitted once for all processes of a run; its templates are kept, which every test would build.
    """
    from reference import enrolled_skin
    from tactile_ros.estimators import regression

    folder = tmp_path_factory.getbasetemp()
    path = (folder.parent if 'PYTEST_XDIST_WORKER' in os.environ else folder) / 'skin.npz'
    if not path.exists():
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(regression, 'FEWEST_STEPS', 50)  # no perceptron is chosen here
            enrolled_skin.five_heads().save(path)
    kept = enrolled_skin.SPEC.load(path).estimation.recogniser_.templates  # type: ignore[attr-defined]
    yield path
    del kept


@pytest.fixture
def own_skin(taught_skin: Path, tmp_path: Path) -> Path:
    """A copy that may be written."""
    return Path(shutil.copyfile(taught_skin, tmp_path / 'own.npz'))


BROWSERS = ('chromium', 'chromium-browser', 'google-chrome', 'google-chrome-stable', 'chrome')
BROWSER_FLAGS = (
    '--headless', '--no-sandbox', '--disable-gpu', '--disable-quic', '--no-first-run',
    '--disable-sync', '--disable-background-networking', '--disable-component-update',
    '--hide-scrollbars',
)  # fmt: skip
# in a frame of its own: no window of a headless browser is narrower than 500 pixels
PROBE = """<script>addEventListener('load', () => {
  const page = document.querySelector('iframe').contentDocument, found = document.documentElement;
  const boxes = [...page.querySelectorAll('.scroll')];
  found.dataset.seen = [
    page.documentElement.scrollWidth, page.documentElement.clientWidth,
    boxes.filter(box => box.scrollWidth > box.clientWidth + 1).length,
    page.querySelectorAll('svg.plot').length,
    [...page.images].filter(image => image.naturalWidth > 0).length,
  ].join(' ');
})</script>"""


@pytest.fixture
def framed(tmp_path: Path) -> Callable[[str, int], SimpleNamespace]:
    """What a browser makes of a page of a width: its width, tables cut off, plots, images."""
    found = [path for name in BROWSERS if (path := shutil.which(name))]
    if not found:
        pytest.skip('chromium is not installed')
    command = [found[0], *BROWSER_FLAGS]

    def show(page: str, width: int) -> SimpleNamespace:
        outer = tmp_path / 'outer.html'
        frame = f'<iframe style="border:0;width:{width}px" srcdoc="{escape(page)}"></iframe>'
        outer.write_text(f'<body>{frame}{PROBE}</body>', 'utf-8')
        flags = ['--enable-logging=stderr', f'--user-data-dir={tmp_path}/user', '--dump-dom']
        done = subprocess.run(
            [*command, *flags, outer.as_uri()],
            capture_output=True, text=True, timeout=120, check=True,
        )  # fmt: skip
        seen = re.search(r'data-seen="([\d ]+)"', done.stdout)
        assert seen is not None
        names = ('wide', 'window', 'cut', 'plots', 'images')
        told = dict(zip(names, map(int, seen[1].split()), strict=True))
        lines = [line for line in done.stderr.splitlines() if 'CONSOLE' in line]
        return SimpleNamespace(**told, complaints='\n'.join(lines))

    return show
