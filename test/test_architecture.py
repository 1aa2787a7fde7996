# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Rules of the source tree: floors, budgets, names, sizes; exceptions stand in allowed.json."""

import ast

import house
import pytest

FLOORS = {
    'types': 1, 'physics': 1, 'errors': 1, '__init__': 1,
    'conditioning': 2, 'estimators': 2, 'control': 2, 'devices': 2, 'messages': 2,
    'calibration': 2, 'files': 1, 'pipeline': 3, 'enrolment': 4, 'sensors': 5, 'hands': 5,
    'simulation': 6, 'evaluation': 6, 'view': 6, 'nodes': 7, 'cli': 7,
    'notebook': 7, '__main__': 8,
}  # fmt: skip
SHARED = {'types', 'errors', '__init__'}  # words that every room uses
ONLY_IN = {
    'rclpy': ('nodes/',), 'serial': ('devices/transport',), 'smbus2': ('devices/transport',),
    'onnxruntime': ('estimators/embedding',), 'mujoco': ('simulation/',), 'foxglove': ('view/',),
    'sklearn': ('estimators/',), 'matplotlib': ('evaluation/figures',), 'torch': (),
    'pyarrow': ('evaluation/',),
}  # fmt: skip
BAD_NAMES = {'utils', 'helpers', 'helper', 'common', 'base', 'manager', 'misc'}
PURE = ('physics', 'conditioning', 'estimators', 'control', 'pipeline', 'calibration')


def room_of(module: str) -> str:
    """First part of a module's path."""
    return module.split('/', maxsplit=1)[0]


def climbing() -> list[str]:
    """Imports that do not run downward, as `module -> module`."""
    found = []
    for module, others in house.graph().items():
        room = room_of(module)
        for other in others:
            target = room_of(other)
            one, two = module.split('/'), other.split('/')
            apart = one[0] == 'sensors' and len(one) == len(two) == 3 and one[1] != two[1]
            if target in SHARED or (target == room and not apart):
                continue
            # the front door imports what it is asked for; the command line starts nodes
            if room == '__init__' or (room, target) == ('cli', 'nodes'):
                continue
            if FLOORS[target] >= FLOORS[room]:
                found.append(f'{module} -> {other}')
    return sorted(found)


def imports() -> list[tuple[str, str, bool]]:
    """Modules, packages that they import, and whether at the top of the file."""
    found = []
    for module, node in house.nodes():
        if not isinstance(node, (ast.Import, ast.ImportFrom)):
            continue
        top = node.col_offset == 0
        if isinstance(node, ast.Import):
            found += [(module, alias.name.split('.')[0], top) for alias in node.names]
        else:
            assert node.level == 0, f'{module} line {node.lineno}: imports are absolute'
            found.append((module, (node.module or '').split('.')[0], top))
    return found


def test_every_module_stands_on_a_floor() -> None:
    assert {room_of(module) for module in house.modules()} <= FLOORS.keys()


def test_imports_run_downward() -> None:
    assert climbing() == house.allowed()['climbing']


@pytest.mark.parametrize('rule', sorted(house.RULES))
def test_rules_have_only_the_listed_exceptions(rule: str) -> None:
    listed, broken = set(house.allowed()[rule]), set(house.RULES[rule]())
    assert broken <= listed, f'new: {sorted(broken - listed)[:20]}'
    assert listed <= broken, f'run `python test/house.py --shrink`: {sorted(listed - broken)[:20]}'


def test_budgets_are_kept() -> None:
    listed, broken = house.allowed()['budgets'], house.over_budget()
    assert broken.keys() <= listed.keys()
    for place, lines in broken.items():
        assert lines <= listed[place], f'{place} has {lines} lines; {listed[place]} are allowed'


def test_heavy_packages_stay_in_their_room() -> None:
    for module, package, top in imports():
        if package in ONLY_IN:
            assert module.startswith(ONLY_IN[package] or '-'), f'{module} imports {package}'
            assert not (top and package != 'rclpy'), f'{module} imports {package} where it is used'


def test_pure_rooms_read_no_clock_and_no_chance() -> None:
    for module, package, _ in imports():
        pure = room_of(module) in PURE
        assert not (pure and package in ('time', 'random', 'datetime')), f'{module}: {package}'


def test_modules_say_what_they_are() -> None:
    for module, tree in house.modules().items():
        assert ast.get_docstring(tree), f'{module} has no docstring'
        assert module.rsplit('/', 1)[-1] not in BAD_NAMES, f'{module}: the name says nothing'


def test_covariances_are_scaled_in_one_file_alone() -> None:
    for module, node in house.nodes():
        if isinstance(node, ast.AugAssign) and isinstance(node.op, (ast.Mult, ast.Div)):
            free = module == 'estimators/covariance' or 'cov' not in ast.unparse(node.target)
            assert free, f'{module} line {node.lineno}: estimators/covariance scales'
