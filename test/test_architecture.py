"""The floors of the house, read from the code's own imports."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import tactile_ros

PACKAGE = Path(tactile_ros.__file__).parent
SOURCES = sorted(PACKAGE.rglob('*.py'))
ROOT = Path(__file__).parents[1]
BENCHES = sorted((ROOT / 'benchmarks').rglob('*.py'))
FLOORS = {
    'physics': 1, 'types': 1, 'errors': 1,
    'conditioning': 2, 'estimators': 2, 'control': 2, 'devices': 2, 'messages': 2,
    'calibration': 2, 'pipeline': 3, 'enrolment': 3,
    'sensors': 4, 'hands': 4, 'simulation': 5, 'evaluation': 5, 'view': 5, 'nodes': 6, 'cli': 6,
}  # fmt: skip
PLAIN = {'calibration', 'types', 'errors', 'pipeline'}  # vocabulary, not rooms
ONLY_IN = {
    'rclpy': ('nodes/',),
    'serial': ('devices/transport.py',),
    'smbus2': ('devices/transport.py',),
    'onnxruntime': ('estimators/embedding.py',),
    'mujoco': ('simulation/',),
    'foxglove': ('view/',),
    'torch': (),
}
BAD_NAMES = {'utils', 'helpers', 'helper', 'common', 'base', 'manager', 'misc'}
PURE = ('physics', 'conditioning', 'estimators', 'control', 'pipeline', 'calibration')


def imports_of(path: Path) -> list[tuple[str, bool]]:
    """Every imported module with whether it is imported at the top of the file."""
    tree = ast.parse(path.read_text())
    found = []
    for node in ast.walk(tree):
        top = node in tree.body
        if isinstance(node, ast.Import):
            found += [(alias.name, top) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f'{path} line {node.lineno}: imports are absolute'
            if node.module == 'tactile_ros':
                found += [(f'tactile_ros.{alias.name}', top) for alias in node.names]
            elif node.module:
                found.append((node.module, top))
    return found


def room_of(path: Path) -> str:
    """First part of a module's name below the package."""
    return path.relative_to(PACKAGE).parts[0].removesuffix('.py')


@pytest.mark.parametrize('path', SOURCES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_imports_run_downward_only(path: Path) -> None:
    room = room_of(path)
    if room == '__init__':
        return
    assert room in FLOORS, f'{path} stands on no floor'
    for name, _ in imports_of(path):
        parts = name.split('.')
        if parts[0] != 'tactile_ros' or len(parts) < 2 or parts[1] not in FLOORS:
            continue
        other = parts[1]
        if room == 'sensors' and other == 'sensors':
            own = path.relative_to(PACKAGE).parts
            shared = (own[1], 'registry', 'regression')
            sibling = len(own) > 2 and len(parts) > 2 and parts[2] not in shared
            assert not sibling, f'{path} imports its neighbour {name}'
        if other == room:
            continue
        lower = FLOORS[other] < FLOORS[room] or other in PLAIN
        allowed = lower or (FLOORS[room] == FLOORS[other] == 6 and room == 'cli')
        assert allowed, f'{path} (floor {FLOORS[room]}) imports {name} (floor {FLOORS[other]})'


@pytest.mark.parametrize('path', SOURCES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_heavy_packages_stay_in_their_room(path: Path) -> None:
    inside = str(path.relative_to(PACKAGE))
    for name, top in imports_of(path):
        package = name.split('.')[0]
        if package in ONLY_IN:
            rooms = ONLY_IN[package]
            assert inside.startswith(rooms or ('-',)), f'{inside} must not import {name}'
            lazy_needed = package != 'rclpy'
            assert not (top and lazy_needed), f'{inside} must import {name} where it is used'


@pytest.mark.parametrize('path', SOURCES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_names_sizes_and_purity(path: Path) -> None:
    inside = str(path.relative_to(PACKAGE))
    text = path.read_text()
    assert path.stem not in BAD_NAMES, f'{inside}: the name says nothing'
    tree = ast.parse(text)
    assert ast.get_docstring(tree), f'{inside} must say what it is in its first line'
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            printing = node.func.id == 'print' and room_of(path) != 'cli'
            script = path.stem == 'convert'
            assert not printing or script, f'{inside}:{node.lineno} prints outside cli/'
    if room_of(path) in PURE:
        used = {name.split('.')[0] for name, _ in imports_of(path)}
        assert not used & {'time', 'random', 'datetime'}, f'{inside} reads a clock or chance'


def test_nothing_unpickles() -> None:
    for path in SOURCES:
        names = {name.split('.')[0] for name, _ in imports_of(path)}
        assert not names & {'pickle', 'marshal', 'shelve', 'dill'}, path
        assert 'allow_pickle=True' not in path.read_text(), path
