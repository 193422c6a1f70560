"""File formats out: a compiled model for other tools, one exporter a format."""

from locsnn_compile.errors import InputError
from locsnn_compile.network.quantized import QuantizedNetwork


def exchange_file(kind: str, quantized: QuantizedNetwork) -> bytes:
    """Return a model as a file of another tool: ``nir``, or ``net`` of lava-dl.

    Raises ``InputError`` for what the format cannot hold.
    """
    if any(view.align_events for view in quantized.network.views):
        raise InputError(f"--emit {kind}", "no such file holds a start at the first touch", fix="Emit without it.")
    if kind == "nir":
        from locsnn_compile.backends.exchange.nir_file import nir_bytes

        return nir_bytes(quantized)
    from locsnn_compile.backends.exchange.net_file import net_bytes

    return net_bytes(quantized)
