"""The descriptions of an FMU: modelDescription.xml, buildDescription.xml, tables for core.h."""

from __future__ import annotations

import json
import uuid
from collections.abc import Sequence
from xml.etree import ElementTree
from xml.etree.ElementTree import Element
from xml.etree.ElementTree import SubElement as Sub

from ...core.manifest import Manifest
from ...core.units import base_units
from ..artefact import Options, parameter_fields
from .variables import LEAST, Variable, unit_of

__all__ = ["build_description", "model_description", "model_header", "token"]


def token(manifest: Manifest, variables: Sequence[Variable], version: int) -> str:
    """Return the GUID, a hash of the model, its start and the version: equal for equal builds."""
    content = [manifest.as_json(), [[v.name, v.start] for v in variables], version]
    return str(uuid.uuid5(uuid.NAMESPACE_URL, json.dumps(content, sort_keys=True)))


def _text(root: Element) -> str:
    """Return an XML document with its declaration, indented."""
    ElementTree.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ElementTree.tostring(root, "unicode")}\n'


def model_description(
    manifest: Manifest, options: Options, variables: Sequence[Variable], version: int,
) -> str:
    """Return modelDescription.xml of FMI 2.0 or 3.0, whose ``version`` is 2 or 3."""
    name, is_fmi2 = manifest.name, version == 2
    root = Element("fmiModelDescription", {
        "fmiVersion": f"{version}.0", "modelName": name,
        "guid" if is_fmi2 else "instantiationToken": token(manifest, variables, version),
        "description": options.description or f"{manifest.system.name}, "
                                              f"{manifest.scheme.method}",
        "generationTool": f"gyrospark {manifest.generator}",
        "variableNamingConvention": "flat",
        **({"numberOfEventIndicators": "0"} if is_fmi2 else {})})
    # the two versions of FMI spell this differently
    state = "FMUstate" if is_fmi2 else "FMUState"
    # "memory management functions" are the importer's calloc, in place of which fmi2.c has its own
    simulation = Sub(root, "CoSimulation", {
        "modelIdentifier": name, "canHandleVariableCommunicationStepSize": "true",
        f"canGetAndSet{state}": "true", f"canSerialize{state}": "true",
        **({"canNotUseMemoryManagementFunctions": "true"} if is_fmi2 else {})})
    if is_fmi2:
        sources = Sub(simulation, "SourceFiles")
        for file in ("fmi2.c", f"{name}.c"):
            Sub(sources, "File", name=file)
    definitions = Sub(root, "UnitDefinitions")
    for unit in dict.fromkeys(v.unit for v in variables if v.unit):
        base = {key: str(power) for key, power in base_units(unit).items()}
        Sub(Sub(definitions, "Unit", name=unit), "BaseUnit", base)
    Sub(Sub(root, "LogCategories"), "Category", name="logStatus")
    Sub(root, "DefaultExperiment", startTime="0", stopTime=repr(1000 * options.dt),
        stepSize=repr(float(options.dt)))
    (_variables2 if is_fmi2 else _variables3)(root, variables)
    return _text(root)


def _attributes(variable: Variable) -> dict[str, str]:
    """Return the attributes of a variable that are equal in both versions."""
    return {"description": variable.about, "causality": variable.causality,
            "variability": variable.variability,
            **({"initial": variable.initial} if variable.initial else {})}


def _numbers(variable: Variable) -> dict[str, str]:
    """Return the attributes unit, min and start of a variable, each where the variable has one.

    FMI forbids a start of a calculated variable.
    """
    return {**unit_of(variable), **({"min": repr(LEAST)} if variable.domain == "positive" else {}),
            **({} if variable.start is None or variable.initial == "calculated"
               else {"start": repr(variable.start)})}


def _variables2(root: Element, variables: Sequence[Variable]) -> None:
    """Add variables, dependencies of outputs and initial unknowns to ``root`` as FMI 2 has them.

    Value references count from 0, positions in dependencies and unknowns from 1.
    """
    model_variables = Sub(root, "ModelVariables")
    for reference, variable in enumerate(variables):
        element = Sub(model_variables, "ScalarVariable", {
            "name": variable.name, "valueReference": str(reference), **_attributes(variable)})
        Sub(element, "Real", _numbers(variable))
    structure = Sub(root, "ModelStructure")
    inputs = {v.name: str(k) for k, v in enumerate(variables, 1)
              if v.causality in ("input", "independent")}
    outputs = Sub(structure, "Outputs")
    unknown = [(str(k), v) for k, v in enumerate(variables, 1) if v.causality == "output"]
    for index, variable in unknown:
        Sub(outputs, "Unknown", index=index, dependencies=" ".join(
            inputs[name] for name in variable.depends or () if name in inputs))
    # outputs that the FMU computes from the start
    initial_unknowns = Sub(structure, "InitialUnknowns")
    for index, variable in unknown:
        if variable.initial == "calculated":
            Sub(initial_unknowns, "Unknown", index=index)


