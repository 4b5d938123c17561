"""JSON text of numbers of Python and NumPy."""

import json
import math

import numpy as np
import pytest

from gyrospark.core.strict_json import json_text


@pytest.mark.parametrize("number", [float, np.float32, np.float64, np.longdouble])
def test_numbers_of_each_type_are_plain_and_those_that_json_lacks_null(number):
    document = {"finite": (number(0.1),), "others": [number(x) for x in (math.nan, math.inf)]}
    assert json.loads(json_text(document)) == {
        "finite": [float(number(0.1))], "others": [None, None]}


def test_integers_and_booleans_of_numpy_are_plain():
    assert json.loads(json_text([np.int64(3), np.True_])) == [3, True]
