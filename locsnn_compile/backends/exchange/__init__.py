"""``--emit nir`` and ``--emit net``: write a compiled model in a format in which other tools exchange networks.

Each format has an exporter. What both formats cannot hold is refused here, and the rest in the exporter.
"""

from locsnn_compile.errors import InputError
from locsnn_compile.network.quantized import QuantizedNetwork


def exchange_file(kind: str, quantized: QuantizedNetwork) -> bytes:
    """Return a model as a file of the format ``kind``: ``nir``, or ``net`` of lava-dl.

    Raise InputError for a model that the format cannot hold.
    """
    network = quantized.network
    for population in network.populations:
        if population.neuron.has_floor:
            where = f"--emit {kind}, population {population.name!r}"
            what = "the format cannot hold a floor of the potential"
            raise InputError(where, what, fix="Emit another kind.")
    if network.members or any(view.align_events for view in network.views):
        what = "a committee" if network.members else "a start at the first touch"
        raise InputError(f"--emit {kind}", f"the format cannot hold {what}", fix="Emit without it.")
    if kind == "nir":
        from locsnn_compile.backends.exchange.nir_file import nir_bytes as written
    else:
        from locsnn_compile.backends.exchange.net_file import net_bytes as written
    from locsnn_compile.backends.exchange.floats import HELD

    # Before the checks below, because the exporter's errors say more about the reason.
    content = written(quantized)
    if set(network.readout.weights) != {1.0}:
        measured = ", ".join(f"{weight:g}" for weight in network.readout.weights)[:80]
        what = "the format cannot weigh what is read out"
        raise InputError(f"--emit {kind}, readout", what, measured=f"weights {measured}", fix=HELD)
    if network.readout.tie_class is not None:
        what = "the format cannot name a class for ties"
        measured = f"class {network.readout.tie_class}"
        raise InputError(f"--emit {kind}, readout", what, measured=measured, fix=HELD)
    return content
