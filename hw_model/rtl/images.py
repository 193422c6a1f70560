"""A program as the open core holds it: the words of every memory, and their layouts.

The open core is a single core, so all cores of a program become one. Whatever sends spikes is a
source with a number, and has a list of synapses: first the channels of the recording, then the
sources that phases read from the buffer of events (:mod:`.phases`), then the compartments in the
order of :mod:`.numbering`. Numbers of compartments may have gaps; the words of constants of a gap
are marked as not valid.

docs/reference/hardware/stream-and-memory-map.md describes all words.
"""

from collections.abc import Iterable
from dataclasses import asdict, replace
from functools import partial

import numpy as np

from hw_model.arithmetic import loihi
from hw_model.description.open_core import MemoryWords
from hw_model.description.open_core import Sizes as Sizes
from hw_model.program.chip_program import ChipProgram
from hw_model.rtl.lists import BANKS, Lists, Table, packed_lists
from hw_model.rtl.memory_words import BitArray, Layout
from hw_model.rtl.numbering import numbered, of_compartments
from hw_model.rtl.phases import core_phases
from hw_model.rtl.refused import refuse_unless, refuse_unplayable
from hw_model.values import IntArray

STEP_BITS = 24
"""Bits of a setting, and of a field of a phase: ``settings`` and ``phase_fields`` of
locsnn_core.sv."""
VISIT_BITS = 16
"""Bits of the step of a visit: ``STEP`` of transpose.sv."""
LOAD_BITS = 128
"""Bits of the data of a word on the load port: ``load_data`` of locsnn_core.sv."""
LENGTH_BITS = 9
"""Bits of the length of a list where targets are stored as steps: ``LENGTH`` of delivery.sv."""
MEMORIES = ("settings", "axons", "synapses", "leaks", "fires", "visits", "weights", "phases")
"""The memories; the index is the number of a memory on the load port."""
READOUT_BITS = 32
"""Bits of a weight of the readout, next to its sign: ``weight`` of readout.sv has one bit more."""
PLACE = Layout.of(address=24, memory=8)
"""The fields that follow the data of a word on the load port."""


SIMULATED = Sizes(
    axons=8192,
    synapses=131072,
    compartments=1024,
    slots=64,
    charge=26,
    join=36,
    bitmap=8192,
    visits=1024,
    entries=1024,
)
"""Sizes that hold most programs, so that one built simulator plays them."""


def layouts(sizes: Sizes) -> dict[str, Layout]:
    """Return the layout of every memory's words, bit 0 first, in the order of loading.

    The modules of the core take words apart in the same order. Settings come last, as the last of
    them starts the core.
    """
    words = (
        sizes.synapses,
        sizes.slots,
        sizes.entries,
        sizes.axons,
        resident_compartments(sizes),
        sizes.sums or resident_compartments(sizes),
    )
    # Bits of the number of a synapse, a slot, ...: as many as the largest number, size - 1, needs.
    synapse, slot, entry, source, place, parent = ((size - 1).bit_length() for size in words)
    family = {"child": 1, "first": 1, "parent": parent} if sizes.join else {}
    # A word has two synapses, so an address has a bit less than the number of a synapse. The bank
    # of a synapse gives the lowest bit of its target.
    half = {"target": place - 1, "delay": slot, "exponent": 3, "mantissa": 9}
    lists = {"start": synapse - 1, "length": synapse - 1}
    if sizes.step:
        half = {"step": sizes.step, "delay": slot, "mantissa": 9}
        lists = {
            "start": synapse - 1,
            "length": min(synapse - 1, LENGTH_BITS),
            "place": place - 1,
            "exponent": 3,
        }
    return {
        "axons": Layout.of(**lists),
        "synapses": Layout.of("mantissa0", "mantissa1", **{f"{name}{i}": half[name] for i in BANKS for name in half}),
        "leaks": Layout.of("bias", valid=1, keep_u=13, keep_v=13, bias=20, has_children=1),
        "fires": Layout.of(
            threshold=17, blocks=6, spiking=1, vmin_log=5, vmax_log=5, **family, read_out=1, by_potential=1, entry=entry
        ),
        "visits": Layout.of(step=VISIT_BITS, channel=source, source=source),
        "weights": Layout.of(magnitude=READOUT_BITS, negative=1),
        "phases": Layout.of(value=STEP_BITS),
        "settings": Layout.of(value=STEP_BITS),
    }  # fmt: skip


