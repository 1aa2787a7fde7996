# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The package as ROS and pip see it: one version, every interface, found from everywhere."""

import ast
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from functools import cache
from pathlib import Path

import pytest

import tactile_ros
from tactile_ros.nodes.__main__ import NODES

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
    names = re.search(r'^set\(executables ([^)]*)\)$', cmake, re.M)
    assert names
    assert set(names[1].split()) == {'tactile', *NODES}
    for module, builder in NODES.values():
        text = (ROOT / 'tactile_ros' / 'nodes' / f'{module}.py').read_text()
        assert re.search(rf'^(def|class) {builder}\b', text, re.M)


def test_pixi_names_what_the_package_depends_on() -> None:
    pixi = (ROOT / 'pixi.toml').read_text()
    project = (ROOT / 'pyproject.toml').read_text()
    package = ET.parse(ROOT / 'package.xml')
    ros = [one.text or '' for kind in ('depend', 'exec_depend') for one in package.iter(kind)]
    for name in (name for name in ros if not name.startswith(('python3', 'launch', 'rosidl'))):
        assert f'ros-kilted-{name.replace("_", "-")} = ' in pixi
    for extra in ('devices', 'cli', 'evaluation', 'embedding'):
        listed = re.search(rf'^{extra} = \[(.*)\]$', project, re.M)
        assert listed
        for name in re.findall(r"'([\w-]+)", listed[1]):
            assert f'\n{name} = ' in pixi


def test_recordings_of_the_independent_world_are_not_installed() -> None:
    installed = (ROOT / 'CMakeLists.txt').read_text(), (ROOT / 'pyproject.toml').read_text()
    assert (ROOT / 'benchmarks' / 'independent' / 'data').is_dir()
    assert 'PATTERN independent EXCLUDE' in installed[0]
    assert 'benchmarks/independent' not in installed[1]


# Where a distribution has another name than its module.
MODULES = {
    'foxglove_sdk': 'foxglove', 'pillow': 'PIL', 'pyserial': 'serial', 'pyyaml': 'yaml',
    'scikit_learn': 'sklearn',
}  # fmt: skip
# Declared without an import: what starts nodes, tests and builds, and what bags are written with.
STARTED = {
    'action_msgs': 'goals of actions carry its messages',
    'lifecycle_msgs': 'states of lifecycle nodes are its messages',
    'ros2bag': 'the command `ros2 bag`, which reads and writes the same bags',
    'ros2launch': 'the command `ros2 launch`',
    'rosbag2_storage_mcap': 'its plugin for them',
    'rosidl_default_runtime': 'libraries of the generated messages',
    'tf2_ros': 'its static_transform_publisher is started by launch files',
}
LOADERS = ('import_module', 'load_package')
TOOLS = {
    'mkdocs_material', 'mkdocstrings_python', 'mypy', 'pytest_xdist', 'ruff', 'types_pyserial',
    'types_pyyaml', 'xacro',
}  # fmt: skip


def called(function: ast.expr) -> str:
    """Last part of a function's name."""
    if isinstance(function, ast.Attribute):
        return function.attr
    return function.id if isinstance(function, ast.Name) else ''


