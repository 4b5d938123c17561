"""Each element and attribute of URDF and SDF is read, moves nothing, or is refused by name."""

import os
import sys
from copy import deepcopy
from pathlib import Path
from xml.etree import ElementTree

import pytest

import gyrospark as gs
from gyrospark.generator.models.sdf_schema import SDF
from gyrospark.generator.models.urdf_schema import URDF
from gyrospark.generator.models.xml_schema import Parts

#: A file with each element that is read, at least in part.
FULL_SDF = """<sdf version="1.12"><world name="w">
<gravity>0 0 -9.81</gravity><physics type="ode"><gravity>0 0 -9.81</gravity></physics>
<frame name="corner" attached_to="world"><pose>1 0 0 0 0 0</pose></frame>
<joint name="floor" type="fixed"><parent>corner</parent><child>m::base</child></joint>
<model name="m"><pose relative_to="corner">0 0 1 0 0 0</pose>
<frame name="f" attached_to="arm"><pose relative_to="arm">0 0 1 0 0 0</pose></frame>
<link name="base"/>
<link name="arm"><gravity>true</gravity><velocity_decay/><pose degrees="false">0 0 1 0 .3 0</pose>
<inertial><pose>.5 0 0 0 0 0</pose><mass>2</mass><inertia><ixx>.1</ixx><iyy>.2</iyy><izz>.2</izz>
<ixy>.01</ixy></inertia><fluid_added_mass/></inertial></link>
<link name="hand"><inertial><mass>1</mass><inertia><ixx>.1</ixx><iyy>.2</iyy><izz>.2</izz></inertia>
</inertial></link>
<joint name="pin" type="revolute"><pose>0 0 0 0 0 0</pose><parent>base</parent><child>arm</child>
<axis><xyz expressed_in="arm">0 1 0</xyz><dynamics><damping>.1</damping></dynamics>
<limit><lower>-inf</lower><upper>inf</upper></limit></axis><physics><ode/></physics></joint>
<joint name="wrist" type="continuous"><parent>arm</parent><child>hand</child>
<axis><mimic joint="pin"><multiplier>2</multiplier></mimic></axis></joint>
</model></world></sdf>"""
FULL_URDF = """<robot name="r" version="1.2"><link name="base"><origin/></link>
<link name="arm"><inertial><origin xyz=".5 0 0"/><mass value="2"/>
<inertia ixx=".1" iyy=".2" izz=".2" ixy=".01"/></inertial></link>
<link name="hand"><inertial><mass value="1"/><inertia ixx=".1" iyy=".2" izz=".2"/></inertial></link>
<joint name="pin" type="continuous"><origin quat_xyzw="0 0 .6 .8"/><parent link="base"/>
<child link="arm"/><axis xyz="0 1 0"/><dynamics damping=".1"/><limit effort="1"/></joint>
<joint name="wrist" type="continuous"><parent link="arm"/><child link="hand"/><axis xyz="0 1 0"/>
<mimic joint="pin" multiplier="2"/></joint>
<constraint name="loop" type="revolute"><parent link="hand"/><child link="base"/>
<parent_origin xyz="0 0 1"/><child_origin xyz="0 0 2"/><parent_axis xyz="1 0 0"/>
<child_axis xyz="1 0 0"/></constraint></robot>"""
FORMATS = {"sdf": (SDF, FULL_SDF), "urdf": (URDF, FULL_URDF)}
#: Default → a different value.
OTHER = {"false": "true", "0": "0.5", "": "arm", "1": "0", "axis": "axis2", "0 0 0": "0 1 0"}
KEYS = [(kind, key) for kind, (schema, *_) in FORMATS.items() for key in schema.parts]


def read(tmp_path, kind, root, ignore=()):
    """Return the values, bodies, joints and forces that a reader makes of a file."""
    path = tmp_path / f"robot.{kind}"
    path.write_text(ElementTree.tostring(root, encoding="unicode"))
    parts = gs.Multibody.from_file(path, ignore=ignore)._components
    return (parts.values, [(body.name, repr(state)) for body, state in parts.bodies.items()],
            [(type(link).__name__, link.name) for link in parts.connections],
            [*map(repr, (parts.inertia, parts.potentials, parts.forces, parts.quantities))])


def places(root, key):
    """Return the elements that a key of a schema describes, with a parent of the key's name."""
    above, _, name = key.rpartition("/")
    if key == root.tag:
        return [root]
    parents = {path.rpartition("/")[0] for schema in (SDF, URDF) for path in schema.parts
               if path.endswith(f"/{name}")}
    return [child for parent in root.iter() for child in parent if child.tag == name
            and (parent.tag == above if above else parent.tag not in parents)]


