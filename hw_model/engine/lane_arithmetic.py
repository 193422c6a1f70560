"""The arithmetic of one compartment, compiled into each loop that uses it, in 32 or in 64 bits.

The same integers as :mod:`hw_model.arithmetic.fixed_point`. Every result has the type of what it was made of; who
chooses the type must know that no value outgrows it. ``keep`` is 4096 less an effective decay, 0..4096; ``half`` is
2^bits of a register of ``bits`` bits plus sign.
"""

from typing import Any

from numba.core import types
from numba.extending import intrinsic

from hw_model.engine.compiled import absorbed


@intrinsic  # type: ignore[untyped-decorator]
def fit(typing: Any, value: Any, like: Any) -> Any:
    """Return a number in the type of another, or of the elements of an array."""
    kind = like.dtype if isinstance(like, types.Array) else like

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return context.cast(builder, arguments[0], value, kind)

    return kind(value, like), generate


@absorbed
def rz(x, keep):  # type: ignore[no-untyped-def]
    """Return sign(x) * ((|x| * keep) >> 12): with |x| = 4096 a + b no product is wider than x, or than 24 bits."""
    magnitude = fit(-x if x < 0 else x, x)
    low = fit(fit(fit(magnitude & 4095, x) * keep, x) >> 12, x)
    left = fit(fit(fit(magnitude >> 12, x) * keep, x) + low, x)
    return fit(-left if x < 0 else left, x)


@absorbed
def wrap(x, half):  # type: ignore[no-untyped-def]
    """Return x in two's complement: its low bits, of which the highest, worth half, counts as negative."""
    return fit(((x & (2 * half - 1)) ^ half) - half, x)