@cache
def imported_by(path: Path) -> set[str]:
    """Modules that a source imports, also by their name as a text."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module)
        elif isinstance(node, ast.Call) and called(node.func) in LOADERS:
            found |= {arg.value for arg in node.args[:1] if isinstance(arg, ast.Constant)}
    return found


def imported(*folders: str) -> set[str]:
    """Top-level modules that the sources of folders import, also by their name as a text."""
    found: set[str] = set()
    for folder in folders:
        for path in (ROOT / folder).rglob('*.py'):
            found |= imported_by(path)
    places = ('benchmarks', 'docs', 'test')
    own = {path.stem for place in places for path in (ROOT / place).rglob('*.py')}
    own |= {*places, 'tactile_ros', 'reference', 'worlds', 'harness', 'google', 'outer_rows'}
    top = {name.split('.')[0] for name in found}
    return top - {*sys.stdlib_module_names} - own


def modules(requirements: Iterable[str]) -> set[str]:
    """Modules of requirements such as `mujoco>=3.3`."""
    names = {re.split(r'[\[<>=; ]', line)[0].lower().replace('-', '_') for line in requirements}
    return {MODULES.get(name, name) for name in names if name and not name.startswith('#')}


def lock(name: str) -> list[str]:
    return (ROOT / 'bootstrap' / 'locks' / f'{name}.in').read_text().splitlines()


def ros_packages(*tags: str) -> set[str]:
    tree = ET.parse(ROOT / 'package.xml')
    return {element.text or '' for tag in tags for element in tree.iter(tag)}


def test_dependencies_are_imported_and_declared() -> None:
    tomllib = pytest.importorskip('tomllib')
    project = tomllib.loads((ROOT / 'pyproject.toml').read_text())['project']
    extras = project['optional-dependencies']
    declared = modules(
        [*project['dependencies'], *(one for each in extras.values() for one in each)]
    )
    ros = ros_packages('depend', 'exec_depend')
    ros_modules = {name for name in ros if not name.startswith('python3-')}
    product = imported('tactile_ros', 'training', 'launch')
    assert declared - product == set(), 'declared in pyproject.toml and imported nowhere'
    assert product - declared - ros_modules == set(), 'imported and declared nowhere'
    assert ros_modules - product <= set(STARTED), 'declared in package.xml and imported nowhere'
    of_debian = modules(name.removeprefix('python3-') for name in ros - ros_modules)
    assert of_debian <= declared | {'serial', 'yaml'}
    assert modules(project['dependencies']) <= of_debian


def test_lock_files_hold_what_is_imported() -> None:
    tomllib = pytest.importorskip('tomllib')
    project = tomllib.loads((ROOT / 'pyproject.toml').read_text())['project']
    extras = project['optional-dependencies']
    demo = [*project['dependencies']]
    for extra in ('cli', 'devices', 'embedding', 'evaluation', 'numba'):
        demo += extras.get(extra, [])
    core = modules(lock('core'))
    assert core == modules(demo)
    tested = modules(lock('test'))
    anywhere = imported('tactile_ros', 'benchmarks', 'test')
    assert tested - TOOLS <= anywhere
    of_ros = {
        name.replace('-', '_') for name in ros_packages('depend', 'exec_depend', 'test_depend')
    }
    untested = modules(extras['train'] + extras['notebook'] + extras['export'])
    missing = anywhere - core - tested - of_ros - untested - {'packaging'}
    assert missing == set()


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
    left_out = {'__pycache__', 'results', 'independent'}
    shared = {path for path in shared if not left_out & set(path.parts)}
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
        'from tactile_ros.evaluation.bag import message_folder\n'
        'print(message_folder(), folder(), *names(), sep="\\n")'
    )
    share = prefix / 'share' / 'tactile_ros'
    found = fresh(code, prefix).splitlines()
    benches = sorted(path.stem for path in (ROOT / 'benchmarks').glob('[!_]*.py'))
    assert {'reskin', 'roads'} <= {*benches}
    assert found == [str(share / 'msg'), str(share / 'benchmarks'), *benches]
    assert not (share / 'benchmarks' / 'independent').exists()


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


def test_every_source_states_copyright_and_licence() -> None:
    line = 'Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0'
    folders = ('tactile_ros', 'benchmarks', 'bootstrap', 'docs', 'launch', 'test', 'training')
    kinds = r'\.(py|ya?ml|toml|js|css|html|msg|srv|action|xacro|rviz|ino|h|cpp|cff|xml)'
    roots = [ROOT / folder for folder in (*folders, 'config', 'msg', 'srv', 'action')]
    files = [path for root in roots for path in root.rglob('*') if 'results' not in path.parts]
    sources = [path for path in (*ROOT.glob('*'), *files) if re.fullmatch(kinds, path.suffix)]
    sources += [ROOT / 'CMakeLists.txt', ROOT / 'Makefile', ROOT / '.ci' / 'run']
    assert [path for path in sources if line not in path.read_text()[:300]] == []
