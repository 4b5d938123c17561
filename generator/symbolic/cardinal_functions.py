"""Cardinal functions f(z)/z: even, 1 at z = 0, factors of divided differences.

    sinc = sin(z)/z   sinhc = sinh(z)/z   asinhc = asinh(z)/z   atanc = atan(z)/z
    atanhc = atanh(z)/z

Discrete gradients contain them, Newton's matrix their derivatives. As expressions they are opaque:
SymPy knows their value at 0 and their parity, and differentiates them once into a function
``…_slope``. The C of both is in ``templates/cardinal.c.jinja``.
"""

from __future__ import annotations

from typing import Any

import mpmath as mp
import sympy as sp

__all__ = ["Asinhc", "Atanc", "Atanhc", "Numeric", "Sinc", "Sinhc",
           "c_names_with_needs"]


class Numeric(sp.Function):  # type: ignore[misc]
    """A real function with a value in mpmath and a name in C."""

    nargs: Any = 1
    c_name = ""

    @staticmethod
    def value(*arguments: Any) -> Any:
        """Return the value at mpmath numbers, to working precision."""
        raise NotImplementedError

    def _eval_evalf(self, prec: int) -> sp.Expr | None:
        """Return the value to ``prec`` bits by mpmath, if all arguments are numbers."""
        arguments = [a._eval_evalf(prec) for a in self.args]
        if not all(a is not None and a.is_Number for a in arguments):
            return None
        with mp.workprec(prec):
            number = self.value(*(a._to_mpmath(prec) for a in arguments))
            return sp.Float._new(number._mpf_, prec)

    def _eval_is_extended_real(self) -> Any:
        """Return whether the value is real: it is where the argument is."""
        return self.args[0].is_extended_real


class _Cardinal(Numeric):
    """An even function with the value 1 at 0."""

    slope: type[_Slope]

    @classmethod
    def eval(cls, z: sp.Expr) -> sp.Expr | None:
        """Return 1 at 0 and the same for z and −z."""
        if z == 0:
            return sp.Integer(1)
        return cls(-z) if z.could_extract_minus_sign() else None

    def fdiff(self, argindex: int = 1) -> sp.Expr:
        """Return the derivative."""
        return self.slope(self.args[0])


class _Slope(Numeric):
    """The derivative of a cardinal function: odd, 0 at 0."""

    @classmethod
    def eval(cls, z: sp.Expr) -> sp.Expr | None:
        """Return 0 at 0 and the opposite for −z."""
        if z == 0:
            return sp.Integer(0)
        return -cls(-z) if z.could_extract_minus_sign() else None


def _slope_function(derivative: Any, third: int) -> Any:
    """Return the function (class of f(z)/z, z) ↦ (f′(z) − f(z)/z)/z in mpmath.

    ``derivative`` is f′; ``third`` is f‴(0): for z → 0 the result is f‴(0) z/3.
    """

    def value(function: type[_Cardinal], z: Any) -> Any:
        """Return the derivative of f(z)/z to working precision."""
        if abs(z) < mp.ldexp(1, -mp.mp.prec):
            return third * z / 3
        # f′(z) − f(z)/z is of the order z²: as many bits cancel
        cancelled_bits = max(0, -2 * mp.frexp(z)[1])
        with mp.workprec(mp.mp.prec + cancelled_bits + 16):
            return (derivative(z) - function.value(z)) / z

    return value


def _make_slope(function: type[_Cardinal], derivative: Any, third: int) -> type[_Slope]:
    """Return the class of the derivative of a cardinal function f(z)/z.

    ``derivative`` is f′ in mpmath, ``third`` is f‴(0).
    """
    evaluate = _slope_function(derivative, third)
    name = f"{function.__name__}Slope"
    return type(name, (_Slope,), {
        "__doc__": f"The derivative of {function.c_name}.",
        "__module__": __name__,
        "c_name": f"{function.c_name}_slope",
        "value": staticmethod(lambda z: evaluate(function, z)),
    })


def _cardinal(name: str, function: Any, derivative: Any, third: int) -> type[_Cardinal]:
    """Return the class of f(z)/z and its derivative.

    ``function`` and ``derivative`` are f and f′ in mpmath, ``third`` is f‴(0), and ``name`` the
    name of the class, as Sinc, of which the name in C follows.
    """
    cardinal: type[_Cardinal] = type(name, (_Cardinal,), {
        "__doc__": f"{name[:-1].lower()}(z)/z.",
        "__module__": __name__,
        "c_name": name.lower(),
        "value": staticmethod(lambda z: function(z) / z if z else mp.mpf(1)),
    })
    cardinal.slope = _make_slope(cardinal, derivative, third)
    return cardinal


Sinc = _cardinal("Sinc", mp.sin, mp.cos, third=-1)
Sinhc = _cardinal("Sinhc", mp.sinh, mp.cosh, third=1)
Asinhc = _cardinal("Asinhc", mp.asinh, lambda z: 1 / mp.sqrt(1 + z * z), third=-1)
Atanc = _cardinal("Atanc", mp.atan, lambda z: 1 / (1 + z * z), third=-2)
Atanhc = _cardinal("Atanhc", mp.atanh, lambda z: 1 / (1 - z * z), third=2)

#: Functions that the C of a slope calls besides the cardinal function itself.
_NEEDS = {"asinhc_slope": ("asinhc", "sinhc_slope"), "atanc_slope": ("atanc", "sinc_slope"),
          "atanhc_slope": ("atanhc", "sinhc_slope")}
_NAMES = {f.c_name for function in (Sinc, Sinhc, Asinhc, Atanc, Atanhc)
          for f in (function, function.slope)}


def c_names_with_needs(functions: frozenset[str]) -> frozenset[str]:
    """Return the C names of the cardinal functions among ``functions`` and of those they call."""
    cardinal_names = functions & _NAMES
    return cardinal_names.union(*(_NEEDS.get(name, ()) for name in cardinal_names))
