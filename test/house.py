# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Budgets and rules of the source tree, read from its text: `make lines` prints the table.

`test_architecture.py` asserts the rules. What breaks one of them today stands in `allowed.json`,
which only shrinks: `python test/house.py --shrink` takes out what no longer breaks it.
"""

import ast
import json
import re
import sys
from collections import Counter
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / 'tactile_ros'
ALLOWED = Path(__file__).with_name('allowed.json')
# Lines of Python, docstrings included. To raise one is a decision: say why in the commit.
BUDGETS = {
    'types': 850, 'errors': 50, 'calibration': 270, 'messages': 300, 'pipeline': 360,
    'enrolment': 180, 'files': 130, 'physics': 1_900, 'conditioning': 1_200, 'estimators': 4_600,
    'sensors': 5_300, 'devices': 3_200, 'control': 1_000, 'hands': 900, 'nodes': 3_300,
    'evaluation': 2_100, 'simulation': 1_200, 'view': 780,  # 530 more for the browser's page
    'notebook': 240, 'cli': 1_270, 'bootstrap': 500, 'benchmarks': 4_500,
    'test': 15_000,
}  # fmt: skip
PRODUCT, MODULES, LONELY = 28_000, 160, 15
SENSOR_FILES = 7
SENSOR_NAMES = {'__init__', 'config', 'estimation', 'twin', 'device'}
ENTRY_POINTS = {'__init__', '__main__', 'main'}
SHORT = 150
FIRST_WORDS = ('What', 'Of', 'Whether', 'How', 'Where', 'Who', 'Why', 'That')


def key_of(path: Path) -> str:
    """Path of a module below the package."""
    return path.relative_to(PACKAGE).with_suffix('').as_posix()


@cache
def modules() -> dict[str, ast.Module]:
    """Syntax tree of every module of the package by its path."""
    return {key_of(path): ast.parse(path.read_text()) for path in sorted(PACKAGE.rglob('*.py'))}


@cache
def nodes() -> tuple[tuple[str, ast.AST], ...]:
    """Every node of every module, with the module's path: walked once for all rules."""
    return tuple((name, node) for name, tree in modules().items() for node in ast.walk(tree))


def lines_of(place: str) -> int:
    """Lines of Python below a folder, or of a module."""
    found = PACKAGE / place
    if place in ('bootstrap', 'benchmarks', 'test'):
        found = ROOT / place
    paths = found.rglob('*.py') if found.is_dir() else [found.with_suffix('.py')]
    return sum(path.read_text().count('\n') for path in paths if path.exists())


def product_lines() -> int:
    """Lines of the package."""
    return sum(path.read_text().count('\n') for path in PACKAGE.rglob('*.py'))


def imported(tree: ast.Module) -> set[str]:
    """Modules of the package that a module imports, those for types included."""
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or '').startswith('tactile_ros'):
            names.add(node.module or '')
            names |= {f'{node.module}.{alias.name}' for alias in node.names}
        elif isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names if alias.name.startswith('tactile_ros.')}
    parts = {name.removeprefix('tactile_ros.').replace('.', '/') for name in names}
    found = set()
    for part in parts:
        found |= {part} & modules().keys()
        if f'{part}/__init__' in modules():
            found.add(f'{part}/__init__')
    return found


@cache
def graph() -> dict[str, frozenset[str]]:
    """Modules by the modules that they import."""
    return {name: frozenset(imported(tree) - {name}) for name, tree in modules().items()}


def circles() -> list[str]:
    """Modules that import one another around a circle, one entry a module."""
    reach: dict[str, set[str]] = {name: set(others) for name, others in graph().items()}
    for middle, beyond in reach.items():
        for name, others in reach.items():
            if middle in others:
                reach[name] = others | beyond
    return sorted(name for name, others in reach.items() if name in others)


def is_command(name: str) -> bool:
    """Module of a command of `tactile`."""
    body = modules()[name].body
    functions = {node.name for node in body if isinstance(node, ast.FunctionDef)}
    return name.startswith('cli/') and {'add_arguments', 'run'} <= functions


def lonely() -> list[str]:
    """Short modules with a single importer, which stands in their own folder.

    Commands and the fixed files of a sensor's folder are found by their names.
    """
    importers: dict[str, set[str]] = {}
    for name, others in graph().items():
        for other in others:
            importers.setdefault(other, set()).add(name)
    found = []
    for name, users in importers.items():
        folder, _, stem = name.rpartition('/')
        fixed = ENTRY_POINTS | (SENSOR_NAMES if folder.startswith('sensors/') else set())
        short = lines_of(name) < SHORT and stem not in fixed and not is_command(name)
        if short and len(users) == 1 and next(iter(users)).rpartition('/')[0] == folder:
            found.append(name)
    return sorted(found)


def large_sensors() -> list[str]:
    """Sensors with more modules than seven, or more than three of names of their own."""
    found = []
    for folder in sorted(path for path in (PACKAGE / 'sensors').iterdir() if path.is_dir()):
        stems = {path.stem for path in folder.glob('*.py')}
        if len(stems) > SENSOR_FILES or len(stems - SENSOR_NAMES) > SENSOR_FILES - 4:
            found.append(folder.name)
    return found


