# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Macro of a sensor for the description of a robot: bodies as the configs say, links as in tf."""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
import yaml

from tactile_ros.sensors import list_sensors, load_sensor

FOLDER = Path(__file__).parents[1] / 'config' / 'urdf'
ROBOT = """<robot name="hand" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:include filename="{folder}/tactile_sensor.urdf.xacro"/>
  <link name="tip"/>
  <xacro:tactile_sensor finger="thumb" parent="tip" sensor="{key}" prefix="left/"
      taxels="{taxels}">
    <origin xyz="0 0 0.004" rpy="0 0 0"/>
  </xacro:tactile_sensor>
</robot>
"""


@pytest.mark.parametrize('key', list_sensors())
def test_macro_puts_link_and_taxels_where_the_config_has_them(key: str, tmp_path: Path) -> None:
    xacro = pytest.importorskip('xacro', reason='xacro comes with ROS or the test packages')
    places = load_sensor(key).config().positions
    for taxels, count in (('false', 0), ('true', len(places))):
        path = tmp_path / f'{taxels}.xacro'
        path.write_text(ROBOT.format(folder=FOLDER, key=key, taxels=taxels))
        robot = ET.fromstring(xacro.process_file(str(path)).toxml())
        links = [link.get('name') for link in robot.iter('link')]
        assert links[:2] == ['tip', 'left/thumb_tactile_link']
        assert links[2:] == [f'left/thumb_taxel_{i}' for i in range(count)]
        texts = [one.get('xyz', '') for one in robot.findall('joint/origin')]
        found = [[float(x) for x in text.split()] for text in texts]
        assert found[0] == [0, 0, 0.004]
        np.testing.assert_allclose(np.reshape(found[1:], (-1, 3)), places[:count], atol=1e-9)


def test_body_of_every_sensor_holds_its_taxels() -> None:
    bodies = yaml.safe_load((FOLDER / 'sensors.yaml').read_text())
    assert sorted(bodies) == list_sensors()
    for body in bodies.values():
        away = np.abs(np.array(body['taxels'])[:, :2] - body['middle'][:2])
        assert (away <= np.array(body['size'][:2]) / 2).all()
