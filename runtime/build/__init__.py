"""From the text of a stepper to its loaded module: compiler, cache, manifest.

    manifest      what a stepper says of itself, checked before sizes are used
    compiler      find a C compiler, make an extension module
    places        where bodies and joints are in the arrays of a run
    objects       what is compiled side by side, and for which module
    permutations  objects with a vector instruction that gcc gets wrong
    quad_wrapper  what cffi is told of a float128 stepper
    kernel_text   the kernels in C, read back and evaluated by NumPy or mpmath
    kernel_check  compiled kernels beside these values
    verified      compile and compare; compile again with safer flags where they differ
    cache         what is kept between runs
    prebuilt      what a wheel for one platform brings, where there is no compiler
    module        the text of a stepper to its module
"""