def _variables3(root: Element, variables: Sequence[Variable]) -> None:
    """Add variables and the dependencies of outputs to ``root`` as FMI 3 has them: by reference."""
    model_variables = Sub(root, "ModelVariables")
    for reference, variable in enumerate(variables):
        Sub(model_variables, "Float64", {
            "name": variable.name, "valueReference": str(reference),
            **_attributes(variable), **_numbers(variable)})
    structure = Sub(root, "ModelStructure")
    references = {v.name: str(k) for k, v in enumerate(variables)}
    outputs = [v for v in variables if v.causality == "output"]
    for variable in outputs:
        Sub(structure, "Output", valueReference=references[variable.name],
            dependencies=" ".join(references[name] for name in variable.depends or ()))
    for variable in outputs:
        if variable.initial == "calculated":
            Sub(structure, "InitialUnknown", valueReference=references[variable.name])


def build_description(name: str) -> str:
    """Return sources/buildDescription.xml of FMI 3.0."""
    root = Element("fmiBuildDescription", fmiVersion="3.0")
    files = Sub(Sub(root, "BuildConfiguration", modelIdentifier=name), "SourceFileSet",
                language="C11", compilerOptions="-O2 -ffp-contract=off")
    for file in ("fmi3.c", f"{name}.c"):
        Sub(files, "SourceFile", name=file)
    return _text(root)


def _start_of_members(options: Options, variables: Sequence[Variable]) -> dict[str, float]:
    """Return the start by members of the struct of a model: q, p and the variables' own starts.

    Parameters are in a struct of their own. A Lagrangian's variables are velocities, and p is there
    for the compiled code.
    """
    starts = {f"q[{k}]": x for k, x in enumerate(options.q)}
    starts |= {f"p[{k}]": x for k, x in enumerate(options.p)}
    return starts | {v.member: v.start for v in variables
                     if v.start is not None and not v.member.startswith("parameters.")}


def model_header(
    manifest: Manifest, options: Options, variables: Sequence[Variable], version: int,
) -> str:
    """Return sources/model.h: the stepper and its numbers, as core.h reads them.

    VARIABLES has a row for each value reference: name, offset in the struct of a model, when it
    can be set, domain. INITIAL initialises that struct. Functions that a stepper does not have are
    macros that do nothing and succeed, so that core.h is the same for all. ``version`` of FMI, 2 or
    3, is in the GUID alone.
    """
    name, system = manifest.name, manifest.system
    roles = [quantity.role for quantity in system.numbers]
    velocities, quantities = roles.count("velocity"), roles.count("quantity")
    time_argument = "&(m)->time, " if system.quantities_take_time else ""
    # calls of the stepper for a model m
    start = (f"{name}_start(&(m)->parameters, (m)->q, (m)->velocity, (m)->p)" if velocities
             # without that function nothing computes how far a start is from the constraints
             else "STATUS(INVALID)" if system.constraints else "STATUS(OK)")
    velocity = f"{name}_velocity(&(m)->parameters, (m)->q, (m)->p, (m)->velocity)"
    observe = (f"{name}_quantities(&(m)->parameters, {time_argument}(m)->q, (m)->p, "
               "(m)->quantities)")
    variable_rows = ", \\\n    ".join(
        f'{{ "{v.name}", offsetof(model_t, {v.member}), {v.settable}, {v.domain.upper()} }}'
        for v in variables)
    members = ", ".join(f".{field} = {float(options.parameters.get(field, 0))!r}"
                        for field in parameter_fields(manifest))
    starts = ", ".join(f".{member} = {float(x)!r}"
                       for member, x in _start_of_members(options, variables).items())
    return f"""/* Generated: tables of one stepper for core.h. */
#include <stddef.h>

#define {name.upper()}_WORK
#include "{name}.h"

#define STEPPER(x) {name}_##x
#define STATUS(x) {name.upper()}_##x
#define GUID "{token(manifest, variables, version)}"

enum {{ N = {len(system.coordinates)}, V = {velocities}, OBSERVED = {quantities},
    ITERATIONS = {options.max_iterations} }};

#define START(m) {start}
#define VELOCITY(m) {velocity if velocities else "(void)(m)"}
#define OBSERVE(m) {observe if quantities else "(void)(m)"}
#define SET_TIME(m) {f"(m)->parameters.{system.time} = (m)->time" if system.time
                     else "(void)(m)"}

#define VARIABLES \\
    {variable_rows}

#define INITIAL {{ {starts}, \\
    .parameters = {{ {members} }} }}
"""
