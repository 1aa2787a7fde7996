# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The launch files, on stand-ins where launch is not installed; their parameter files."""

from __future__ import annotations

import importlib.util
import shlex
import sys
from dataclasses import fields
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
import yaml

from reference.help_examples import PAGES, lines
from tactile_ros.control import GripConfig
from tactile_ros.nodes.contact_node import ContactOptions
from tactile_ros.nodes.graph import BagPlayback, HandSetup, SensorSetup, replaying
from tactile_ros.nodes.parameters import GripOptions, Schema
from tactile_ros.nodes.sensor_node import SensorOptions
from tactile_ros.sensors import list_sensors, load_sensor

ROOT = Path(__file__).parents[2]
LAUNCH = 'ros2 launch tactile_ros '
LAUNCHED = sorted({line for page in PAGES for line in lines(page) if line.startswith(LAUNCH)})


class Record:
    """Stands in for any class of launch: keeps what it was made with."""

    def __init__(self, *given: object, **named: object) -> None:
        self.given, self.named = given, named

    def __getattr__(self, name: str) -> object:
        return self.named[name.removeprefix('node_')]


class Argument:
    """Stands in for DeclareLaunchArgument."""

    def __init__(
        self, name: str, *, default_value: str, description: str, choices: list | None = None
    ) -> None:
        self.name, self.description = name, description
        self.default_value = [Text(default_value)]
        assert not choices or default_value in choices


class Text(str):
    """Stands in for a substitution."""

    __slots__ = ()
    text = property(str)

    def perform(self, context: Context) -> str:
        return str(self)


class Configuration(Text):
    """Stands in for LaunchConfiguration."""

    __slots__ = ()

    def perform(self, context: Context) -> str:
        return context.launch_configurations[str(self)]


class Context:
    """Stands in for LaunchContext."""

    def __init__(self) -> None:
        self.launch_configurations: dict[str, str] = {}


class Description(list):
    """Stands in for LaunchDescription."""

    def get_launch_arguments(self) -> list[Argument]:
        return [action for action in self if isinstance(action, Argument)]


class Process(Record):
    """Stands in for ExecuteProcess."""

    @property
    def cmd(self) -> list[list[Text]]:
        return [[Text(word)] for word in self.named['cmd']]


STAND_INS = {
    'launch': {'Event': object, 'LaunchContext': Context, 'LaunchDescription': Description,
               'LaunchDescriptionEntity': object},
    'launch.actions': {'DeclareLaunchArgument': Argument, 'OpaqueFunction': Record,
                       'ExecuteProcess': Process, 'RegisterEventHandler': Record,
                       'Shutdown': Record, 'TimerAction': Record},
    'launch.events.process': {'ProcessExited': object},
    'launch.event_handlers': {'OnProcessExit': Record},
    'launch.substitutions': {'LaunchConfiguration': Configuration},
    'launch_ros': {},
    'launch_ros.actions': {'Node': Record},
    'launch_ros.ros_adapters': {'get_ros_node': lambda context: context.node},
}  # fmt: skip


