# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Set-up: sentences instead of tracebacks, nothing half made, nothing done twice."""

import ast
import importlib.util
import os
import re
import runpy
import sys
import types
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
BOOTSTRAP = ROOT / 'bootstrap'
LOCKS = BOOTSTRAP / 'locks'
DISTROS = ('kilted', 'jazzy')
Load = Callable[[str], types.ModuleType]
Filled = tuple[types.ModuleType, list[list[str]]]
Patch = pytest.MonkeyPatch
Capture = pytest.CaptureFixture[str]


@pytest.fixture
def load(monkeypatch: Patch) -> Load:
    """Import a module of bootstrap/, as its scripts do, and forget it afterwards."""
    monkeypatch.syspath_prepend(str(BOOTSTRAP))
    for path in BOOTSTRAP.glob('*.py'):
        monkeypatch.delitem(sys.modules, path.stem, raising=False)

    def load_module(name: str) -> types.ModuleType:
        return importlib.import_module(name)

    return load_module


def entries(name: str) -> list[str]:
    text = (LOCKS / f'{name}.txt').read_text()
    return [entry for entry in re.split(r'\n(?=\S)', text.strip()) if not entry.startswith('#')]


# The machine


@pytest.mark.parametrize('version', [(3, 9, 18), (3, 15, 0)])
def test_unsupported_python_is_one_sentence(version: tuple[int, ...], monkeypatch: Patch) -> None:
    ast.parse((BOOTSTRAP / 'configure.py').read_text(), feature_version=(3, 7))
    monkeypatch.setattr(sys, 'version_info', version)
    with pytest.raises(SystemExit, match=rf'^Python 3\.{version[1]} is not supported: .*PYTHON='):
        runpy.run_path(str(BOOTSTRAP / 'configure.py'))


def without(machine: types.ModuleType, what: str, patch: Patch, folder: Path) -> None:
    """A machine that lacks something, checked."""
    if what == 'processor':
        patch.setattr(machine.platform, 'machine', lambda: 'aarch64')
    elif what == 'venv':
        patch.setattr(importlib.util, 'find_spec', lambda name: None)
    elif what == 'compiler':
        patch.setenv('PATH', str(folder))
        patch.delenv('CC', raising=False)
    elif what == 'given compiler':
        patch.setenv('CXX', 'no-such-compiler -O2')
    else:
        patch.setattr(machine.sysconfig, 'get_path', lambda name: str(folder / 'none'))
        patch.setattr(machine, 'fetch_package', lambda name, folder: None)
        machine.python_headers(folder)
    machine.check_machine()


@pytest.mark.parametrize(
    ('what', 'sentence'),
    [
        ('processor', 'this is Linux aarch64: source an installed ROS'),
        ('venv', r'apt install python3\.\d+-venv'),
        ('compiler', 'No C compiler was found: install one'),
        ('given compiler', 'CXX=no-such-compiler'),
        ('headers', r'apt install python3\.\d+-dev'),
    ],
)
def test_machine_says_what_it_lacks(
    what: str, sentence: str, load: Load, monkeypatch: Patch, tmp_path: Path
) -> None:
    machine = load('machine')
    with pytest.raises(machine.SetupError, match=sentence):
        without(machine, what, monkeypatch, tmp_path)


def test_headers_are_taken_from_an_unpacked_package(
    load: Load, monkeypatch: Patch, tmp_path: Path
) -> None:
    machine = load('machine')
    monkeypatch.setattr(machine.sysconfig, 'get_path', lambda name: str(tmp_path / 'none'))

    def fetch(name: str, folder: Path) -> None:
        assert name == f'lib{machine.python_name()}-dev'
        include = folder / 'usr' / 'include' / machine.python_name()
        include.mkdir(parents=True)
        (include / 'Python.h').touch()

    monkeypatch.setattr(machine, 'fetch_package', fetch)
    include = tmp_path / 'usr' / 'include'
    assert machine.python_headers(tmp_path) == [include / machine.python_name(), include]


# The environment


