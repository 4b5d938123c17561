"""How the paper writes its norms, representations and parameters."""

from __future__ import annotations

from .case_runner import Quantity

__all__ = ["NORMS", "PARAMETERS", "letter", "row_name"]

#: Quantity → its mean error, (87)-(91).
NORMS: dict[Quantity, str] = {
    "H": "E[|ΔH|]", "E": "E[|ΔH(q, Pp)|]", "l3": "E[|Δl₃|]", "x": "E[|Δx|]", "z": "E[|Δz|]",
    "g": "E[|g(q)|]", "qp": "E[|qᵀp|]",
}

#: Rule → how the paper writes it.
PARAMETERS = {"m": "γ_m", "h": "γ_h", "ht": "γ̃_h", "mt": "γ̃_m",
              "100m": "100γ_m", "0.01m": "0.01γ_m"}


def letter(rep: str) -> str:
    """Return γ or α."""
    return "γ" if rep == "gamma" else "α"


def row_name(quantity: Quantity, rep: str, parameter: str) -> str:
    """Return e.g. "E[|ΔH|], γ = γ_m"."""
    return f"{NORMS[quantity]}, {letter(rep)} = {PARAMETERS[parameter]}"
