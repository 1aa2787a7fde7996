"""What runs on a bag that is played by `ros2 bag play`: contact_node on the bag's own clock."""

from __future__ import annotations

from dataclasses import dataclass

from tactile_ros.nodes.graph import Graph, Process, Setting, placed


@dataclass(frozen=True)
class Playing:
    """What a user chooses about a bag that is played.

    Attributes
    ----------
    bag : str
        Folder of the bag.
    calibration, sensor, namespace, params_file, autostart
        As in `Setting`; the namespace is that of the sensor in the bag.
    rate : float
        Recorded time over played time.
    delay : float
        Time before the first message (s), in which player and node find each other.
    """

    bag: str = ''
    calibration: str = ''
    sensor: str = 'reskin_board'
    namespace: str = ''
    rate: float = 1.0
    delay: float = 3.0
    params_file: str = ''
    autostart: bool = True

    @property
    def topics(self) -> tuple[str, ...]:
        """What is played: frames and layout; everything else is said anew."""
        space = self.namespace.strip('/')
        return tuple(f'/{space}/{leaf}'.replace('//', '/') for leaf in ('frame', 'layout'))

    def command(self) -> list[str]:
        """Command line of the player, which publishes /clock.

        Raises
        ------
        ValueError
            If no bag is named, the rate is not above 0 or the delay is below.
        """
        if not self.bag:
            msg = 'bag must be the folder of a bag; received none'
            raise ValueError(msg)
        if not (self.rate > 0 and self.delay >= 0):
            msg = f'rate must be above 0 and delay 0 or more; received {self.rate}, {self.delay}'
            raise ValueError(msg)
        pace = ['--clock', '--rate', str(self.rate)]
        pace += ['--delay', str(self.delay)] if self.delay else []  # the player refuses 0
        pace += ['--wait-for-all-acked', '5000']  # ms: Fast DDS asks for it every 3 s
        return ['ros2', 'bag', 'play', self.bag, *pace, '--topics', *self.topics]


def replaying(choice: Playing) -> Graph:
    """contact_node on simulated time; the player is no executable of this package."""
    setting = Setting(
        sensor=choice.sensor,
        calibration=choice.calibration,
        namespace=choice.namespace,
        params_file=choice.params_file,
        use_sim_time=True,
        autostart=choice.autostart,
    )
    contact = Process('contact_node', setting.chosen('sensor', 'calibration'))
    return Graph((placed(contact, setting),))