def test_failure_leaves_no_environment(load: Load, monkeypatch: Patch, tmp_path: Path) -> None:
    environment, venv = load('environment'), tmp_path / '.venv'

    def fail(folder: Path, locks: list[str], log: Path) -> None:
        folder.mkdir()
        (folder / 'half').touch()
        raise KeyboardInterrupt

    monkeypatch.setattr(environment, 'fill_environment', fail)
    with pytest.raises(KeyboardInterrupt):
        environment.make_environment(venv, ['tools'], 'kilted', tmp_path / 'log')
    assert not venv.exists()


@pytest.fixture
def filled(load: Load, monkeypatch: Patch) -> Filled:
    """The environment module with a set-up that takes no time, and how often it ran."""
    environment, calls = load('environment'), []

    def fill(folder: Path, locks: list[str], log: Path) -> None:
        folder.mkdir()
        (folder / environment.MARK).touch()
        calls.append(locks)

    monkeypatch.setattr(environment, 'fill_environment', fill)
    return environment, calls


def test_environment_is_made_once(filled: Filled, tmp_path: Path) -> None:
    environment, calls = filled
    arguments = (tmp_path / '.venv', ['tools'], 'kilted', tmp_path / 'log')
    assert [environment.make_environment(*arguments) for _ in range(3)] == [True, False, False]
    assert len(calls) == 1


def test_environment_is_made_again_where_it_must(
    filled: Filled, tmp_path: Path, capsys: Capture
) -> None:
    environment, calls = filled
    venv, log = tmp_path / '.venv', tmp_path / 'log'
    venv.mkdir()
    with pytest.raises(environment.SetupError, match='was not made by this set-up'):
        environment.make_environment(venv, ['tools'], 'kilted', log)
    (venv / environment.MARK).touch()  # what a kill leaves: begun, never finished
    for distro in DISTROS:
        environment.make_environment(venv, ['tools'], distro, log)
    assert len(calls) == 2
    said = capsys.readouterr().out
    assert 'left half made' in said
    assert 'distro changes from kilted to jazzy: .venv and install are built again' in said


def test_sourced_ros_is_left_out_as_in_the_makefile(load: Load, monkeypatch: Patch) -> None:
    monkeypatch.setenv('AMENT_PREFIX_PATH', '/somewhere')
    monkeypatch.setenv('ROS_DOMAIN_ID', '7')
    environment = load('environment').clean_environment()
    assert 'AMENT_PREFIX_PATH' not in environment
    assert environment['ROS_DOMAIN_ID'] == '7'
    text = (ROOT / 'Makefile').read_text().replace('\\\n', ' ')
    listed = re.search(r'^SOURCED := (.*)$', text, re.M)
    assert listed
    assert set(listed[1].split()) == set(load('environment').SOURCED)


def test_failed_command_is_one_sentence(load: Load, tmp_path: Path) -> None:
    progress, log = load('progress'), tmp_path / 'log' / 'setup.log'
    code = 'print("ERROR: No matching distribution"); print("noise"); raise SystemExit(1)'
    command = [sys.executable, '-c', code]
    with pytest.raises(progress.SetupError, match='failed: ERROR: No matching distribution'):
        progress.run(command, log=log, what='Installing', env=dict(os.environ))


# The lock files


@pytest.mark.parametrize('distro', DISTROS)
@pytest.mark.parametrize('minor', range(10, 15))
def test_locks_name_one_version_of_each_package(distro: str, minor: int) -> None:
    from packaging.requirements import Requirement

    machine = {
        'python_version': f'3.{minor}',
        'python_full_version': f'3.{minor}.0',
        'sys_platform': 'linux',
        'platform_machine': 'x86_64',
        'platform_python_implementation': 'CPython',
    }
    versions: dict[str, str] = {}
    for lock in ('tools', 'core', distro):
        for entry in entries(lock):
            requirement = Requirement(entry.split(' \\')[0])
            if requirement.marker is None or requirement.marker.evaluate(machine):
                assert str(requirement.specifier).startswith('==')
                version = versions.setdefault(requirement.name, str(requirement.specifier))
                assert version == str(requirement.specifier)
    assert {'numpy', 'scipy', 'onnxruntime', 'ros-rclpy', 'colcon-core', 'pip'} <= set(versions)


