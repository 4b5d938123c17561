"""A kernel carried out by NumPy: the second way to the numbers that its C computes.

The same statements as the C, one after the other, in any type that NumPy has: in complex numbers
they differentiate, f'(x) = Im f(x + iε)/ε, to round-off without a formula for f'.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gyrospark.generator.kernels.kernel import Constants
from gyrospark.generator.kernels.statements import Kernel, statements_of
from gyrospark.generator.symbolic.numeric_evaluation import Evaluator
from gyrospark.generator.symbolic.phases import START

__all__ = ["carry_out"]


def carry_out(
    kernel: Kernel, constants: Constants, parameters: Mapping[str, Any], inputs: Mapping[str, Any]
) -> dict[str, NDArray[Any]]:
    """Return the outputs of a kernel.

    Parameters
    ----------
    kernel, constants
        As they are emitted.
    parameters : mapping of str to number
        The values of a run.
    inputs : mapping of str to array
        A value for each input array; further axes behind the first are carried along.

    Returns
    -------
    dict of str to ndarray
        By the name of the output; what the function returns has the name "".
    """
    # Kernels count time from the start of a run, here from 0.
    walk = Evaluator({START: 0.0, **{s: parameters[str(s)] for s in constants.parameters}})
    for e, symbol in constants.definitions.items():
        walk.define(symbol, walk(e))
    for array, symbols in kernel.inputs.items():
        for symbol, value in zip(symbols, np.asarray(inputs[array]), strict=True):
            walk.define(symbol, value)
    made = statements_of(kernel)
    for symbol, e in made.shared:
        walk.define(symbol, walk(e))
    values = iter([walk(e) for _, e in made.outputs])

    def filled(shape: Any) -> NDArray[Any]:
        if not isinstance(shape, list):
            return np.asarray(next(values))
        return np.stack(np.broadcast_arrays(*map(filled, shape)))

    return {array if isinstance(shape, list) else "": filled(shape)
            for array, shape in kernel.outputs.items()}
