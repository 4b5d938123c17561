"""Model files: models from TOML, robots from URDF, MJCF and SDF.

    model_file        one file to a ``Model``
    toml_tables       tables of TOML; every error names file and key
    formulas          formulas in named symbols
    common_tables     parameters, quantities, run length: common to all kinds
    single_body_file  a body with a fixed point
    multibody_file    several bodies with joints
    system_file       any Hamiltonian system
    bounded_xml       elements of XML, bounded in size, number and depth
    urdf_robot        links and joints of a URDF file, each number checked
    urdf_tree         positions of links; links on fixed joints become one body
    urdf              a URDF file to bodies and joints
    mjcf_document     an MJCF file with its includes, default classes and compiler settings
    mjcf_geoms        mass, centre and inertia of geoms
    closed_mesh       volume, centre and inertia of a closed mesh
    mjcf_robot        bodies, joints, actuators and equalities of an MJCF file
    mjcf              an MJCF file to bodies and joints
    sdf               an SDF file to bodies and joints, some of which close loops
    robot_visuals     visual shapes of robot files
    robots            MJCF; SDF; URDF, and a TOML file that closes a robot's loops
"""
