"""From kernels to C functions: statements printed, constants of a run, operation counts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field
from itertools import count

import sympy as sp

from ...core.real_types import Real
from ...core.records import dataclass
from ..symbolic.bounded_algebra import is_small
from ..symbolic.phases import since_start, without_start
from ..symbolic.shared_subexpressions import expand_shared, name_of, parts_of, symbols_of
from ..symbolic.switching_functions import Where
from .c_printer import ON_LANES, CPrinter
from .statements import Kernel, Statements, entries

__all__ = ["Constants", "EmittedKernel", "Target", "emit_kernel"]

#: Number of operations beside which the cost of a call is small.
_LONG = 40


@dataclass(frozen=True)
class EmittedKernel:
    """The C of a kernel: texts that the templates print, and its operation counts."""

    name: str
    doc: str
    returns: str
    signature: str
    lines: list[str]
    temporaries: int
    operations: dict[str, int]
    unused: list[str] = field(default_factory=list)
    constants: frozenset[str] = frozenset()
    #: Functions of <math.h> that it calls, without suffix.
    functions: frozenset[str] = frozenset()

    @property
    def is_long(self) -> bool:
        """Whether the kernel is better called than inlined twice."""
        return sum(self.operations.values()) > _LONG


class Constants:
    """Subexpressions of the parameters alone: computed once a run instead of in every kernel.

    Parameters
    ----------
    parameters : sequence of Symbol
        The parameters, with the inputs.
    coordinates : sequence of Symbol
        Further symbols whose names are not used for constants.
    clock : mapping
        Symbols that change within a step → their fields among the constants.
    inputs : sequence of Symbol
        Parameters that change during a run: they are no constants.
    time : Symbol or None
        The time of a system that depends on it.
    """

    def __init__(
        self, parameters: Sequence[sp.Symbol], coordinates: Sequence[sp.Symbol] = (),
        clock: Mapping[sp.Symbol, str] | None = None, inputs: Sequence[sp.Symbol] = (),
        time: sp.Symbol | None = None,
    ) -> None:
        self._time = time
        #: Symbols that change within a step, and their fields among the constants.
        self.clock = dict(clock or {})
        self.reserved = {str(s) for s in (*parameters, *coordinates)}
        self.parameters = tuple(parameters)
        #: Expression of parameters → the symbol of its constant; a parameter is its own.
        self.definitions: dict[sp.Expr, sp.Symbol] = {p: p for p in parameters}
        # The symbols of constants: a set, as H of 100 bodies looks them up for every term.
        self._constant_symbols = frozenset(parameters) - {*inputs}
        # Caches, expression → result of the method in brackets; an expression occurs many times.
        #: The expression in the time since the start (``since_start``).
        self._with_elapsed_time: dict[sp.Expr, sp.Expr] = {}
        #: The expression with symbols for its constant subexpressions (``hoist``).
        self._hoisted: dict[sp.Expr, sp.Expr] = {}
        #: Whether it has a condition or a sign (``_has_piecewise``).
        self._is_piecewise: dict[sp.Basic, bool] = {}
        #: Its free symbols (``_free_symbols``).
        self._symbols: dict[sp.Basic, frozenset[sp.Symbol]] = {}
        #: Whether it is not 0, of expressions in the symbols _0, _1, … (``_is_nonzero``).
        self._nonzero: dict[sp.Expr, bool | None] = {}
        #: Names for further constants: k0, k1, …
        self._free_names = (name for i in count() if (name := f"k{i}") not in self.reserved)
        #: Symbol of a constant → its C text ``c->k0`` (``names``).
        self._texts: dict[sp.Symbol, str] = {}

    def since_start(self, e: sp.Expr) -> sp.Expr:
        """Return e in the time since the start of a run, t = t_0 + τ, with constants hoisted."""
        if e not in self._with_elapsed_time:
            elapsed = e if self._time is None else since_start(
                e, self._time, self._constant_symbols, self._constant)
            self._with_elapsed_time[e] = self.hoist(elapsed)
        return self._with_elapsed_time[e]

    def _constant(self, e: sp.Expr) -> sp.Expr:
        """Return the constant of the run for an expression in the time at the start."""
        if e not in self.definitions:
            self.definitions[e] = sp.Symbol(next(self._free_names), real=True)
        return self.definitions[e]

    def hoist(self, e: sp.Expr) -> sp.Expr:
        """Return e with every largest parameter-only subexpression replaced by a symbol."""
        if e not in self._hoisted:
            self._hoisted[e] = self._hoist(e)
        return self._hoisted[e]

    def _hoist(self, e: sp.Expr) -> sp.Expr:
        """Return e with symbols for constant subexpressions.

        The constant arguments of a sum, or of a product, become one symbol. A number in front stays
        a number, 2 c: the kernel may use c elsewhere. aᵘ with a constant a becomes exp(u log a).
        """
        symbols = self._free_symbols(e)
        if not symbols or e.is_Symbol:
            return e
        if symbols <= self._constant_symbols:
            coefficient, constant = e.as_coeff_Mul()
            return coefficient * self._symbol(constant)
        if not e.is_Add and self._has_piecewise(e):
            return e  # with constants hoisted, continuity at the switches could not be proved
        if e.is_Mul or e.is_Add:
            # all constant arguments together are one constant
            constants = [a for a in e.args if self._is_constant(a)]
            varying = [self.hoist(a) for a in e.args if not self._is_constant(a)]
            return (e.func(self.hoist(e.func(*constants)), *varying) if constants
                    else e.func(*varying))
        if e.is_Pow and self._is_constant(e.base):
            return sp.exp(self.hoist(e.exp * sp.log(e.base)))  # a logarithm a run, not a call
        return e.func(*(self.hoist(a) for a in e.args))

    def _has_piecewise(self, e: sp.Basic) -> bool:
        """Whether e contains a condition or a sign, cached for all subexpressions."""
        if e not in self._is_piecewise:
            self._is_piecewise[e] = isinstance(e, (Where, sp.sign)) or any(
                map(self._has_piecewise, e.args))
        return self._is_piecewise[e]

    def _is_constant(self, e: sp.Expr) -> bool:
        """Whether e depends on parameters, and on nothing else; False of a number."""
        symbols = self._free_symbols(e)
        return bool(symbols) and symbols <= self._constant_symbols

    def _free_symbols(self, e: sp.Basic) -> frozenset[sp.Symbol]:
        """Return the free symbols of e, cached for all subexpressions."""
        if e not in self._symbols:
            for subexpression in parts_of([e]):
                if subexpression not in self._symbols:
                    own = [subexpression] if subexpression.is_Symbol else ()
                    self._symbols[subexpression] = frozenset(own).union(
                        *(self._symbols[a] for a in subexpression.args))
        return self._symbols[e]

    def _symbol(self, e: sp.Expr) -> sp.Symbol:
        """Return the constant of the run for an expression of parameters."""
        e = expand_shared(e)  # constants are printed as one expression, without temporaries
        if e not in self.definitions:
            assumptions = {"nonzero": True} if self._is_nonzero(e) else {}
            self.definitions[e] = sp.Symbol(next(self._free_names), real=True, **assumptions)
        return self.definitions[e]

    def _is_nonzero(self, e: sp.Expr) -> bool | None:
        """Return ``e.is_nonzero``, cached for expressions that are equal up to names, in order."""
        renaming = {s: sp.Symbol(f"_{i}", **s.assumptions0)
                    for i, s in enumerate(sorted(e.free_symbols, key=name_of))}
        renamed = e.xreplace(renaming)
        if renamed not in self._nonzero:
            self._nonzero[renamed] = e.is_nonzero
        return self._nonzero[renamed]

    def expand_shared(self, e: sp.Expr) -> sp.Expr:
        """Return e in terms of the parameters again."""
        expanded = e.xreplace({s: definition for definition, s in self.definitions.items()})
        return expanded if self._time is None else without_start(expanded)

    def names(self) -> dict[sp.Symbol, str]:
        """Return the C text inside a kernel of each constant, and of each symbol of ``clock``."""
        if len(self._texts) < len(self.definitions):
            self._texts = {symbol: f"c->{symbol.name}" for symbol in self.definitions.values()}
        return self._texts | {symbol: f"c->{field}" for symbol, field in self.clock.items()}


@dataclass(frozen=True)
class Target:
    """The number type of a kernel: one number, lanes of numbers, or a dual number."""

    #: The C types of a number and of the struct of constants.
    value: str
    constants: str
    #: Prefix of the names of kernels and of the functions that they call.
    prefix: str
    #: C text of additional symbols.
    names: Mapping[sp.Symbol, str] = field(default_factory=dict)
    #: Whether products in sums have parentheses, as MISRA C asks for.
    explicit: bool = False

    @classmethod
    def scalar(cls, real: Real) -> Target:
        """One state a call."""
        return cls(real.c_type, "constants", prefix="")

    @classmethod
    def lanes(cls, names: Mapping[sp.Symbol, str]) -> Target:
        """As many states a call as a vector register holds."""
        return cls("lanes", "lanes_constants", "lanes_", names)

    @classmethod
    def duals(cls) -> Target:
        """One state a call, with its derivative along a direction."""
        return cls("dual", "dual_constants", "dual_")


def emit_kernel(
    kernel: Kernel, constants: Constants, real: Real, target: Target | None = None
) -> EmittedKernel:
    """Return the C of a kernel: shared subexpressions first, then one line an output entry.

    ``target`` is the type of numbers, by default one number of type ``real``. Symbols become
    entries of input arrays, constants ``c->name``, temporaries local variables.
    """
    target = target or Target.scalar(real)
    names = constants.names() | dict(target.names)
    for array, symbols in kernel.inputs.items():
        names |= {symbol: f"{array}[{i}]" for i, symbol in enumerate(symbols)}
    is_compensated = kernel.compensated and all(
        map(_is_exact_polynomial, (e for _, e in entries(kernel))))
    # double words are sums over the expanded polynomials, which share no subexpressions
    statements = Statements([], entries(kernel)) if is_compensated else kernel.statements
    names |= {t: t.name.lstrip("_") for t, _ in statements.shared}
    printer = CPrinter(real, names, target.prefix, explicit=target.explicit)
    lines = (_sums_in_double_words if is_compensated else _assignments)(statements, printer, target)
    read_symbols = symbols_of(e for _, e in (*statements.shared, *statements.outputs))
    own_constants = read_symbols & set(constants.definitions.values())
    # functions of single lanes take the number of lanes from the constants
    lane_by_lane = printer.on_lanes and printer.functions - ON_LANES
    reads_constants = bool(
        own_constants or read_symbols & {*target.names, *constants.clock} or lane_by_lane)
    returns_number = not all(isinstance(output, list) for output in kernel.outputs.values())
    return EmittedKernel(
        name=target.prefix + kernel.name,
        doc=kernel.doc + (", in twice the working precision" if is_compensated else ""),
        returns=target.value if returns_number else "void",
        signature=_signature(kernel, target),
        lines=lines,
        temporaries=len(statements.shared),
        operations={"product": sum("add_product" in line for line in lines)} if is_compensated
        else dict(sorted(printer.operations.items())),
        unused=_unused_arguments(kernel, read_symbols, reads_constants),
        constants=frozenset(map(str, own_constants)),
        functions=frozenset(printer.functions),
    )


def _unused_arguments(
    kernel: Kernel, read_symbols: set[sp.Symbol], reads_constants: bool
) -> list[str]:
    """Return the arguments of the C function that it does not read, the constants ``c`` first.

    The templates print (void)a for each, as compilers warn of them otherwise.
    """
    arrays = [a for a, symbols in kernel.inputs.items() if read_symbols.isdisjoint(symbols)]
    return arrays if reads_constants else ["c", *arrays]


def _is_exact_polynomial(e: sp.Expr) -> bool:
    """Whether e is a polynomial with coefficients that are exact in every binary format."""
    if not is_small(e):  # the expansion of a large expression may take minutes
        return False
    for term in sp.Add.make_args(sp.expand(e)):
        a, monomial = term.as_coeff_Mul()
        # numerators below 2²⁰ fit into the 24 bits of a float; denominators are powers of 2
        if not (a.is_Rational and abs(a.p) < 2**20 and a.q & (a.q - 1) == 0):
            return False
        if not all((base.is_Symbol or base == 1) and power.is_Integer and power > 0
                   for base, power in monomial.as_powers_dict().items()):
            return False
    return True


def _sums_in_double_words(statements: Statements, printer: CPrinter, target: Target) -> list[str]:
    """Return the C of polynomials Σ a Π x_iⁿⁱ, with each product and sum as a double word.

    The engine's ``add_product`` adds one product to the double word ``sum``. Products of exact
    coefficients and inputs then cancel to twice the working precision, as in |q|² − 1.
    """
    zero = "splat(0)" if target.prefix else "0"
    lines = [f"{target.value} sum[2];"]  # a double word: high and low part
    for entry, e in statements.outputs:
        lines += [f"sum[0] = {zero};", f"sum[1] = {zero};"]
        for term in sp.Add.make_args(sp.expand(e)):
            coefficient, monomial = term.as_coeff_Mul()
            # a factor 1 is left out, unless it is the whole term
            factors = [] if coefficient == 1 and monomial != 1 else [printer.number(coefficient)]
            for base, power in monomial.as_powers_dict().items():
                if base != 1:
                    factors += [printer(base)] * int(power)
            lines.append(f"{{ const {target.value} factors[] = {{ {', '.join(factors)} }}; "
                         f"{target.prefix}add_product(sum, {len(factors)}, factors); }}")
        lines.append(f"{entry} = sum[0] + sum[1];")
    return lines


def sums_products(kernel: EmittedKernel, prefix: str = "") -> bool:
    """Whether a kernel calls ``add_product``; ``prefix`` is the prefix of its number type."""
    return any(f" {prefix}add_product(" in line for line in kernel.lines)


def wrap(statement: str, width: int = 96) -> str:
    """Break a long statement before + and - signs; continuation lines are indented."""
    lines, remainder, search_from = [], statement, 0
    while len(remainder) > width:
        break_at = max(remainder.rfind(sign, search_from, width) for sign in (" + ", " - "))
        if break_at <= 0:
            break
        lines.append(remainder[:break_at])
        remainder = "    " + remainder[break_at + 1 :]
        search_from = 5  # after the sign at the beginning of a continuation line
    return "\n    ".join([*lines, remainder])


def _assignments(statements: Statements, printer: CPrinter, target: Target) -> list[str]:
    """Return one line for each temporary and output entry, or the return of the only entry."""
    lines = [f"const {target.value} {printer(t)} = {printer.number(e)};"
             for t, e in statements.shared]
    for entry, e in statements.outputs:
        number = printer.number(e) if e.is_number or not entry else printer(e)
        lines.append(f"{entry} = {number};" if entry else f"return {number};")
    return [*map(wrap, lines)]


def _signature(kernel: Kernel, target: Target) -> str:
    """Return the parameters of the C function: constants, inputs, outputs."""
    arguments = [f"const {target.constants} *c"]
    arguments += [f"const {target.value} {array}[{len(symbols)}]"
                  for array, symbols in kernel.inputs.items()]
    for array, output in kernel.outputs.items():
        if isinstance(output, list):  # the function returns an output that is no array
            columns = f"[{len(output[0])}]" if isinstance(output[0], list) else ""
            shape = f"[{len(output)}]{columns}"
            arguments.append(f"{target.value} {array}{shape}")
    return ", ".join(arguments)