def words_of(name: str) -> set[str]:
    """Words of an identifier in lower case, without numbers and single letters."""
    parts = re.findall(r'[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+', name)
    return {part.lower() for part in parts if len(part) > 2}


def public_names() -> dict[str, set[str]]:
    """Words of modules, public classes and public functions by the modules that use them."""
    found: dict[str, set[str]] = {}
    names = [(module, module.rsplit('/', 1)[-1]) for module in modules()]
    for module, node in nodes():
        if isinstance(node, (ast.ClassDef, ast.FunctionDef)) and node.name[0] != '_':
            names.append((module, node.name))
    for module, name in names:
        for word in words_of(name):
            found.setdefault(word, set()).add(module)
    return found


def foreign_words() -> list[str]:
    """Words of public names that docs/glossary.md does not have."""
    text = (ROOT / 'docs' / 'glossary.md').read_text().lower()
    known = set(re.findall(r'[a-z]+', text))
    return sorted(word for word in public_names() if word not in known)


def probes() -> list[str]:
    """Modules that probe for attributes where a contract has a default."""
    found = []
    for module, node in nodes():
        called = isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
        if not (called and node.func.id in ('getattr', 'hasattr') and node.args):
            continue
        text = ast.unparse(node.args[0]).lower()
        if re.search(r'\b(self\.)?_?(estimation|pipeline|device|estimator)\b', text):
            found.append(module)
    return sorted(set(found))


def bundles() -> list[str]:
    """Functions with a tuple of several kinds as an argument."""
    found = []
    for module, node in nodes():
        if not isinstance(node, ast.FunctionDef):
            continue
        for arg in (*node.args.args, *node.args.kwonlyargs):
            text = '' if arg.annotation is None else ast.unparse(arg.annotation)
            inside = re.match(r'tuple\[(.*)\]$', text)
            kinds = {part.strip() for part in (inside[1] if inside else '').split(',')}
            if len(kinds - {'...'}) > 1:
                found.append(f'{module}.{node.name}')
    return sorted(set(found))


def large() -> list[str]:
    """Modules above 800 lines, functions above 80, classes more than two levels deep."""
    found = [name for name in modules() if lines_of(name) > 800]
    bases: dict[str, list[str]] = {}
    for module, node in nodes():
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            if (node.end_lineno or 0) - node.lineno > 80:
                found.append(f'{module}.{node.name}')
        elif isinstance(node, ast.ClassDef):
            bases[node.name] = [ast.unparse(base).split('[')[0] for base in node.bases]

    def depth(name: str, seen: tuple[str, ...] = ()) -> int:
        above = [base for base in bases.get(name, []) if base in bases and base not in seen]
        return 1 + max((depth(base, (*seen, name)) for base in above), default=-1)

    return sorted(found + [name for name in bases if depth(name) > 2])


def strange_docstrings() -> list[str]:
    """Definitions whose docstring begins neither with a noun phrase nor with an imperative."""
    found = []
    for module, node in nodes():
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)):
            first = (ast.get_docstring(node) or '').split(' ', 1)[0].rstrip(',:')
            if first in FIRST_WORDS:
                found.append(f'{module}.{getattr(node, "name", "")}'.rstrip('.'))
    return sorted(set(found))


RULES = {
    'circles': circles, 'lonely': lonely, 'large_sensors': large_sensors,
    'foreign_words': foreign_words, 'probes': probes, 'bundles': bundles, 'large': large,
    'strange_docstrings': strange_docstrings,
}  # fmt: skip


def over_budget() -> dict[str, int]:
    """Lines of every place that exceeds its budget."""
    return {place: n for place, most in BUDGETS.items() if (n := lines_of(place)) > most}


def allowed() -> dict[str, dict[str, int] | list[str]]:
    """Today's exceptions of every rule, and lines of what exceeds its budget."""
    return json.loads(ALLOWED.read_text())


def shrink() -> None:
    """Take out of the exceptions what no longer breaks its rule."""
    before = allowed()
    after: dict[str, object] = {
        name: sorted(set(rule()) & set(before[name])) for name, rule in RULES.items()
    }
    now = over_budget()
    after['climbing'] = before['climbing']
    after['budgets'] = {
        place: min(now[place], most) for place, most in before['budgets'].items() if place in now
    }
    ALLOWED.write_text(json.dumps(after, indent=1) + '\n')


def table() -> str:
    """Lines, budgets and files of every place."""
    rows = [f'{"place":14s} {"lines":>7s} {"budget":>7s} {"files":>6s}']
    for place, most in BUDGETS.items():
        folder = (ROOT if place in ('bootstrap', 'benchmarks', 'test') else PACKAGE) / place
        files = len(list(folder.rglob('*.py'))) if folder.is_dir() else 1
        mark = '  over' if lines_of(place) > most else ''
        rows.append(f'{place:14s} {lines_of(place):7d} {most:7d} {files:6d}{mark}')
    rows.append(f'{"product":14s} {product_lines():7d} {PRODUCT:7d} {len(modules()):6d}')
    counts = Counter({name: len(rule()) for name, rule in RULES.items()})
    rows.append('exceptions: ' + ', '.join(f'{name} {n}' for name, n in counts.items()))
    return '\n'.join(rows)


if __name__ == '__main__':
    if '--shrink' in sys.argv:
        shrink()
    print(table())