@pytest.mark.parametrize('lock', ['tools', 'core', 'test', *DISTROS])
def test_every_entry_has_hashes(lock: str) -> None:
    assert entries(lock)
    for entry in entries(lock):
        assert re.search(r'--hash=sha256:[0-9a-f]{64}$', entry), entry.split('\n')[0]


def test_core_and_ros_bring_no_test_tools_and_nothing_brings_pytorch() -> None:
    first = {lock: {entry.split('=')[0] for entry in entries(lock)} for lock in ('core', 'test')}
    assert not first['core'] & {'hypothesis', 'magpylib', 'scikit-learn'}
    assert {'hypothesis', 'magpylib', 'scikit-learn', 'pytest'} <= first['test']
    assert all('torch' not in names for names in first.values())


# The build


@pytest.fixture
def source(tmp_path: Path) -> Path:
    for name, text in {
        'package.xml': '<package/>',
        'CMakeLists.txt': '',
        'msg/A.msg': 'bool a',
        'tactile_ros/__init__.py': '',
        'config/a.yaml': '',
    }.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


def test_edited_source_needs_no_build(load: Load, source: Path) -> None:
    before = load('workspace').state(source)
    (source / 'tactile_ros' / '__init__.py').write_text('x = 1')
    (source / 'tactile_ros' / '__pycache__').mkdir()
    (source / 'tactile_ros' / '__pycache__' / 'a.pyc').touch()
    assert load('workspace').state(source) == before


@pytest.mark.parametrize('path', ['msg/A.msg', 'msg/B.msg', 'launch/a.py', 'CMakeLists.txt'])
def test_interface_and_new_file_need_a_build(load: Load, source: Path, path: str) -> None:
    before = load('workspace').state(source)
    (source / path).parent.mkdir(exist_ok=True)
    (source / path).write_text('int8 b')
    assert load('workspace').state(source) != before


def test_build_runs_once(load: Load, source: Path, monkeypatch: Patch, capsys: Capture) -> None:
    workspace, calls = load('workspace'), []

    def colcon(root: Path, venv: Path, log: Path) -> None:
        (root / 'install').mkdir(exist_ok=True)
        calls.append(root)

    monkeypatch.setattr(workspace, 'colcon', colcon)
    monkeypatch.setattr(workspace, 'join', lambda root, venv: None)
    arguments = (source, source / '.venv', source / 'log')
    assert [workspace.build(*arguments) for _ in range(3)] == [True, False, False]
    (source / 'install' / 'kept').touch()
    (source / 'config' / 'b.yaml').touch()
    assert workspace.build(*arguments)
    assert (source / 'install' / 'kept').exists()  # builds on what is there
    assert len(calls) == 2


def test_failed_build_is_not_taken_for_finished(
    load: Load, source: Path, monkeypatch: Patch
) -> None:
    workspace, error = load('workspace'), load('machine').SetupError('no')

    def fail(root: Path, venv: Path, log: Path) -> None:
        (root / 'install').mkdir(exist_ok=True)
        raise error

    monkeypatch.setattr(workspace, 'colcon', fail)
    arguments = (source, source / '.venv', source / 'log')
    with pytest.raises(type(error)):
        workspace.build(*arguments)
    (source / 'install' / 'half').touch()
    with pytest.raises(type(error)):
        workspace.build(*arguments)
    assert not (source / 'install' / workspace.STAMP).exists()
    assert not (source / 'install' / 'half').exists()


def test_links_to_removed_sources_go(load: Load, tmp_path: Path) -> None:
    (tmp_path / 'there').touch()
    for name in ('there', 'gone'):
        (tmp_path / f'to_{name}').symlink_to(tmp_path / name)
    load('workspace').prune(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ['there', 'to_there']
