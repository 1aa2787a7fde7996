"""The launch files, where launch is installed; their parameter files always."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest
import yaml

from tactile_ros.nodes.contact_node import ContactOptions
from tactile_ros.nodes.parameters import Schema
from tactile_ros.nodes.sensor_node import SensorOptions
from tactile_ros.sensors import list_sensors, load_sensor

ROOT = Path(__file__).parents[2]
FILES = ['sensor.launch.py', 'replay.launch.py']


def module_of(name: str) -> ModuleType:
    """A launch file as `ros2 launch` loads it."""
    pytest.importorskip('launch_ros', reason='launch is not installed: launch files are not run')
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


@pytest.mark.parametrize('name', FILES)
def test_every_argument_is_described(name: str) -> None:
    declared = module_of(name).generate_launch_description().get_launch_arguments()
    assert all(len(argument.description) > 5 for argument in declared)
    names = {argument.name for argument in declared}
    assert {'sensor', 'params_file', 'namespace', 'calibration'} <= names


def test_the_graph_is_that_of_the_description() -> None:
    module = module_of('sensor.launch.py')
    found = [a.node_executable for a in actions(module, source='recorded', bag='/tmp/bag')]
    assert found == ['record', 'contact_node', 'sensor_node', 'player']
    assert [a.node_executable for a in actions(module, stack='true')] == ['stack']


def test_a_parent_frame_adds_a_transform() -> None:
    module = module_of('sensor.launch.py')
    found = actions(module, parent_frame='finger', x='0.01', yaw='1.57')
    assert found[-1].node_package == 'tf2_ros'
    assert found[-1].node_executable == 'static_transform_publisher'


def test_replay_plays_what_the_sensor_said() -> None:
    contact, player, _ = actions(module_of('replay.launch.py'), bag='/tmp/bag', namespace='thumb')
    assert contact.node_executable == 'contact_node'
    words = [part.text for word in player.cmd for part in word]
    assert words[-3:] == ['--topics', '/thumb/frame', '/thumb/layout']
    assert '--clock' in words


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
            home.build({name: value})
