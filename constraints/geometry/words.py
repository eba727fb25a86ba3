"""Words for lengths in reasons and messages."""

from __future__ import annotations


def millimetres(x: float) -> str:
    """A length (m) as text with its unit; lengths below a picometre are "0 mm"."""
    if abs(x) < 1e-12:
        return "0 mm"
    return f"{x * 1e3:.4g} mm" if abs(x) >= 1e-4 else f"{x * 1e6:.3g} µm"