def put(element, name, text):
    """Add an attribute or a child, which has parts of its own if it has no text."""
    if name.startswith("@"):
        element.set(name[1:], text or "some")
        return
    child = ElementTree.SubElement(element, name)
    child.text = text
    if text is None:
        ElementTree.SubElement(child, "anything", {"name": "x"}).text = "1 2 3"


@pytest.mark.parametrize("kind", FORMATS)
def test_each_part_is_in_one_class_and_the_file_has_all_that_is_read(kind):
    schema, text = FORMATS[kind]
    root = ElementTree.fromstring(text)
    for key, parts in schema.parts.items():
        assert len({*parts.names}) == len(parts.names), key
        assert places(root, key), key
        for default, *_ in parts.refused.values():
            assert default is None or default in OTHER


@pytest.mark.parametrize("kind", FORMATS)
def test_what_moves_nothing_changes_nothing(tmp_path, kind):
    """Adding all parts that move nothing, in each place where they may be, changes nothing."""
    schema, text = FORMATS[kind]
    root = ElementTree.fromstring(text)
    everything = deepcopy(root)
    for key, parts in schema.parts.items():
        for name in parts.still.split():
            for element in places(everything, key):
                put(element, name, None)
    assert read(tmp_path, kind, everything) == read(tmp_path, kind, root)


@pytest.mark.parametrize(("kind", "key"), KEYS)
def test_what_is_refused_is_named_with_its_line(tmp_path, kind, key):
    """A refused part changes nothing at its default; else its refusal names its line and cure."""
    schema, text = FORMATS[kind]
    refused = schema.parts[key].refused
    unchanged = read(tmp_path, kind, ElementTree.fromstring(text)) if refused else None
    for name, (default, ignored_by, _) in refused.items():
        for value in {default, OTHER.get(default, "x")} - {None}:
            root = ElementTree.fromstring(text)
            element = places(root, key)[-1]
            put(element, name, value)
            if value == default:
                if value or not name.startswith("@"):
                    assert read(tmp_path, kind, root) == unchanged, (key, name)
                continue
            with pytest.raises(gs.InputError) as caught:
                read(tmp_path, kind, root)
            message = str(caught.value)
            if ignored_by:
                assert f"{ignored_by} (" in message, (key, name)
                assert read(tmp_path, kind, root, ignored_by) == unchanged, (key, name)
            else:
                assert f"<{element.tag}>" in message, (key, name)
                assert (f"{name[1:]}=" if name[0] == "@" else f"<{name}>") in message
                with pytest.raises(gs.InputError, match=r"line [0-9]+: "):
                    read(tmp_path, kind, root, "all")


@pytest.mark.parametrize(("kind", "key"), KEYS)
def test_what_is_in_no_class_is_refused(tmp_path, kind, key):
    """Unknown elements and attributes, and single elements given twice, are refused with a line."""
    schema, text = FORMATS[kind]
    twice = [name for name in schema.parts[key].once.split() if not name.startswith("@")]
    for name, message in [("nonsense", "<nonsense>"), ("@nonsense", "nonsense= is no"),
                       *((name, f"<{name}>.*[23] times") for name in twice)]:
        root = ElementTree.fromstring(text)
        element = places(root, key)[-1]
        for _ in range(2):
            put(element, name, "x")
        with pytest.raises(gs.InputError, match=message) as caught:
            read(tmp_path, kind, root, "all")
        assert "line " in str(caught.value)


@pytest.mark.parametrize("kind", FORMATS)
def test_parts_of_other_programs_are_ignored_by_name(tmp_path, kind):
    """Prefixed elements and attributes are refused unless ignored; XML's own pass."""
    _, text = FORMATS[kind]
    path = tmp_path / f"robot.{kind}"
    for added in (f'<{kind}:rotor xmlns:{kind}="http://x"/></joint>', "</joint>"):
        attribute = f' {kind}:speed="1" xmlns:{kind}="http://x"' if added == "</joint>" else ""
        path.write_text(text.replace("</joint>", added, 1).replace(
            "<joint", f"<joint{attribute}", 1))
        with pytest.raises(gs.InputError, match=r"1 of them"):
            gs.Multibody.from_file(path)
        gs.Multibody.from_file(path, ignore="extension")
    path.write_text(text.replace(" name", ' xmlns:other="http://x" xml:base="x" name', 1))
    gs.Multibody.from_file(path)


BOMB = """<?xml version="1.0"?>
<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;">]>
<x name="&b;"/>
"""


