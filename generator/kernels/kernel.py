"""From kernels to C functions: statements printed, constants of a run, operation counts."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import count

import sympy as sp

from ...core.real_types import Real
from ..symbolic.bounded_algebra import is_small
from ..symbolic.phases import since_start, without_start
from ..symbolic.shared_subexpressions import expand_shared, name_of, parts_of, symbols_of
from ..symbolic.switching_functions import Where
from .c_printer import ON_LANES, CPrinter
from .statements import Kernel, Statements, entries

__all__ = ["Constants", "EmittedKernel", "Target", "emit_kernel"]

#: Operations of a kernel beside which a call is little.
_LONG = 40


@dataclass(frozen=True)
class EmittedKernel:
    """A kernel as the template prints it."""

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
        """Whether it costs more to compile it twice than to call it."""
        return sum(self.operations.values()) > _LONG


class Constants:
    """Subexpressions of the parameters alone: computed once a run instead of in every kernel."""

    def __init__(
        self, parameters: Sequence[sp.Symbol], others: Sequence[sp.Symbol] = (),
        clock: Mapping[sp.Symbol, str] | None = None, inputs: Sequence[sp.Symbol] = (),
        time: sp.Symbol | None = None,
    ) -> None:
        self._time = time
        #: Symbols that change within a step, and their fields among the constants.
        self.clock = dict(clock or {})
        self.taken = {str(s) for s in (*parameters, *others)}
        self.parameters = tuple(parameters)
        self.definitions: dict[sp.Expr, sp.Symbol] = {p: p for p in parameters}
        # Made once: H of 100 bodies asks it for every term.
        self._known = frozenset(parameters) - {*inputs}
        self._timed: dict[sp.Expr, sp.Expr] = {}
        self._hoisted: dict[sp.Expr, sp.Expr] = {}
        self._pieces: dict[sp.Basic, bool] = {}
        self._symbols: dict[sp.Basic, frozenset[sp.Symbol]] = {}
        self._nonzero: dict[sp.Expr, bool | None] = {}
        self._free_names = (name for i in count() if (name := f"k{i}") not in self.taken)
        self._texts: dict[sp.Symbol, str] = {}

    def since_start(self, e: sp.Expr) -> sp.Expr:
        """Return e with the time since the start of a run in place of the time, hoisted."""
        if e not in self._timed:
            timed = e if self._time is None else since_start(
                e, self._time, self._known, self._constant)
            self._timed[e] = self.hoist(timed)
        return self._timed[e]

    def _constant(self, e: sp.Expr) -> sp.Expr:
        if e not in self.definitions:
            self.definitions[e] = sp.Symbol(next(self._free_names), real=True)
        return self.definitions[e]

    def hoist(self, e: sp.Expr) -> sp.Expr:
        """Return e with every largest parameter-only subexpression replaced by a symbol."""
        if e not in self._hoisted:
            self._hoisted[e] = self._hoist(e)
        return self._hoisted[e]

    def _hoist(self, e: sp.Expr) -> sp.Expr:
        free = self._free_symbols(e)
        if not free or e.is_Symbol:
            return e
        if free <= self._known:
            number, rest = e.as_coeff_Mul()
            return number * self._symbol(rest)
        if not e.is_Add and self._has_pieces(e):
            return e  # as it is written, its pieces are seen to meet
        if e.is_Mul or e.is_Add:
            own = [a for a in e.args if self._is_own(a)]
            rest = [self.hoist(a) for a in e.args if not self._is_own(a)]
            return e.func(self.hoist(e.func(*own)), *rest) if own else e.func(*rest)
        if e.is_Pow and self._is_own(e.base):
            return sp.exp(self.hoist(e.exp * sp.log(e.base)))  # a logarithm a run, not a call
        return e.func(*(self.hoist(a) for a in e.args))

    def _has_pieces(self, e: sp.Basic) -> bool:
        if e not in self._pieces:
            self._pieces[e] = isinstance(e, (Where, sp.sign)) or any(
                map(self._has_pieces, e.args))
        return self._pieces[e]

    def _is_own(self, e: sp.Expr) -> bool:
        free = self._free_symbols(e)
        return bool(free) and free <= self._known

    def _free_symbols(self, e: sp.Basic) -> frozenset[sp.Symbol]:
        """Return the free symbols of e, found once for each part of an expression."""
        if e not in self._symbols:
            for part in parts_of([e]):
                if part not in self._symbols:
                    self._symbols[part] = frozenset(part.free_symbols)
        return self._symbols[e]

    def _symbol(self, e: sp.Expr) -> sp.Symbol:
        e = expand_shared(e)  # constants are printed as they are, without temporaries
        if e not in self.definitions:
            facts = {"nonzero": True} if self._is_nonzero(e) else {}
            self.definitions[e] = sp.Symbol(next(self._free_names), real=True, **facts)
        return self.definitions[e]

    def _is_nonzero(self, e: sp.Expr) -> bool | None:
        """Return ``e.is_nonzero``, asked once of expressions that differ in names alone."""
        places = {s: sp.Symbol(f"_{i}", **s.assumptions0)
                  for i, s in enumerate(sorted(e.free_symbols, key=name_of))}
        form = e.xreplace(places)
        if form not in self._nonzero:
            self._nonzero[form] = e.is_nonzero
        return self._nonzero[form]

    def expand_shared(self, e: sp.Expr) -> sp.Expr:
        """Return e in terms of the parameters again."""
        whole = e.xreplace({symbol: definition for definition, symbol in self.definitions.items()})
        return whole if self._time is None else without_start(whole)

    def names(self) -> dict[sp.Symbol, str]:
        """Return the C text of each constant inside a kernel."""
        if len(self._texts) < len(self.definitions):
            self._texts = {symbol: f"c->{symbol.name}" for symbol in self.definitions.values()}
        return self._texts | {symbol: f"c->{field}" for symbol, field in self.clock.items()}


@dataclass(frozen=True)
class Target:
    """What a kernel computes with: one number, lanes of numbers, or a dual number."""

    value: str
    constants: str
    prefix: str
    #: Further symbols with their C text.
    names: Mapping[sp.Symbol, str] = field(default_factory=dict)
    #: Whether products in sums have parentheses, as MISRA C asks for.
    explicit: bool = False

    @classmethod
    def scalar(cls, real: Real) -> Target:
        """One state a call."""
        return cls(real.c_type, "constants", "")

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
    """Return the C of a kernel: shared subexpressions first, then one line an output entry."""
    target = target or Target.scalar(real)
    names = constants.names() | dict(target.names)
    for array, symbols in kernel.inputs.items():
        names |= {symbol: f"{array}[{i}]" for i, symbol in enumerate(symbols)}
    if kernel.compensated and all(map(_is_exact_polynomial, (e for _, e in entries(kernel)))):
        return _emit_compensated(kernel, entries(kernel), constants, real, names, target)
    made = kernel.statements
    names |= {t: t.name.lstrip("_") for t, _ in made.shared}
    printer = CPrinter(real, names, target.prefix, explicit=target.explicit)
    lines = [wrap(f"const {target.value} {printer(t)} = {printer.number(e)};")
             for t, e in made.shared]
    lines += map(wrap, _assignments(made, printer))
    used = symbols_of(e for _, e in (*made.shared, *made.outputs))
    unused = [a for a, symbols in kernel.inputs.items() if not used & set(symbols)]
    own_constants = used & set(constants.definitions.values())
    singly = printer.on_lanes and printer.functions - ON_LANES  # are told how many lanes to do
    if not own_constants and not used & {*target.names, *constants.clock} and not singly:
        unused.insert(0, "c")
    return EmittedKernel(
        target.prefix + kernel.name,
        kernel.doc,
        "void" if all(isinstance(v, list) for v in kernel.outputs.values()) else target.value,
        _signature(kernel, target),
        lines,
        len(made.shared),
        dict(sorted(printer.operations.items())),
        unused,
        frozenset(map(str, own_constants)),
        frozenset(printer.functions),
    )


def _is_exact_polynomial(e: sp.Expr) -> bool:
    """Whether e is a sum of products with coefficients that every binary format holds exactly."""
    return is_small(e) and all(
        (base.is_Symbol or base == 1) and power.is_Integer and power > 0
        for term in sp.Add.make_args(sp.expand(e))
        for base, power in term.as_coeff_Mul()[1].as_powers_dict().items()
    ) and all(
        number.is_Rational and abs(number.p) < 2**20 and number.q & (number.q - 1) == 0
        for number in (term.as_coeff_Mul()[0] for term in sp.Add.make_args(sp.expand(e)))
    )


def _emit_compensated(
    kernel: Kernel,
    targets: list[tuple[str, sp.Expr]],
    constants: Constants,
    real: Real,
    names: dict[sp.Symbol, str],
    target: Target,
) -> EmittedKernel:
    """Return a kernel that adds the products of each polynomial with ``add_product``."""
    printer = CPrinter(real, names, target.prefix)
    zero = "splat(0)" if target.prefix else "0"
    lines = [f"{target.value} sum[2];"]
    for entry, e in targets:
        lines += [f"sum[0] = {zero};", f"sum[1] = {zero};"]
        for term in sp.Add.make_args(sp.expand(e)):
            number, rest = term.as_coeff_Mul()
            factors = [] if number == 1 and rest != 1 else [printer.number(number)]
            for base, power in rest.as_powers_dict().items():
                factors += [] if base == 1 else [printer(base)] * int(power)
            lines.append(f"{{ const {target.value} factors[] = {{ {', '.join(factors)} }}; "
                         f"{target.prefix}add_product(sum, {len(factors)}, factors); }}")
        lines.append(f"{entry} = sum[0] + sum[1];")
    symbols = symbols_of(e for _, e in targets)
    used = symbols & set(constants.definitions.values())
    unused = [a for a, s in kernel.inputs.items() if not symbols & set(s)]
    return EmittedKernel(
        target.prefix + kernel.name, f"{kernel.doc}, in twice the working precision", "void",
        _signature(kernel, target), lines, 0,
        {"product": sum("add_product" in line for line in lines)},
        ([] if used or symbols & {*constants.clock} else ["c"]) + unused,
        frozenset(map(str, used)),
    )


def sums_products(kernel: EmittedKernel, prefix: str = "") -> bool:
    """Whether a kernel of numbers calls ``add_product``; one of lanes does with their prefix."""
    return any(f" {prefix}add_product(" in line for line in kernel.lines)


def wrap(statement: str, width: int = 96) -> str:
    """Break a long statement before + and - signs; continuation lines are indented."""
    lines, rest, begin = [], statement, 0
    while len(rest) > width:
        at = max(rest.rfind(" + ", begin, width), rest.rfind(" - ", begin, width))
        if at <= 0:
            break
        lines.append(rest[:at])
        rest = "    " + rest[at + 1 :]
        begin = 5  # not at the sign that this line begins with
    return "\n    ".join([*lines, rest])


def _assignments(made: Statements, printer: CPrinter) -> Iterator[str]:
    """Yield one assignment an entry; an entry equal to an earlier one copies it."""
    seen: dict[sp.Expr, str] = {}
    for target, e in made.outputs:
        if not target:
            yield f"return {printer.number(e)};"
        elif e.is_number:
            yield f"{target} = {printer.number(e)};"
        elif e in seen and not e.is_Atom:
            yield f"{target} = {seen[e]};"
        else:
            seen[e] = target
            yield f"{target} = {printer(e)};"


def _signature(kernel: Kernel, target: Target) -> str:
    parts = [f"const {target.constants} *c"]
    parts += [f"const {target.value} {a}[{len(s)}]" for a, s in kernel.inputs.items()]
    for array, value in kernel.outputs.items():
        if isinstance(value, list):
            shape = f"[{len(value)}]" + (f"[{len(value[0])}]" if isinstance(value[0], list) else "")
            parts.append(f"{target.value} {array}{shape}")
    return ", ".join(parts)


def total_operations(kernels: Sequence[EmittedKernel]) -> dict[str, int]:
    """Return the sum of the operation counts."""
    total: Counter[str] = Counter()
    for kernel in kernels:
        total.update(kernel.operations)
    return dict(sorted(total.items()))
