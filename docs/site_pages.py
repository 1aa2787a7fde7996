# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Pages made from the repository: home, interfaces, parameters, API and design of the site.

`python docs/site_pages.py` writes docs/results.md and its picture anew from the golden figures.
"""

from __future__ import annotations

import ast
import dataclasses
import json
import re
import sys
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.files import Files

ROOT = Path(__file__).parents[1]
API = {
    'In a notebook': ('tactile_ros.notebook',),
    'Sensors': ('tactile_ros.sensors.load_sensor', 'tactile_ros.sensors.list_sensors',
                'tactile_ros.sensors.SensorSpec'),
    'Recordings and frames': ('tactile_ros.types.Recording', 'tactile_ros.types.Frame',
                              'tactile_ros.types.Outline',
                              'tactile_ros.evaluation.recording_files'),
    'Pipeline': ('tactile_ros.pipeline.Pipeline',),
    'Contacts': ('tactile_ros.types.ContactState', 'tactile_ros.types.ContactStates',
                 'tactile_ros.types.Contact'),
    'Messages': ('tactile_ros.messages',),
    'Published methods': (
        'tactile_ros.estimators.few_shot', 'tactile_ros.estimators.grid_knn',
        'tactile_ros.estimators.polynomial_force', 'tactile_ros.estimators.object_pose',
        'tactile_ros.estimators.rbf_force',
    ),
    'Estimation': ('tactile_ros.estimators.model_inversion', 'tactile_ros.estimators.regression',
                   'tactile_ros.estimators.covariance'),
    'Grip control': ('tactile_ros.control.grip_force', 'tactile_ros.control.force_pi'),
    'Sensor of your own': ('tactile_ros.types.contracts',),
}  # fmt: skip
# links to files that are no pages of the site: they stay as names
LEFT_OUT = re.compile(
    r'\[([^]]+)\]\((CHANGELOG\.rst|CITATION\.cff|QUALITY_DECLARATION\.md|LICENSE|benchmarks/[^)]*)\)'
)
LONGEST_DEFAULT = 40  # of a parameter in its table


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that are made; called by mkdocs."""
    from mkdocs.structure.files import File

    for name, text in made_pages().items():
        files.append(File.generated(config, name, content=text))
    return files


def made_pages() -> dict[str, str]:
    """Text of every page that is made, by its name."""
    sys.path[:0] = [str(ROOT), str(ROOT / 'test')]
    pages: dict[str, Callable[[], str]] = {
        'index.md': lambda: moved('README.md'),
        'contributing.md': lambda: moved('CONTRIBUTING.md'),
        'ros_reference.md': ros_reference,
        'api.md': api,
        'design.md': design,
    }
    return {name: make() for name, make in pages.items()}


def moved(name: str) -> str:
    """A page of the top folder with its links as seen from docs/."""
    text = (ROOT / name).read_text().replace('](docs/', '](').replace('`docs/', '`')
    text = text.replace('](CONTRIBUTING.md)', '](contributing.md)')
    return LEFT_OUT.sub(r'\1 (`\2`)', text)