def resident_compartments(sizes: Sizes) -> int:
    """Return how many compartments have states and charges at a time: of a phase, or all."""
    return sizes.places or sizes.compartments


class CoreProgram:
    """A program in the words and numbers of the core, for recordings of ``rows`` rows.

    Raise a ``TargetError`` if the core cannot run the program. ``steps`` is the length of phases of
    no fixed length.

    - ``sizes``: the sizes of the core, those of the program's chip unless given
    - ``phases``: in the order in which they run; the first runs while the recording arrives
    - ``numbers[phase]`` (columns,): the numbers of a phase's compartments, by column of the program
    - ``ends`` (phases,): the first number after each phase
    - ``starts``, ``lengths`` (sources,): first word and words of the list of each source
    - ``heard``: rows of a recording that the core takes; ``kept``: rows that its buffer keeps
    - ``row_words``: words of the buffer that hold the kept rows of a channel
    - ``later``: whether the second phase hears its events when they arrive, not later from the
      buffer
    - ``scale``: the scores of the core are this many times those of the program
    - ``tables``: the fields of every memory's words, by memory and field
    - ``needs``: the smallest sizes of a core that holds the program
    - ``swept``: cycles between phases in which charges are cleaned, 0 unless phases share places
    """

    def __init__(
        self, program: ChipProgram, rows: int, steps: int | None = None, sizes: Sizes | None = None
    ) -> None:
        self.program = program
        self.rows = rows
        self.sizes = sizes or program.chip.open_core or SIMULATED
        self.word = self.sizes.word
        refuse_unplayable(program)
        self.phases, self.first_source = core_phases(program, rows, steps, self.sizes.groups)
        self._refuse_long_phases()
        self.kept = max(phase.kept for phase in self.phases)
        self.heard = max(self.kept, self.phases[0].steps)
        self.row_words = -(-self.kept // self.word)
        self.channels = sum(program.streams.values())
        self.numbering = numbered(program, [phase.name for phase in self.phases], self.sizes)
        self.numbers = self.numbering.of_phase
        self.ends = self.numbering.ends
        synapses = self._synapses()
        self.later = self._hears_later(_power(_slots_needed(synapses["delay"])))
        lists = self._packed_lists(synapses)
        self.starts = lists.starts
        self.lengths = lists.lengths
        self._refuse_long_lists()
        weights, self.scale = _whole_weights(program)
        self.tables = self._tables(lists, weights)
        self.needs = self._needs(synapses)
        self.swept = 0
        if self.sizes.places:
            self.swept = self._sweep_cycles(max(self.sizes.places, _power(self.needs.places)))

    def _refuse_long_phases(self) -> None:
        """Refuse later phases of more steps than the field of a visit can hold."""
        longest = max((phase.steps for phase in self.phases[1:]), default=0)
        most_steps = (1 << VISIT_BITS) - 1
        refuse_unless(
            longest <= most_steps,
            self.program,
            f"phase of more than {most_steps} steps after the first",
            longest,
        )

    def _packed_lists(self, synapses: Table) -> Lists:
        """Return the lists of all sources; their targets are places of the memory of charges."""
        places = self.numbering.places(synapses["target"])
        if self.later:
            # The memory of charges then has more slots for fewer compartments. Both phases lie in
            # the same places, as their charges are in different slots.
            places %= self.sizes.compartments >> self.sizes.later
        sources = self.first_source + self.ends[-1]
        return packed_lists({**synapses, "target": places}, sources, self.sizes.step)

    def _refuse_long_lists(self) -> None:
        """Refuse lists that are too long for their field, which is short if targets are steps."""
        most_words = (1 << LENGTH_BITS) - 1
        longest = int(self.lengths.max(initial=0))
        fits = not self.sizes.step or longest <= most_words
        refuse_unless(
            fits,
            self.program,
            f"list of more than {most_words} words where targets are told as steps",
            longest,
        )

    def _tables(self, lists: Lists, weights: list[int]) -> dict[str, Table]:
        """Return the fields of every memory, without settings, which depend on the core's sizes."""
        visits = np.hstack([phase.visits for phase in self.phases])
        if self.later:
            visits = visits[:, np.argsort(visits[1])]  # arrivals.sv looks a visit up by its channel
        step, channel, source = visits
        return {
            "axons": {
                "start": np.where(self.lengths > 0, self.starts, 0),
                "length": self.lengths,
                **lists.heads,
            },
            "synapses": lists.words,
            "compartments": self._compartments(),
            "visits": {"step": step, "channel": channel, "source": source},
            "weights": {
                "magnitude": _array(map(abs, weights)),
                "negative": _array(weight < 0 for weight in weights),
            },
            "phases": {"value": self._phase_fields()},
        }

    def load_words(self, sizes: Sizes) -> BitArray:
        """Return the words for the load port of a core of these sizes, a row per word, as bits.

        A row holds data, address and memory, bit 0 first. The settings come last.
        """
        rows = []
        for name, (layout, columns) in self._words(sizes).items():
            data = layout.pack(columns)
            padded = np.pad(data, ((0, 0), (0, LOAD_BITS - layout.width)))
            place = PLACE.pack({
                "address": np.arange(len(data)),
                "memory": np.full(len(data), MEMORIES.index(name)),
            })  # fmt: skip
            rows.append(np.hstack((padded, place)))
        return np.concatenate(rows)

    def check_fields(self, sizes: Sizes) -> None:
        """Raise a ``TargetError`` if a value is too large for its field in a core of these sizes."""
        self._words(sizes)

    def _words(self, sizes: Sizes) -> dict[str, tuple[Layout, Table]]:
        """Return the layout of each memory's words, and the values of their fields."""
        settings = {"settings": {"value": _array(self._settings(sizes).values())}}
        compartments = self.tables["compartments"]
        tables = self.tables | settings | {"leaks": compartments, "fires": compartments}
        words = {}
        for name, layout in layouts(sizes).items():
            columns = {field.name: tables[name][field.name] for field in layout.fields}
            for field in layout.fields:
                what = f"{field.name} of more than {field.width} bits"
                refuse_unless(
                    field.holds(columns[field.name]),
                    self.program,
                    what,
                    columns[field.name].max(initial=0),
                )
            words[name] = layout, columns
        return words

    def simulated(self, least: Sizes) -> Sizes:
        """Return the sizes of a simulated core that holds the program, at least ``least``.

        Some sizes are exactly those of the device, as cycles or numbers depend on them: where the
        second phase hears events when they arrive, those of the memory of charges; where phases
        share places, or parents share words of sums, how many there are.
        """
        exact = {"later": self.sizes.later}
        if self.later:
            exact |= {"compartments": self.sizes.compartments, "slots": self.sizes.slots}
        for name in ("places", "sums"):
            of_device = getattr(self.sizes, name)
            if of_device:
                exact[name] = max(of_device, _power(getattr(self.needs, name)))
        return replace(sizes_for(self.needs, least), **exact)

    @property
    def words(self) -> MemoryWords:
        """The words that the program fills of memories that may be smaller on a chip."""
        states = self.ends[-1]
        if self.sizes.places:
            states = int(np.diff(self.ends, prepend=0).max())  # of the largest phase
        return MemoryWords(
            weights=max(1, len(self.tables["weights"]["magnitude"])),
            phases=len(self.tables["phases"]["value"]),
            states=states,
            sums=self.numbering.sum_words(),
        )

    def _hears_later(self, slots: int) -> bool:
        """Return whether the second phase can hear its events when they arrive.

        The core must be built for it (``later``), and have room: each step of the second phase then
        has a slot of its own, so that an event is added at once to the step in which its channel is
        visited. ``slots`` are the slots that the program needs otherwise.
        """
        sizes = self.sizes
        first, *others = self.phases
        # Where phases share places, charges are swept before the second phase, and would be lost.
        if not sizes.later or sizes.places or len(others) != 1:
            return False
        (second,) = others
        # Each bit of `later` halves the compartments and doubles the slots of a memory of charges.
        places = sizes.compartments >> sizes.later
        all_slots = sizes.slots << sizes.later
        # A phase needs at least two places, as the lowest bit of a place chooses the bank.
        largest_phase = max(2, self.ends[0], self.ends[1] - self.ends[0])
        compartments_fit = self.ends[-1] <= sizes.compartments and largest_phase <= places
        # The slots are those of all steps of the second phase, of its delays, and of the first
        # phase.
        slots_fit = slots <= sizes.slots and second.steps + 2 * slots <= all_slots
        visits_each_channel_once = np.array_equal(
            np.sort(second.visits[1]), np.arange(self.channels)
        )
        plays_all_at_visits = (
            visits_each_channel_once
            and not second.by_rows
            and not second.shared
            and second.align_events is None
        )
        # No event may be for a step that the phase does not have, or come in a row that the first
        # phase does not take.
        visits_within_steps = second.visits[0].max(initial=-1) < second.steps
        rows_are_heard = self.kept <= first.steps
        return bool(
            compartments_fit
            and slots_fit
            and plays_all_at_visits
            and visits_within_steps
            and rows_are_heard
        )

    def _settings(self, sizes: Sizes) -> dict[str, int]:
        """Return the settings, memory 0, one per address; writing the last one starts the core.

        The head of locsnn_core.sv says what each of them is.
        """
        readout = self.program.readout
        slots = _power(self.needs.slots)
        align_events = max(phase.align_events or 0 for phase in self.phases)
        return {
            "heard": self.heard,
            "kept": self.kept,
            "channels": self.channels,
            "words": self.needs.bitmap,
            # A row never has more events than channels: a larger number is cut to one that fits its
            # field.
            "align_events": min(align_events, self.channels + 1),
            "phases": len(self.phases),
            "slot_mask": slots - 1 + (self.later << STEP_BITS - 1),  # the highest bit: `later`
            "sweep": self._sweep_cycles(resident_compartments(sizes)),
            "classes": self.program.populations[readout.populations[0]] if readout else 0,
            "populations": len(readout.populations) if readout else 0,
            "first_source": self.first_source,
            "run": 1,
        }

    def _sweep_cycles(self, places: int) -> int:
        """Return the cycles in which all memories with state are cleaned, a word of each per cycle.

        They hold the charges of ``places`` compartments, in two banks. The largest memory decides.
        """
        slots = self.sizes.slots if self.later else _power(self.needs.slots)
        return max(slots * places // 2, self.needs.bitmap, self.needs.entries)

    def _phase_fields(self) -> IntArray:
        """Return eight words for each phase; :class:`hw_model.rtl.phases.CorePhase` says what they are."""
        # With `later`, the phase has heard its events, and reads none of its visits from the
        # buffer.
        visits = [0 if self.later else phase.visits.shape[1] for phase in self.phases]
        ends_of_visits = np.cumsum(visits).tolist()
        fields: list[int] = []
        for phase, number_end, visits_end in zip(
            self.phases, self.ends, ends_of_visits, strict=True
        ):
            rows_shared = phase.by_rows + 2 * phase.shared  # bit 0, and bits 1 to 3
            is_aligned = bool(phase.align_events)
            fields += [phase.steps, number_end, visits_end, phase.rows]
            fields += [phase.row_source, phase.potentials_from, rows_shared, is_aligned]
        return _array(fields)

    def _needs(self, synapses: Table) -> Sizes:
        """Return the smallest sizes of a core that holds the program."""
        compartments = self.tables["compartments"]
        # The most charge that can reach a compartment in a step: from all of its synapses.
        charges = np.abs(synapses["mantissa"]) << synapses["exponent"]
        charge = np.bincount(synapses["target"], weights=charges, minlength=1).max()
        parent = self.numbering.parent
        children = int(np.bincount(parent[parent >= 0], minlength=1).max())
        return Sizes(
            axons=len(self.starts),
            # Two per word; and a word more, as the core reads one behind the end of a list.
            synapses=2 * int(self.lengths.sum() + 1),
            compartments=self.ends[-1],
            slots=_slots_needed(synapses["delay"]),
            charge=int(charge).bit_length() + 1,  # and a sign
            # A voltage has 24 bits with its sign, and children add up.
            join=24 + children.bit_length() if children else 0,
            bitmap=self.channels * self.row_words,
            visits=len(self.tables["visits"]["step"]),
            entries=int(compartments["entry"].max()) + 1,
            word=self.word,
            phase_words=len(self.tables["phases"]["value"]),
            groups=int(any(phase.shared for phase in self.phases)),
            step=self.sizes.step,
            places=self.words.states if self.sizes.places else 0,
            sums=self.words.sums if self.sizes.sums else 0,
        )

    def _synapses(self) -> Table:
        """Return the synapses of all cores, by the numbers of their sources and targets."""
        parts = []
        for core in self.program.cores:
            axons = core.axons
            sources_of_lines = next(
                phase.sources for phase in self.phases if phase.name == core.phase
            )
            numbers = self.numbers[core.phase]
            # By the sender of an axon: the input lines of the phase, then its compartments.
            source = np.concatenate((sources_of_lines, self.first_source + numbers))
            exponent = _array(form.exponent for form in axons.formats)[axons.format_index]
            # A negative exponent loses low bits of the mantissa, weight by weight.
            mantissa = axons.mantissa.astype(np.int64) >> np.maximum(-exponent, 0)
            parts.append({
                "source": source[self.program.senders[core.number][axons.axon_of_synapse]],
                "target": numbers[self.program.columns_of_core(core)[axons.target]],
                "delay": axons.delay,
                # A weight of 0 has exponent 0: with exponent 7 it would mean that there is no
                # synapse.
                "exponent": np.maximum(exponent, 0) * (mantissa != 0),
                "mantissa": mantissa,
            })  # fmt: skip
        columns = {
            name: np.concatenate([part[name] for part in parts]).astype(np.int64)
            for name in parts[0]
        }
        has_source = columns["source"] >= 0  # a line that shares a source has none of its own
        return {name: column[has_source] for name, column in columns.items()}

    def _compartments(self) -> Table:
        """Return the constants of all compartments: fields of the memories ``leaks`` and ``fires``.

        Gaps in the numbers have zeros. Decays are stored as what they keep (4096 - decay),
        thresholds in units of 64, vmin and vmax as binary logarithms of 1 - vmin and vmax + 1.
        """
        numbering = self.numbering
        constant = partial(of_compartments, self.program)
        number = numbering.number
        child = numbering.parent >= 0
        parent = np.where(child, number[numbering.parent], -1)
        place_of_parent = numbering.places(np.maximum(parent, 0)) * child
        if self.sizes.sums:
            place_of_parent %= max(self.sizes.sums, numbering.sum_words())
        # Siblings follow each other in the order of numbers, so the first of them is where the
        # parent changes.
        in_order = np.argsort(number)
        first = np.empty_like(child)
        first[in_order] = np.diff(parent[in_order], prepend=-1) != 0
        columns = {
            "valid": constant(lambda core: 1),
            "keep_u": loihi.keep_of(constant(lambda core: core.setting("decay_u"))),
            "keep_v": loihi.keep_of(constant(lambda core: core.setting("decay_v"))),
            "bias": constant(lambda core: core.bias),
            "has_children": np.isin(number, parent),
            "threshold": constant(lambda core: loihi.whole_units(core.threshold_voltage)),
            "blocks": np.maximum(
                loihi.blocked_by_spike(constant(lambda core: core.setting("refractory"))), 0
            ),
            # A voltage that is clipped below the threshold never reaches it, and a joined
            # compartment does not spike.
            "spiking": constant(
                lambda core: (core.vmax > core.threshold_voltage) & (core.setting("joined") == 0)
            ),
            "vmin_log": constant(lambda core: (1 - core.vmin).bit_length() - 1),
            "vmax_log": constant(lambda core: core.vmax.bit_length()),
            "child": child,
            "first": first & child,
            "parent": place_of_parent,
        }
        names = (*columns, "read_out", "by_potential", "entry")
        table = {name: np.zeros(self.ends[-1], dtype=np.int64) for name in names}
        for name, column in columns.items():
            table[name][number] = column
        self._add_readout(table)
        return table

    def _add_readout(self, table: Table) -> None:
        """Write into the constants which compartments are read out, how, and into which tally.

        Tallies of a population follow each other, population by population.
        """
        readout = self.program.readout
        if readout is None:
            return
        for index, name in enumerate(readout.populations):
            phase = next(
                phase.name
                for phase in self.program.phases
                if name in self.program.columns_of(phase.name)
            )
            members = self.numbers[phase][self.program.columns_of(phase)[name]]
            table["read_out"][members] = 1
            table["by_potential"][members] = name in readout.from_step
            table["entry"][members] = index * len(members) + np.arange(len(members))


def parameters(sizes: Sizes) -> dict[str, int]:
    """Return the parameters of the SystemVerilog by name.

    Parameters of value 0 are left out, as 0 is their default there, except ``JOIN``, whose default
    is another.
    """
    return {name.upper(): value for name, value in asdict(sizes).items() if value or name == "join"}


def sizes_for(needs: Sizes, least: Sizes) -> Sizes:
    """Return sizes of a simulated core that hold the needs, none smaller than in ``least``.

    Words of memories are rounded up to a power of two, so that few different cores are built. Bits
    are just enough.
    """
    not_words = ("charge", "join", "one_port", "later", "groups")
    grown = {}
    for name, need in asdict(needs).items():
        rounded = need if name in not_words else _power(need)
        grown[name] = max(rounded, getattr(least, name))
    for name in ("places", "sums"):
        # Nothing is shared where the program's core shares nothing, though `least` may.
        if not getattr(needs, name):
            grown[name] = 0
    # The layout of words depends on these two.
    return Sizes(**grown | {"word": needs.word, "step": needs.step})


def _whole_weights(program: ChipProgram) -> tuple[list[int], int]:
    """Return the weights of the readout as integers, and by how much they are scaled.

    They are binary fractions, and the core multiplies integers. All denominators are powers of two,
    so the largest is a multiple of the others.
    """
    readout_weights = program.readout.weights if program.readout else ()
    ratios = [weight.as_integer_ratio() for weight in readout_weights]
    scale = max((denominator for _, denominator in ratios), default=1)
    weights = [numerator * (scale // denominator) for numerator, denominator in ratios]
    heaviest = max(map(abs, weights), default=0)
    what = f"weight of a readout of more than {READOUT_BITS} bits"
    refuse_unless(heaviest < 1 << READOUT_BITS, program, f"{what} as a whole number", heaviest)
    return weights, scale


def _slots_needed(delays: IntArray) -> int:
    """Return the slots of charges that synapses with these delays need.

    A spike of step t with delay d acts at t + 1 + d, while the charges of step t are still being
    taken.
    """
    return int(delays.max(initial=0)) + 2


def _power(words: int) -> int:
    """Return the least power of two that is not below ``words``, and at least 2."""
    return 1 << max(words - 1, 1).bit_length()


def _array(values: Iterable[int]) -> IntArray:
    return np.array(list(values), dtype=np.int64)
