"""The elements and attributes of SDF by class: versions 1.3 to 1.12.

``<plugin>`` is a program, which can move anything, and is refused or ignored. Settings of solvers,
sensors, lights and looks move nothing; neither do the bounds of efforts and speeds, which hold for
motors, nor the wind without ``<enable_wind>``, nor ``<axis>`` of joints without an axis.
"""

from __future__ import annotations

from .xml_schema import EXTENSION, Parts, Refused, Schema

__all__ = ["EXTRAS", "SDF", "VERSIONS"]

VERSIONS = tuple(f"1.{minor}" for minor in range(3, 13))
#: Ignorable part of a file → its meaning.
EXTRAS = {
    "limits": "ends of a joint's range",
    "friction": "dry friction of a joint",
    "collision": "shapes that touch",
    "plugin": "parts of another simulator",
    EXTENSION: "parts that other programs add to SDF",
}
_OFF, _ZERO, _EMPTY = Refused("false"), Refused("0"), Refused("")
_PLUGIN = Refused(name="plugin")
_WRITTEN_OUT = Refused(cure="write its links and joints out")
_STATE = Refused(cure="remove it and set angles and rates, position and quaternion")
_ADDED_MASS = "xx xy xz xp xq xr yy yz yp yq yr zz zp zq zr pp pq pr qq qr rr"

SDF = Schema("SDF", {
    "sdf": Parts(once="@version", many="world model", still="actor light"),
    "world": Parts(
        once="gravity", many="model frame joint physics",
        still="@name audio wind magnetic_field atmosphere gui scene light actor road "
              "spherical_coordinates",
        refused={"include": _WRITTEN_OUT, "population": _WRITTEN_OUT, "state": _STATE,
                 "plugin": _PLUGIN}),
    "world/physics": Parts(
        once="gravity",
        still="@name @type @default max_step_size real_time_factor real_time_update_rate "
              "update_rate max_contacts ode bullet simbody dart magnetic_field"),
    "model": Parts(
        once="@name @canonical_link @placement_frame pose", many="link joint frame",
        still="@namespace self_collide allow_auto_disable",
        refused={"static": _OFF, "enable_wind": _OFF, "plugin": _PLUGIN, "include": _WRITTEN_OUT,
                 "model": _WRITTEN_OUT, "gripper": Refused(), "model_state": _STATE}),
    "frame": Parts(once="@name @attached_to pose"),
    "pose": Parts(once="@relative_to @frame @rotation_format @degrees"),
    "link": Parts(
        once="@name gravity pose inertial velocity_decay",
        still="self_collide visual sensor projector audio_sink audio_source battery light "
              "particle_emitter frame",
        refused={"kinematic": _OFF, "enable_wind": _OFF, "must_be_base_link": _OFF,
                 "collision": Refused(name="collision")}),
    "velocity_decay": Parts(refused={"linear": _ZERO, "angular": _ZERO}),
    "inertial": Parts(
        once="mass pose inertia fluid_added_mass", still="density auto_inertia_params frame",
        refused={"@auto": _OFF}),
    "inertial/pose": Parts(
        once="@rotation_format @degrees", refused={"@relative_to": _EMPTY, "@frame": _EMPTY}),
    "inertia": Parts(once="ixx ixy ixz iyy iyz izz"),
    "fluid_added_mass": Parts(refused=dict.fromkeys(_ADDED_MASS.split(), _ZERO)),
    "joint": Parts(
        once="@name @type parent child pose axis physics",
        still="axis2 gearbox_ratio gearbox_reference_body thread_pitch screw_thread_pitch sensor "
              "frame"),
    "axis": Parts(
        once="xyz use_parent_model_frame dynamics limit mimic",
        refused={"initial_position": Refused("0", cure="remove it and set angles")}),
    "xyz": Parts(once="@expressed_in"),
    "dynamics": Parts(
        once="damping spring_reference spring_stiffness",
        refused={"friction": Refused("0", "friction")}),
    "limit": Parts(once="lower upper", still="effort velocity stiffness dissipation"),
    "mimic": Parts(once="@joint multiplier offset reference", refused={"@axis": Refused("axis")}),
    "joint/physics": Parts(once="ode", still="simbody provide_feedback"),
    "ode": Parts(
        still="provide_feedback cfm_damping implicit_spring_damper fudge_factor cfm erp bounce "
              "limit suspension",
        refused={"max_force": _ZERO, "velocity": _ZERO}),
}, has_text=True)
