"""From the text of a stepper to its loaded module: compiler, cache, manifest.

In: the texts of header, source and manifest.
Out: a loaded module, from the cache if it is there.
Open first: ``stepper_module.load_module``.

    manifest          what a stepper says of itself, checked before sizes are used
    compiler          find a C compiler, make an extension module
    body_columns      columns of bodies and joints in the arrays of a run
    object_files      objects that compile side by side; vector instructions that gcc gets wrong
    newton_library    Newton's method as a shared library that is compiled when it is needed
    call_stack        bytes of stack of compiled functions; calls that take more than a thread has
    quad_wrapper      declarations of a float128 stepper for cffi
    kernel_text       the kernels in C, read back and evaluated by NumPy or mpmath
    kernel_check      compiled kernels beside these values
    verified_build    compile and compare; compile again with safer flags where they differ
    build_cache       cached sources and modules
    prebuilt          modules in a wheel for one platform, where there is no compiler
    stepper_module    the text of a stepper to its module
"""