@pytest.mark.parametrize(("ending", "root"), [("urdf", "robot"), ("sdf", "sdf"), ("xml", "mujoco")])
@pytest.mark.parametrize(("text", "message"), [
    (BOMB, "line 2.*type"), ("<x>" + "<link>" * 100_000, "64"), (" " * 10_000_000, "1048576"),
    ("<x>" + "<a/>" * 60_000 + "</x>", "50000"), ("", "element"), ("<svg/>", "<svg>"),
], ids=["bomb", "deep", "ten megabytes", "many", "empty", "another format"])
def test_files_cannot_grow(tmp_path, ending, root, text, message):
    if ending == "xml":
        pytest.importorskip("mujoco")
    path = tmp_path / f"bad.{ending}"
    path.write_text(text.replace("<x", f"<{root}").replace("</x", f"</{root}"), encoding="utf-8")
    with pytest.raises(gs.InputError, match=message):
        gs.load_model(path)


XS = "{http://www.w3.org/2001/XMLSchema}"


def folders(*patterns):
    """Return installed folders of schemas; SDF_PATH and URDF_PATH may name others."""
    roots = [Path(sys.prefix) / "share", Path("/usr/share"), Path("/usr/local/share")]
    named = [Path(entry) for key in ("SDF_PATH", "URDF_PATH")
             for entry in os.environ.get(key, "").split(os.pathsep) if entry]
    return [folder for folder in [*named, *(path for root in roots for pattern in patterns
                                            for path in root.glob(pattern))] if folder.is_dir()]


def sdf_rows(folder, name="root.sdf", above=(), files=()):
    """Yield paths of names of all elements and attributes of a version, with their defaults."""
    def walk(element, above):
        path = (*above, element.get("name") or "anything")
        yield path, element.get("default")
        for attribute in element.findall("attribute"):
            yield (*path, f"@{attribute.get('name')}"), attribute.get("default")
        if element.get("ref") is None:
            for child in element.findall("element"):
                yield from walk(child, path)
            for child in element.findall("include"):
                if child.get("filename") not in files:
                    yield from sdf_rows(folder, child.get("filename"), path, (*files, name))

    yield from walk(ElementTree.parse(folder / name).getroot(), above)


def test_sdf_has_each_part_of_the_published_schema():
    """Each path of the installed schemas is in one class, with the schema's default."""
    versions = [version for folder in folders("sdformat*") for version in folder.glob("1.*")
                if (version / "root.sdf").is_file() and 3 <= int(version.name[2:]) <= 12]
    if not versions:
        pytest.skip("no schemas of sdformat are installed, nor in SDF_PATH")
    for version in versions:
        for path, default in sdf_rows(version):
            above, (name, *remaining) = "", path
            while remaining:
                parts = SDF.parts.get(f"{above}/{name}") or SDF.parts.get(name, Parts())
                assert remaining[0] in parts.names, (version.name, path)
                if remaining[0] in parts.refused and len(remaining) == 1 and default is not None:
                    declared = parts.refused[remaining[0]].default
                    assert declared is None or declared == default or (
                        float(declared) == float(default))
                if remaining[0] in parts.refused or remaining[0] in parts.still.split():
                    break
                above, name, remaining = name, remaining[0], remaining[1:]


def test_urdf_has_each_part_of_the_published_schema():
    """Each element and attribute of urdf.xsd is in a class of the type that holds it."""
    files = [file for folder in folders("urdfdom*/xsd", "urdf*") for file in
             [*folder.glob("urdf.xsd"), *folder.glob("xsd/urdf.xsd")]]
    if not files:
        pytest.skip("no urdf.xsd is installed, nor in URDF_PATH")
    for file in files:
        root = ElementTree.parse(file).getroot()
        types = {e.get("name"): e for e in root.findall(f"{XS}complexType")}
        robot = root.find(f"{XS}element[@name='robot']/{XS}complexType")
        assert check_type(robot, "robot", "", types) >= 40


def check_type(kind, name, above, types):
    """Check the class of each part of a type; return the number of parts."""
    parts = URDF.parts.get(f"{above}/{name}") or URDF.parts.get(name, Parts())
    attributes = [f"@{e.get('name')}" for e in kind.findall(f"{XS}attribute")]
    children = [*kind.iter(f"{XS}element")]
    names = [*attributes, *(child.get("name") for child in children)]
    assert {*names} <= {*parts.names}, name
    read = {*parts.once.split(), *parts.many.split()}
    return len(names) + sum(check_type(types[child.get("type")], child.get("name"), name, types)
                            for child in children
                            if child.get("name") in read and child.get("type") in types)