def table(head: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """A table of Markdown."""
    lines = [list(head), ['---'] * len(list(head)), *map(list, rows)]
    cells = [[in_a_cell(str(cell)) for cell in line] for line in lines]
    return '\n'.join(f'| {" | ".join(line)} |' for line in cells) + '\n'


def in_a_cell(text: str) -> str:
    """Text as a cell shows it; `<name>` is no tag of HTML."""
    plain = text if '`' in text else text.replace('<', '&lt;')
    return plain.replace('|', '\\|').replace('\n', ' ')


def results() -> str:
    """Golden figures of every bench, which `make bench-check` holds changes against."""
    parts = [
        '# Results',
        'Accuracy, coverage and counts of the quick seeds, by bench; `tactile bench NAME --quick` '
        'prints them. *spread* is the standard deviation over seeds. Times depend on the machine '
        'and stand in the report of a run. `reskin` and *slip* in `grasp` measure real '
        'recordings, the others simulations. The page of a sensor explains its figures.',
        '![Figures over their aims](images/aims.svg)',
    ]
    for path in sorted((ROOT / 'benchmarks' / 'golden').glob('*.json')):
        rows = []
        for row in json.loads(path.read_bytes()):
            ours, aim, low = row['ours'], row['aim'], row['better'] == 'low'
            if ours is None:
                continue
            sign = held = ''
            if aim is not None:
                sign = f'{"≤" if low else "≥"} {aim:.3g}'
                held = 'held' if (ours <= aim if low else ours >= aim) else '**missed**'
            spread = '' if row['spread'] is None else f'{row["spread"]:.2g}'
            rows.append((row['what'].strip(), row['unit'], f'{ours:.3g}', spread, sign, held))
        if rows:
            head = ('figure', 'unit', 'ours', 'spread', 'aim', '')
            parts += [f'## {path.stem}', table(head, rows)]
    return '\n\n'.join(parts) + '\n'


def stale_figures() -> list[str]:
    """Figures of tasks on pages and in the README that are not those of the quick benches."""
    from benchmarks.harness.independent import SENSORS, tasks

    paths = (ROOT / 'benchmarks' / 'golden').glob('*.json')
    rows = [row for path in paths for row in json.loads(path.read_bytes())]
    golden = {row['what']: row['ours'] for row in rows}
    readme, found = (ROOT / 'README.md').read_text(), []
    for key in SENSORS:
        page = (ROOT / 'docs' / f'{key}.md').read_text()
        for task in cast('Any', tasks(key)):
            ours = golden.get(f'independent world: {task.what}')  # None: of slow tasks
            row = re.search(rf'^\| [^|]+ \| ([\d.]+)[^|]*\|.*`{task.name}`', page, re.MULTILINE)
            if row and ours is not None and f'{ours:.{len(row[1].partition(".")[2])}f}' != row[1]:
                found.append(f'docs/{key}.md: {task.name} is {ours:.4g}, not {row[1]}')
        (paper,) = re.findall(r'^# .*paper \[(\d)\]', page)
        shown = re.findall(rf'^\| \[{paper}\] .*?\*\*(.+?)\*\*', readme, re.MULTILINE)
        figures = [figure for cell in shown for figure in re.split(' / |; ', cell)]
        missing = [figure for figure in figures if not re.search(rf'\| {figure}\b', page)]
        found += [f'README.md: {figure} is not in docs/{key}.md' for figure in missing]
    return found


def ros_reference() -> str:
    """Interfaces as their files say them, and the parameters of every node."""
    parts = [
        '# Interfaces and parameters',
        'All units are SI; arrays are flattened row by row.',
        '![Messages between the nodes](images/messages.svg)',
    ]
    for folder in ('msg', 'srv', 'action'):
        parts.append(f'## {folder}')
        for path in sorted((ROOT / folder).iterdir()):
            _licence, _, fields = path.read_text().strip().partition('\n')
            parts += [f'### {path.stem}', f'```text\n{fields}\n```']
    parts += ['## Parameters of nodes', *node_parameters()]
    parts += ['## Parameters of grip_node', *grip_parameters()]
    parts += ['## Parameters of sensors', *sensor_parameters()]
    return '\n\n'.join(parts) + '\n'


def node_parameters() -> list[str]:
    """A table for each class of options, read from the source: ROS need not be there."""
    tree = ast.parse((ROOT / 'tactile_ros/nodes/parameters.py').read_text())
    parts = []
    for node in tree.body:
        if not isinstance(node, ast.ClassDef) or not node.name.endswith('Options'):
            continue
        rows = [row_of(item) for item in node.body if isinstance(item, ast.AnnAssign)]
        if not rows:  # the class that others inherit
            continue
        doc = (ast.get_docstring(node) or '').split('\n')[0]
        parts += [f'### {node.name}', doc, table(('name', 'default', 'range', 'meaning'), rows)]
    return parts


def row_of(item: ast.AnnAssign) -> tuple[str, ...]:
    """Name, default, range and meaning of one field that is made by `parameter`."""
    from tactile_ros import enrolment

    call = item.value
    assert isinstance(call, ast.Call)
    about = {word.arg: ast.unparse(word.value) for word in call.keywords}
    bounds = about.get('range') or about.get('choices') or ''
    text = ast.unparse(call.args[1]).strip('\'"')
    default = ast.unparse(call.args[0])
    if isinstance(call.args[0], ast.Attribute):  # a field of a class of the enrolment
        default = attrgetter(default)(enrolment)
    return ast.unparse(item.target), f'`{default}`', bounds, text


def sensor_parameters() -> list[str]:
    """A table for each sensor's connection and config, from the metadata of their fields."""
    from tactile_ros.sensors import list_sensors, load_sensor

    parts = []
    for key in list_sensors():
        spec = load_sensor(key)
        parts += [f'### {key}', field_table(spec.connection(), spec.config())]
    return parts


def grip_parameters() -> list[str]:
    """Tables of the law of a grip, of a finger and of the hands' drivers."""
    from tactile_ros.control import GripConfig
    from tactile_ros.hands.drivers import DRIVERS

    parts = ['### Law', field_table(GripConfig())]
    for name, driver in DRIVERS.items():
        parts += [f'### Driver {name}', field_table(driver())]
    return parts


def field_table(*configs: object) -> str:
    """Table of the fields of configs, with default, unit, range and meaning."""
    rows = []
    for config, entry in (
        (one, entry) for one in configs for entry in dataclasses.fields(cast('Any', one))
    ):
        about: dict[str, Any] = dict(entry.metadata)
        value = '' if (value := getattr(config, entry.name)) is None else str(value)
        shown = f'`{value}`' if 0 < len(value) < LONGEST_DEFAULT else ''
        bounds = about.get('choices') or about.get('range') or ''
        rows.append((f'`{entry.name}`', shown, about.get('unit', ''), bounds, about['help']))
    return table(('name', 'default', 'unit', 'range', 'meaning'), rows)


def api() -> str:
    """Reference of the public classes and functions, from their docstrings."""
    parts = ['# Python API', '![Classes and what they give](images/python.svg)']
    for title, names in API.items():
        parts += [f'## {title}', *(f'::: {name}' for name in names)]
    return '\n\n'.join(parts) + '\n'


def design() -> str:
    """Floors of the package, its folders and their lines beside the budgets."""
    import house

    rows = [
        (f'`{name}`', house.lines_of(name), budget, ', '.join(modules_of(name)))
        for name, budget in house.BUDGETS.items()
    ]
    return '\n\n'.join([
        '# Design',
        'A frame goes from the bytes of a board through a driver, conditioning and an estimation '
        'to a contact; a grip turns contacts into commands. Live, batch and replay run the same '
        'pipeline and give the same numbers to 1e-9.',
        '## Floors',
        'Imports run downward only; folders of one floor do not import one another. A test '
        'asserts it.',
        '![Floors](images/floors.svg)',
        '## Folders',
        'Lines of Python beside the budget that each folder is to reach; none may grow without a '
        'visible change of the test.',
        table(('folder', 'lines', 'budget', 'modules'), rows),
    ]) + '\n'  # fmt: skip


def modules_of(name: str) -> list[str]:
    """Modules and packages of a folder of the package."""
    folder = ROOT / 'tactile_ros' / name
    if not folder.is_dir():
        return []
    return sorted(
        path.stem for path in folder.iterdir()
        if (path.suffix == '.py' or (path / '__init__.py').exists()) and path.stem[0] != '_'
    )  # fmt: skip


if __name__ == '__main__':
    from images.draw_measured import aims

    sys.path[:0] = [str(ROOT), str(ROOT / 'test')]

    (ROOT / 'docs' / 'results.md').write_text(results())
    (ROOT / 'docs' / 'images' / 'aims.svg').write_text(aims())
    sys.stdout.write('\n'.join([*stale_figures(), '']))
