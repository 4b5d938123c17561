"""Model files: models from TOML, robots from URDF, MJCF and SDF.

In: the text of a model file.
Out: a ``Model``, or a ``Multibody`` of a robot.
Open first: ``model_file.read_model``.

    model_file        one file to a ``Model``
    toml_tables       tables of TOML; every error names file and key
    formulas          formulas in named symbols
    common_tables     parameters, quantities, run length: common to all kinds
    single_body_file  a body with a fixed point
    multibody_file    several bodies with joints
    system_file       any Hamiltonian system
    bounded_xml       elements of XML, bounded in size, number and depth
    xml_schema        elements and attributes of a format by class, and their check
    urdf_schema       the classes of URDF
    sdf_schema        the classes of SDF
    xml_numbers       numbers, rotations and places in URDF and SDF
    robot_options     options of robots' files, by format
    robot_tree        the tree of a robot, whichever format its file has
    robot_builder     the tree of a robot to bodies and joints
    urdf              a URDF file to bodies and joints
    mjcf_document     the guard of MJCF files: bounded XML, no file outside the folder
    mjcf_fields       the fields of MuJoCo's compiled model, each in one of three classes
    mjcf_cables       cables to chains of bodies
    mjcf_meshes       geoms of meshes, without files for MuJoCo
    closed_mesh       volume, centre and inertia of a closed mesh
    mjcf_reader       bodies, joints, actuators and equalities of an MJCF file
    mjcf_builder      an MJCF file to bodies and joints
    sdf               an SDF file to bodies and joints, some of which close loops
    robot_visuals     visual shapes of robot files
    robots            MJCF; SDF; URDF, and a TOML file that closes a robot's loops
"""
