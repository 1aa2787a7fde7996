# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Commands and code of the pages: parsed by the commands' own parsers."""

import ast
import importlib
import re
import shlex
from pathlib import Path

import pytest

from reference.help_examples import PAGES, ROOT, blocks, examples, lines
from tactile_ros.cli import demo
from tactile_ros.cli.design import sensor_parser
from tactile_ros.cli.main import COMMANDS, parser
from tactile_ros.sensors import designable, load_sensor

INLINE = re.compile(r'`(?:\.venv/bin/)?tactile ([a-z]+)([^`]*)`')
FLAG = re.compile(r'(?<!\S)--[a-z][a-z-]*')
LINK = re.compile(r'\]\(([^)#:\s]+)(?:#[^)]*)?\)')


COMMAND_LINES = [(page.name, line) for page in PAGES for line in lines(page)]


def parse(line: str) -> None:
    """Let the command's own parser take a line; it ends the test where it does not."""
    words = shlex.split(line.split(' | ', maxsplit=1)[0])[1:]
    try:
        options = parser().parse_args(words)
        if options.command == 'design' and options.sensor in designable():
            spec = load_sensor(options.sensor)
            sensor_parser(spec).parse_args(options.rest)
    except SystemExit as stop:
        if stop.code:
            pytest.fail(f'{line} is refused')


def test_files_of_the_demo_are_named_as_it_names_them() -> None:
    parts = '|'.join(part.name for part in demo.parts(0))
    made = re.compile(rf'reskin_board/(bags/({parts})|calibrations/({parts})\.npz|report\.html)$')
    for line in [*examples(), *(line for _, line in COMMAND_LINES)]:
        if ' demo' not in line:
            for word in re.findall(r'out/demo/(\S*)', line):
                assert made.match(word), line


@pytest.mark.parametrize(('page', 'line'), COMMAND_LINES, ids=lambda text: text.replace('/', '|'))
def test_commands_of_the_pages_are_taken(page: str, line: str) -> None:
    first, second, *rest = line.split()
    if first == 'tactile':
        parse(line)
    elif first == 'make':
        targets = re.findall(r'^([a-z-]+):', (ROOT / 'Makefile').read_text(), re.MULTILINE)
        assert second in targets, page
    elif second == 'run' and rest[0] == 'tactile_ros':
        executables = re.search(r'set\(executables (.*?)\)', (ROOT / 'CMakeLists.txt').read_text())
        assert rest[1] in executables[1].split(), page


@pytest.mark.parametrize('page', PAGES, ids=lambda path: path.name)
def test_commands_in_the_text_have_these_options(page: Path) -> None:
    for name, rest in INLINE.findall(page.read_text()):
        assert name in COMMANDS, f'{page.name}: tactile {name}'
        known = parser()._subparsers._group_actions[0].choices[name]._option_string_actions
        if name != 'design':
            assert set(FLAG.findall(rest)) <= set(known), f'{page.name}: tactile {name}{rest}'


@pytest.mark.parametrize('page', PAGES, ids=lambda path: path.name)
def test_links_lead_somewhere(page: Path) -> None:
    for target in LINK.findall(page.read_text()):
        assert (page.parent / target).exists(), f'{page.name} links to {target}'


@pytest.mark.parametrize('line', examples())
def test_examples_of_help_are_taken(line: str) -> None:
    assert line.startswith('tactile ')
    parse(line)


@pytest.mark.parametrize('page', PAGES, ids=lambda path: path.name)
def test_python_of_the_pages_compiles_and_imports(page: Path) -> None:
    for language, text in blocks(page):
        if language != 'python':
            continue
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.ImportFrom) and (node.module or '').startswith('tactile_ros'):
                if 'pinch_pad' in node.module:  # made on that page
                    continue
                module = importlib.import_module(node.module)
                assert all(hasattr(module, alias.name) for alias in node.names), page.name
