"""The package as ROS and pip see it: one version, every interface, found from everywhere."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

import tactile_ros

ROOT = Path(__file__).resolve().parent.parent
SHARED = ('msg', 'srv', 'action', 'benchmarks', 'config')  # in share/tactile_ros of a wheel
BUILT = (ROOT / 'install' / 'setup.bash').exists()


def test_one_version_everywhere() -> None:
    version = ET.parse(ROOT / 'package.xml').findtext('version')
    assert version == tactile_ros.__version__


def test_every_interface_is_generated_and_its_packages_are_found() -> None:
    cmake = (ROOT / 'CMakeLists.txt').read_text()
    files = [path for kind in ('msg', 'srv', 'action') for path in ROOT.glob(f'{kind}/*')]
    assert files
    generated = re.search(r'rosidl_generate_interfaces\((.*?)\)', cmake, re.S)
    assert generated
    for path in files:
        assert f'{path.parent.name}/{path.name}' in generated[1]
        for package in re.findall(r'^(\w+)/\w+', path.read_text(), re.M):
            assert f'find_package({package} REQUIRED)' in cmake
            assert package in generated[1].split('DEPENDENCIES')[1]


def test_executables_have_their_modules() -> None:
    cmake = (ROOT / 'CMakeLists.txt').read_text()
    modules = re.search(r'^set\(modules ([^)]*)\)$', cmake, re.M)
    assert modules
    for module in modules[1].split():
        path = ROOT / 'tactile_ros' / (module.replace('.', '/') + '.py')
        assert path.exists(), f'{module} is installed as an executable'
        assert 'def main(' in path.read_text()


def fresh(code: str, cwd: Path) -> str:
    """Run code as a new Python in a folder would; the folder comes first on its path."""
    done = subprocess.run(
        [sys.executable, '-c', code], cwd=cwd, check=True, capture_output=True, text=True
    )
    return done.stdout.strip()


@pytest.fixture(scope='module')
def prefix(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An installation of the wheel by pip, far from the sources."""
    pytest.importorskip('setuptools')
    folder = tmp_path_factory.mktemp('wheel')
    source = folder / 'source'
    skipped = shutil.ignore_patterns('__pycache__', 'results')
    for name in ('tactile_ros', *SHARED):
        if (ROOT / name).exists():
            shutil.copytree(ROOT / name, source / name, ignore=skipped)
    for name in ('pyproject.toml', 'setup.py', 'README.md', 'LICENSE'):
        shutil.copy(ROOT / name, source)
    fresh(f'from setuptools import build_meta; build_meta.build_wheel({str(folder)!r})', source)
    (wheel,) = folder.glob('*.whl')
    command = [sys.executable, '-m', 'pip', 'install', '--no-deps', '--no-index', '-I', '--prefix']
    subprocess.run([*command, str(folder / 'prefix'), str(wheel)], check=True, capture_output=True)
    return folder / 'prefix'


def test_a_wheel_carries_all_that_is_read_at_run_time(prefix: Path) -> None:
    share = prefix / 'share' / 'tactile_ros'
    shared = {path.relative_to(ROOT) for name in SHARED for path in (ROOT / name).rglob('*.*')}
    shared = {path for path in shared if not {'__pycache__', 'results'} & set(path.parts)}
    assert {path for path in shared if not (share / path).is_file()} == set()
    (package,) = prefix.rglob('site-packages/tactile_ros')
    own = {path.relative_to(ROOT) for path in (ROOT / 'tactile_ros').rglob('*')}
    own = {path for path in own if (ROOT / path).is_file() and '__pycache__' not in path.parts}
    assert {path for path in own if not (package.parent / path).is_file()} == set()


def test_an_installed_wheel_finds_its_definitions_and_benches(
    prefix: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (package,) = prefix.rglob('site-packages/tactile_ros')
    monkeypatch.setenv('PYTHONPATH', str(package.parent))
    monkeypatch.delenv('AMENT_PREFIX_PATH', raising=False)
    code = (
        'from tactile_ros.cli.bench import folder, names\n'
        'from tactile_ros.evaluation.definitions import message_folder\n'
        'print(message_folder(), folder(), *names(), sep="\\n")'
    )
    share = prefix / 'share' / 'tactile_ros'
    found = fresh(code, prefix).splitlines()
    benches = sorted(path.stem for path in (ROOT / 'benchmarks').glob('[!_]*.py'))
    assert {'reskin', 'roads'} <= {*benches}
    assert found == [str(share / 'msg'), str(share / 'benchmarks'), *benches]


@pytest.mark.ros
@pytest.mark.skipif(not BUILT, reason='the package is not built here')
@pytest.mark.parametrize('cwd', [ROOT, ROOT / 'test', Path('/')], ids=['source', 'test', 'root'])
def test_interfaces_are_found_from_any_folder(cwd: Path) -> None:
    code = 'import tactile_ros.types, tactile_ros.msg as m; print(m.TactileFrame(sequence=3))'
    assert 'sequence=3' in fresh(code, cwd)


@pytest.mark.ros
@pytest.mark.skipif(not BUILT, reason='the package is not built here')
def test_sourced_workspace_has_the_package_and_the_command() -> None:
    script = (
        f'source "{ROOT}/install/setup.bash" && command -v tactile && '
        f'"{sys.executable}" -c "import tactile_ros.msg; print(tactile_ros.__file__)" && '
        f'find -L "{ROOT}/install/tactile_ros/lib/tactile_ros" -type f -executable -printf "%f\\n"'
    )
    environment = {'PATH': '/usr/bin:/bin', 'HOME': str(ROOT / 'out')}
    done = subprocess.run(
        ['bash', '-c', script], env=environment, check=True, capture_output=True, text=True
    )
    assert 'install/tactile_ros/bin/tactile' in done.stdout
    assert 'tactile_ros/__init__.py' in done.stdout
    executables = {'tactile', 'sensor_node', 'contact_node', 'grip_node', 'mock_hand', 'stack'}
    assert executables <= set(done.stdout.split())
