"""List all synapses of a phase of a program in one table, whatever cores and formats they lie in."""

import numpy as np

from hw_model.arithmetic.fixed_point import SIGN_MODES
from hw_model.program.chip_program import ChipProgram, Core
from hw_model.values import Frozen, IntArray


class SynapseTable(Frozen, eq=False):
    """A table of synapses; each array is (synapses,).

    - ``sender``, ``target``: numbered as in :attr:`~hw_model.program.chip_program.ChipProgram.senders`: input
      lines first, then compartments
    - ``mantissa``, ``exponent``: the weight is mantissa times 2^exponent
    - ``delay``: in steps
    - ``weight_bits``, ``sign``: of the format; ``sign`` is an index of
      :data:`~hw_model.arithmetic.fixed_point.SIGN_MODES`
    """

    sender: IntArray
    target: IntArray
    mantissa: IntArray
    delay: IntArray
    exponent: IntArray
    weight_bits: IntArray
    sign: IntArray


def synapses_of_phase(program: ChipProgram, phase: str) -> SynapseTable:
    """Return the synapses of all cores of a phase, core by core."""
    lines = program.lines_of(phase)
    line_count = max((columns.stop for columns in lines.values()), default=0)
    tables = [_synapses_of_core(program, core, line_count) for core in program.cores_of(phase)]
    return SynapseTable(
        sender=np.concatenate([table.sender for table in tables]),
        target=np.concatenate([table.target for table in tables]),
        mantissa=np.concatenate([table.mantissa for table in tables]),
        delay=np.concatenate([table.delay for table in tables]),
        exponent=np.concatenate([table.exponent for table in tables]),
        weight_bits=np.concatenate([table.weight_bits for table in tables]),
        sign=np.concatenate([table.sign for table in tables]),
    )


def _synapses_of_core(program: ChipProgram, core: Core, line_count: int) -> SynapseTable:
    """Return the synapses of a core; its phase has ``line_count`` input lines."""
    axons = core.axons
    exponents = [form.exponent for form in axons.formats]
    weight_bits = [form.weight_bits for form in axons.formats]
    signs = [SIGN_MODES.index(form.sign_mode) for form in axons.formats]
    return SynapseTable(
        sender=program.senders[core.number][axons.axon_of_synapse].astype(np.int64),
        target=line_count + program.columns_of_core(core)[axons.target].astype(np.int64),
        mantissa=np.asarray(axons.mantissa, dtype=np.int64),
        delay=np.asarray(axons.delay, dtype=np.int64),
        exponent=np.array(exponents, dtype=np.int64)[axons.format_index],
        weight_bits=np.array(weight_bits, dtype=np.int64)[axons.format_index],
        sign=np.array(signs, dtype=np.int64)[axons.format_index],
    )


def earlier_twins(table: SynapseTable) -> IntArray:
    """Return for each synapse how many before it have the same sender, target and format, (synapses,)."""
    ends_and_format = np.stack(
        (table.sender, table.target, table.exponent, table.weight_bits, table.sign), axis=1
    )
    _, group, sizes = np.unique(ends_and_format, axis=0, return_inverse=True, return_counts=True)
    # Sort by group, which keeps the order within a group. The place of a synapse in its group is the number of those
    # before it.
    order = np.argsort(group.ravel(), kind="stable")
    group_start = np.repeat(np.cumsum(sizes) - sizes, sizes)
    twins = np.empty(len(order), dtype=np.int64)
    twins[order] = np.arange(len(order)) - group_start
    return twins
