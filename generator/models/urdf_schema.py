"""The elements and attributes of URDF by class: versions 1.0 to 1.2, and what files of robots add.

``<gazebo>`` holds settings of Gazebo, which can move anything, and is refused or ignored.
``<transmission>``, ``<safety_controller>``, ``<calibration>`` and the bounds of efforts, speeds
and accelerations belong to motors and controllers, which a URDF file has not: they move nothing.
"""

from __future__ import annotations

from .xml_schema import EXTENSION, Parts, Refused, Schema

__all__ = ["EXTRAS", "URDF", "VERSIONS"]

VERSIONS = ("1.0", "1.1", "1.2")
#: Ignorable part of a file → its meaning.
EXTRAS = {
    "limits": "ends of a joint's range",
    "friction": "dry friction of a joint",
    "collision": "shapes that touch",
    "contact": "properties of touching",
    "gazebo": "settings of another simulator",
    EXTENSION: "parts that other programs add to URDF",
}
_OTHERS = Refused(name=EXTENSION)

URDF = Schema("URDF", {
    "robot": Parts(
        once="@name @version", many="link joint constraint",
        still="material transmission sensor ros2_control",
        refused={"gazebo": Refused(name="gazebo"), "mujoco": _OTHERS}),
    "link": Parts(
        once="@name inertial origin", still="@type visual self_filter collision_checking",
        refused={"collision": Refused(name="collision"), "contact": Refused(name="contact"),
                 "surface": Refused(name="contact"), "gravity": Refused("1", EXTENSION),
                 "kinematic": Refused("0", EXTENSION)}),
    "link/origin": Parts(refused={"@xyz": Refused("0 0 0"), "@rpy": Refused("0 0 0")}),
    "inertial": Parts(once="origin mass inertia"),
    "origin": Parts(once="@xyz @rpy @quat_xyzw"),
    "mass": Parts(once="@value"),
    "inertia": Parts(once="@ixx @ixy @ixz @iyy @iyz @izz"),
    "joint": Parts(
        once="@name @type origin parent child axis dynamics limit mimic",
        still="calibration safety_controller @dont_collapse"),
    "parent": Parts(once="@link"),
    "child": Parts(once="@link"),
    "axis": Parts(once="@xyz"),
    "dynamics": Parts(
        once="@damping",
        refused={"@friction": Refused("0", "friction"), "@D": Refused("0", EXTENSION),
                 "@K": Refused("0", EXTENSION), "@mu_coulomb": Refused("0", EXTENSION),
                 "@mu_viscous": Refused("0", EXTENSION)}),
    "limit": Parts(
        once="@lower @upper",
        still="@effort @velocity @acceleration @deceleration @jerk @command_effort @current "
              "@gear_velocity"),
    "mimic": Parts(once="@joint @multiplier @offset"),
    "constraint": Parts(
        once="@name @type parent child parent_origin child_origin parent_axis child_axis"),
    "parent_origin": Parts(once="@xyz @rpy @quat_xyzw"),
    "child_origin": Parts(once="@xyz @rpy @quat_xyzw"),
    "parent_axis": Parts(once="@xyz"),
    "child_axis": Parts(once="@xyz"),
})
