"""Model files: models from TOML, robots from URDF.

    model_file        one file to a ``Model``
    toml_tables       tables of TOML; every error names file and key
    formulas          formulas in named symbols
    common_tables     parameters, quantities, run length: common to all kinds
    single_body_file  a body with a fixed point
    multibody_file    several bodies with joints
    system_file       any Hamiltonian system
    bounded_xml       elements of XML, bounded in size, number and depth
    urdf_robot        links and joints of a URDF file, each number checked
    urdf_visuals      what a URDF file says its links look like
    urdf_tree         positions of links; links on fixed joints become one body
    urdf              a URDF file to bodies and joints
    robots            URDF, and a TOML file that closes a robot's loops
"""