@pytest.fixture(autouse=True)
def launch_or_stand_ins(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where launch is not installed, what the launch files use of it."""
    if importlib.util.find_spec('launch_ros') is not None:
        return
    for name, members in STAND_INS.items():
        module = ModuleType(name)
        vars(module).update(members)
        monkeypatch.setitem(sys.modules, name, module)


def module_of(name: str) -> ModuleType:
    """A launch file as `ros2 launch` loads it."""
    spec = importlib.util.spec_from_file_location('launched', ROOT / 'launch' / name)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def actions(module: ModuleType, **arguments: str) -> list:
    """What a launch file starts with some arguments."""
    import launch

    context = launch.LaunchContext()
    for argument in module.generate_launch_description().get_launch_arguments():
        default = argument.default_value
        text = ''.join(part.perform(context) for part in default) if default else ''
        context.launch_configurations[argument.name] = text
    context.launch_configurations.update(arguments)
    return module.start(context)


@pytest.mark.parametrize(
    ('name', 'choices', 'apart'),
    [
        ('sensor', SensorSetup, {'parent_frame', *'xyz', 'roll', 'pitch', 'yaw', 'simulated'}),
        ('replay', BagPlayback, {'use_sim_time', 'respawn'}),
        ('grasp', HandSetup, set()),
    ],
)
def test_every_choice_is_a_described_argument(name: str, choices: type, apart: set[str]) -> None:
    module = module_of(f'{name}.launch.py')
    declared = module.generate_launch_description().get_launch_arguments()
    names = {argument.name for argument in declared}
    assert names ^ {field.name for field in fields(choices)} == apart | {'log_level'}
    assert all(len(argument.description) > 5 for argument in declared)


@pytest.mark.parametrize('source', [{'source': 'simulated'}, {'simulated': 'true'}])
def test_a_simulated_sensor_is_one_node_with_its_seed_and_fault(source: dict[str, str]) -> None:
    module = module_of('sensor.launch.py')
    (stack,) = actions(module, sensor='gradiometer', seed='4', fault='lost:2', **source)
    assert stack.node_executable == 'stack'
    if isinstance(stack, Record):
        (parameters,) = stack.named['parameters']
        told = {'simulated': True, 'sensor': 'gradiometer', 'seed': 4, 'fault': 'lost:2'}
        assert told.items() <= parameters.items()


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        ({'speed_up': 'fast'}, "speed_up must be a number; received 'fast'"),
        ({'seed': '1.5'}, "seed must be a whole number; received '1.5'"),
        ({'parent_frame': 'tip', 'yaw': 'left'}, "yaw must be a number; received 'left'"),
        ({'params_file': '/nowhere.yaml'}, 'params_file must be a path that can be read'),
        ({'calibration': '/nowhere.npz'}, 'calibration must be a path that can be read'),
        ({'source': 'recorded', 'sensor': 'gradiometer'}, 'gradiometer has no recordings'),
    ],
)
def test_a_launch_that_cannot_be_is_one_sentence(arguments: dict[str, str], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        actions(module_of('sensor.launch.py'), **arguments)


@pytest.mark.parametrize(
    ('file', 'arguments', 'again'),
    [
        ('sensor.launch.py', {'stack': 'false', 'source': 'recorded'},
         {'contact_node': True, 'sensor_node': True, 'player': False}),
        ('sensor.launch.py', {'respawn': 'false'}, {'stack': False}),
        ('sensor.launch.py', {}, {'stack': True}),
        ('grasp.launch.py', {'mock_hand': 'true'}, {'mock_hand': False, 'stack': False}),
    ],
)  # fmt: skip
def test_nodes_of_sensors_are_started_again(
    file: str, arguments: dict[str, str], again: dict[str, bool]
) -> None:
    made = actions(module_of(file), **arguments)
    assert {action.node_executable for action in made} == set(again)
    for action in made:
        if isinstance(action, Record):
            assert action.named['respawn'] is again[action.node_executable]
            assert action.named['respawn_delay'] > 0


def test_what_refuses_to_run_or_grips_ends_the_launch() -> None:
    (sensor,), (grip,) = (actions(module_of(f'{name}.launch.py')) for name in ('sensor', 'grasp'))
    if not isinstance(sensor, Record):
        pytest.skip('launch calls the handlers itself')
    context = SimpleNamespace(is_shutdown=False)
    for code in (1, 2):
        with pytest.raises(RuntimeError, match=f'stack ended with code {code}'):
            sensor.named['on_exit'](SimpleNamespace(returncode=code), context)
    for code in (0, -9):
        event = SimpleNamespace(returncode=code)
        assert sensor.named['on_exit'](event, context) == []
        (end,) = grip.named['on_exit'](event, context)
        assert end.named['reason'] == 'stack ended'
        assert grip.named['on_exit'](event, SimpleNamespace(is_shutdown=True)) == []


def test_a_parent_frame_adds_a_transform() -> None:
    module = module_of('sensor.launch.py')
    found = actions(module, parent_frame='finger', x='0.01', yaw='1.57')
    assert found[-1].node_package == 'tf2_ros'
    assert found[-1].node_executable == 'static_transform_publisher'


def test_replay_plays_what_the_sensor_said() -> None:
    module = module_of('replay.launch.py')
    contact, ending, _, waiting = actions(module, bag='bag', namespace='thumb')
    player, topic = arguments_of(waiting)
    assert topic == '/thumb/frame'
    assert contact.node_executable == 'contact_node'
    words = [part.text for word in player.cmd for part in word]
    assert words == BagPlayback('bag', namespace='thumb').command()
    assert words[-3:] == ['--topics', '/thumb/frame', '/thumb/layout']
    assert words[:5] == ['ros2', 'bag', 'play', 'bag', '--clock']
    if isinstance(contact, Record):
        assert contact.named['namespace'] == 'thumb'
        assert contact.named['parameters'] == [{'use_sim_time': True}]
        (ended,) = ending.given
        assert ended.named['target_action'] is player
        (wait,) = ended.named['on_exit']
        assert wait.named['period'] > 0  # for what the node has not taken yet


def arguments_of(opaque: object) -> tuple:
    """What an OpaqueFunction calls its function with."""
    return tuple(
        opaque.named['args'] if isinstance(opaque, Record) else opaque._OpaqueFunction__args
    )


def test_a_replay_waits_for_its_node_and_ends_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    module = module_of('replay.launch.py')
    contact, _, gone, waiting = actions(module, bag='bag', namespace='thumb')
    names = iter([[], ['plotter'], ['plotter', 'contact_node']])

    def listeners(topic: str) -> list[SimpleNamespace]:
        assert topic == '/thumb/frame'
        return [SimpleNamespace(node_name=name) for name in next(names)]

    node = SimpleNamespace(get_subscriptions_info_by_topic=listeners)
    monkeypatch.setattr(module, 'get_ros_node', lambda _: node)
    player, topic = arguments_of(waiting)
    for _ in range(2):
        (wait,) = module.once_heard(None, player, topic)
        assert wait is not player
        (waiting,) = wait.named['actions'] if isinstance(wait, Record) else wait.actions
        player, topic = arguments_of(waiting)
    assert module.once_heard(None, player, topic) == [player]
    if isinstance(contact, Record):
        (ended,) = gone.given
        assert ended.named['target_action'] is contact
    by_itself, shut = SimpleNamespace(is_shutdown=False), SimpleNamespace(is_shutdown=True)
    assert len(module.without_node(None, by_itself)) == 1
    assert module.without_node(None, shut) == []


@pytest.mark.parametrize(
    ('wrong', 'sentence'),
    [
        ({'bag': ''}, 'bag must be the folder of a bag'),
        ({'rate': 0.0}, 'rate must be above 0 and delay 0 or more'),
        ({'rate': float('nan')}, 'received nan, 3.0'),
        ({'delay': -1.0}, 'received 1.0, -1.0'),
    ],
)
def test_a_replay_refuses_what_the_player_refuses(wrong: dict[str, float], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        BagPlayback(**{'bag': 'bag', **wrong}).command()


def test_a_replay_runs_the_node_on_the_clock_of_the_bag() -> None:
    assert '--delay' not in BagPlayback('bag', delay=0.0).command()
    (contact,) = replaying(BagPlayback('b', calibration='c.npz', params_file='p.yaml')).processes
    assert contact.parameters == {'use_sim_time': True, 'calibration': 'c.npz'}
    assert contact.params_file == 'p.yaml'


@pytest.mark.parametrize('line', LAUNCHED)
def test_launch_commands_of_the_pages_start_something(
    line: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('os.access', lambda *_: True)  # their files are the reader's
    name, *words = shlex.split(line)[3:]
    told = dict(word.split(':=', 1) for word in words if ':=' in word)
    module = module_of(name)
    declared = module.generate_launch_description().get_launch_arguments()
    assert set(told) <= {argument.name for argument in declared}
    if told.get('sensor') != 'pinch_pad':  # made on its page
        assert actions(module, **told)


def test_the_parameter_file_of_a_grip_names_the_defaults() -> None:
    document = yaml.safe_load((ROOT / 'config' / 'grip.yaml').read_text())
    content = document['/**/grip_node']['ros__parameters']
    schemas = [Schema(GripOptions()), Schema(GripConfig())]
    for name, value in content.items():
        schema = next(schema for schema in schemas if name in schema.entries)
        assert getattr(schema.build({name: value}), name) == value
        assert schema.entries[name].ros_default == value
    assert len(document) == 1


@pytest.mark.parametrize('sensor', list_sensors())
def test_the_parameter_file_of_a_sensor_is_accepted(sensor: str) -> None:
    spec = load_sensor(sensor)
    document = yaml.safe_load((ROOT / 'config' / f'{sensor}.yaml').read_text())
    schemas = {
        '/**/sensor_node': [Schema(SensorOptions()), Schema(spec.config())],
        '/**/contact_node': [Schema(ContactOptions()), Schema(spec.config())],
    }
    schemas['/**/sensor_node'].append(Schema(spec.connection()))
    assert document.keys() == schemas.keys()
    for node, content in document.items():
        for name, value in content['ros__parameters'].items():
            home = next(schema for schema in schemas[node] if name in schema.entries)
            built = home.build({name: value})
            if name == 'positions':
                np.testing.assert_allclose(built.positions, spec.config().positions, atol=1e-7)
