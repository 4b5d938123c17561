"""FMUs for co-simulation, FMI 2.0 and 3.0: targets ``fmu2`` and ``fmu3``.

In: manifest and sources of a stepper.
Out: an .fmu archive with libraries for five platforms.
Open first: ``target``.

    target          files, libraries and the check, for both versions
    variables       the variables of an FMU, with starts, bounds and units
    description     modelDescription.xml, buildDescription.xml, and tables for core.h
    archive         libraries for platforms, and the file that holds all
    slave           a loaded FMU, by ctypes

core.h, common.h, fmi2.c and fmi3.c are the C beside them. fmi2.h and fmi3.h declare the types that
co-simulation reads, and export.h refuses the functions that an FMU here does not offer.
"""
