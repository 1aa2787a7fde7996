"""What contact_node says in standard messages: wrench, markers, the object's pose, its surface.

Each is filled only where somebody listens, and offered only where the sensor can ever tell it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from geometry_msgs.msg import PoseWithCovarianceStamped, WrenchStamped
from sensor_msgs.msg import PointCloud2, PointField
from visualization_msgs.msg import MarkerArray

from tactile_ros import messages
from tactile_ros.nodes.markers import contact_markers
from tactile_ros.nodes.quality import data

if TYPE_CHECKING:
    from rclpy.publisher import Publisher

    from tactile_ros.messages import UnknownAs
    from tactile_ros.nodes.lifecycle import ManagedNode
    from tactile_ros.pipeline import Pipeline
    from tactile_ros.sensors import SensorSpec
    from tactile_ros.types import ContactState, Frame

LOOK_NS = 9_000_000  # of the stream, within which nobody is asked again whether he listens


class StandardTopics:
    """Publishers of one contact_node.

    Parameters
    ----------
    node : ManagedNode
        Whose publishers they are.
    spec : SensorSpec
        Of its sensor: without `objects` in the config there is no `object_pose`, and without
        `surface` of the estimation no `surface`.
    """

    def __init__(self, node: ManagedNode, spec: SensorSpec) -> None:
        self._wrench = node.managed_publisher(WrenchStamped, 'wrench', data())
        self._markers = node.managed_publisher(MarkerArray, 'markers', data())
        self._object: Publisher | None = None
        self._surface: Publisher | None = None
        if hasattr(spec.config(), 'objects'):
            self._object = node.managed_publisher(PoseWithCovarianceStamped, 'object_pose', data())
        if hasattr(spec.estimation, 'surface'):
            self._surface = node.managed_publisher(PointCloud2, 'surface', data())
        offered = self._wrench, self._markers, self._object, self._surface
        self._offered = [publisher for publisher in offered if publisher is not None]
        self._looked_ns, self._heard = 0, False

    def publish(
        self,
        frame: Frame,
        state: ContactState,
        frame_id: str,
        pipeline: Pipeline,
        unknown_as: UnknownAs,
    ) -> None:
        """Publish a state, each message where somebody listens."""
        if not self._is_heard(frame.stamp_ns or 0):
            return
        if self._wrench.get_subscription_count():
            wrench = WrenchStamped()
            messages.fill_header(wrench.header, frame.stamp_ns, frame_id)
            messages.fill_wrench(wrench, state, unknown_as)
            self._wrench.publish(wrench)
        if self._markers.get_subscription_count():
            header = WrenchStamped().header
            messages.fill_header(header, frame.stamp_ns, frame_id)
            self._markers.publish(contact_markers(header, pipeline.layout, state))
        if self._object is not None and self._object.get_subscription_count():
            pose = PoseWithCovarianceStamped()
            messages.fill_header(pose.header, frame.stamp_ns, frame_id)
            if messages.fill_object_pose(pose, state):
                self._object.publish(pose)
        if self._surface is not None and self._surface.get_subscription_count():
            cloud = PointCloud2()
            messages.fill_header(cloud.header, frame.stamp_ns, frame_id)
            messages.fill_surface(cloud, pipeline.estimation.surface(state), PointField)
            self._surface.publish(cloud)

    def _is_heard(self, stamp_ns: int) -> bool:
        """Whether anybody listens; of a fast sensor not asked with every frame."""
        if not 0 < stamp_ns - self._looked_ns < LOOK_NS:
            self._looked_ns = stamp_ns
            self._heard = any(one.get_subscription_count() for one in self._offered)
        return self._heard
