"""URDF, as robots are described for ROS, to bodies and joints.

    xml_text   XML of unknown origin: bounded, without document types and entities
    robot      the links and joints that a file describes, checked
    tree       where links are; what is fixed becomes one body
    urdf       the file to a ``Multibody``, and to a model
"""
