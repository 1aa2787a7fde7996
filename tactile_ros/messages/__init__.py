"""Messages <-> types by attribute: the same code reads objects of rclpy and of rosbags.

Readers take any object with the fields of msg/*.msg; writers fill a fresh message that the caller
made. NaN and -1 (unknown) stay NaN and -1 in contacts; standard messages may say zero instead.
"""

from tactile_ros.messages.contacts import FIELD_NAMES as FIELD_NAMES
from tactile_ros.messages.contacts import UnknownAs as UnknownAs
from tactile_ros.messages.contacts import fill_contacts as fill_contacts
from tactile_ros.messages.contacts import fill_wrench as fill_wrench
from tactile_ros.messages.contacts import read_contacts as read_contacts
from tactile_ros.messages.fields import fill_header as fill_header
from tactile_ros.messages.fields import stamp_ns as stamp_ns
from tactile_ros.messages.frames import fill_frame as fill_frame
from tactile_ros.messages.frames import fill_layout as fill_layout
from tactile_ros.messages.frames import is_valid as is_valid
from tactile_ros.messages.frames import read_frame as read_frame
from tactile_ros.messages.frames import read_layout as read_layout
from tactile_ros.messages.objects import fill_object_pose as fill_object_pose
from tactile_ros.messages.objects import fill_surface as fill_surface
