"""What runs on a hand: the graph of its sensors, the grip, and a fake hand where asked."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tactile_ros.hands import load_hand
from tactile_ros.nodes.graph import PORT, Graph, Process, Setting, Source, Value, placed, sensing


@dataclass(frozen=True)
class Grasping:
    """What a user chooses about a hand with sensors.

    Attributes
    ----------
    hand : str
        Name of a hand in config/hands, or a .yaml that describes one.
    mock_hand : bool
        A fake takes the place of the hand's driver.
    fingers : str
        Sensors that take part, parted by commas; empty: all that the hand carries.
    sensor, source : str
        Key of the sensors, and where their frames come from, as in `Setting`.
    ports : str
        Serial ports in the order of the fingers, parted by commas; empty: /dev/ttyACM0 and on.
    calibrations : str
        Folder with a file <finger>.npz for each; empty: not calibrated.
    stack : bool
        Sensor and contact of a finger in one process.
    use_robot_description : bool
        Limits and pads come from the topic `robot_description`.
    """

    hand: str = 'allegro_v5'
    mock_hand: bool = False
    fingers: str = ''
    sensor: str = 'reskin_board'
    source: Source = 'hardware'
    ports: str = ''
    calibrations: str = ''
    stack: bool = False
    use_robot_description: bool = False
    seed: int = 0
    namespace: str = ''
    params_file: str = ''
    use_sim_time: bool = False
    autostart: bool = True

    def finger(self, index: int, name: str) -> Setting:
        """What holds for the sensor of one finger."""
        ports = [port.strip() for port in self.ports.split(',') if port.strip()]
        own = ports[index] if index < len(ports) else PORT[:-1] + str(index)
        real = self.source == 'hardware' and (ports or not self.params_file)
        file = Path(self.calibrations) / f'{name}.npz' if self.calibrations else ''
        return Setting(
            sensor=self.sensor,
            source=self.source,
            port=own if real else PORT,
            calibration=str(file),
            stack=self.stack,
            seed=self.seed + index,
            frame_id=f'{name}_tactile_link',
            namespace='/'.join(filter(None, (self.namespace.strip('/'), name))),
            params_file=self.params_file,
            use_sim_time=self.use_sim_time,
            autostart=self.autostart,
        )


def grasping(choice: Grasping) -> Graph:
    """The sensors of every finger, grip_node, and a fake hand where asked.

    Raises
    ------
    ValueError
        If there is no such hand, or it carries no such sensor.
    """
    hand = load_hand(choice.hand)
    carried = [name for finger in hand.fingers.values() for name in finger.sensors]
    wanted = [name.strip() for name in choice.fingers.split(',') if name.strip()]
    if not set(wanted) <= set(carried):
        msg = f'fingers must be of {", ".join(carried)}; received {choice.fingers!r}'
        raise ValueError(msg)
    grip: dict[str, Value] = {'hand': choice.hand, **({'fingers': wanted} if wanted else {})}
    if choice.use_robot_description:
        grip['use_robot_description'] = True
    own = [Process('mock_hand', {'hand': choice.hand})] if choice.mock_hand else []
    own.append(Process('grip_node', grip))
    everywhere = Setting(
        namespace=choice.namespace,
        params_file=choice.params_file,
        use_sim_time=choice.use_sim_time,
        autostart=choice.autostart,
    )
    sensors = [
        process
        for i, name in enumerate(wanted or carried)
        for process in sensing(choice.finger(i, name)).processes
    ]
    return Graph((*(placed(process, everywhere) for process in own), *sensors))
