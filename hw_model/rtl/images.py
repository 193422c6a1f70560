"""A program as one core holds it: the words of every memory, and which layouts they have.

All cores of a program become one. What sends spikes has one number: channels of the recording, then what phases read
from the buffer, then compartments as :mod:`.numbering` has them; a word that is not valid fills a gap.
"""

from collections.abc import Iterable
from dataclasses import asdict, replace
from functools import partial

import numpy as np

from hw_model.arithmetic import loihi
from hw_model.description.open_core import MemoryWords
from hw_model.description.open_core import Sizes as Sizes
from hw_model.program.chip_program import ChipProgram
from hw_model.rtl.lists import BANKS, Table, packed_lists
from hw_model.rtl.memory_words import BitArray, Layout
from hw_model.rtl.numbering import numbered, of_compartments
from hw_model.rtl.phases import core_phases
from hw_model.rtl.refused import refuse_unless, refuse_unplayable
from hw_model.values import IntArray

STEP_BITS = 24
"""Of a setting, and of a field of a phase, such as its steps: ``settings`` and ``phase_fields`` of locsnn_core.sv."""
VISIT_BITS = 16
"""Of the step of a visit: ``STEP`` of transpose.sv."""
LOAD_BITS = 128
"""Of the data of a word on the load port: ``load_data`` of locsnn_core.sv."""
LENGTH_BITS = 9
"""Of the length of a list, in words, where targets are told as steps; ``LENGTH`` of delivery.sv."""
MEMORIES = ("settings", "axons", "synapses", "leaks", "fires", "visits", "weights", "phases")
"""By the number that the load port knows them by."""
READOUT_BITS = 32
"""Of a weight of the readout, beside its sign: ``weight`` of readout.sv has one more."""
PLACE = Layout.of(address=24, memory=8)
"""What follows the data of a word on the load port."""


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
    """Return the words of every memory, bit 0 first, in the order of loading; modules take them apart likewise."""
    words = (
        sizes.synapses,
        sizes.slots,
        sizes.entries,
        sizes.axons,
        held(sizes),
        sizes.sums or held(sizes),
    )
    synapse, slot, entry, source, place, parent = ((size - 1).bit_length() for size in words)
    family = {"child": 1, "first": 1, "parent": parent} if sizes.join else {}
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


def held(sizes: Sizes) -> int:
    """Return how many compartments have a state and charges at a time."""
    return sizes.places or sizes.compartments


class CoreProgram:
    """A program in the numbers of the core, for recordings of ``rows`` rows; ``steps`` of phases of no fixed length.

    ``phases``: in order, the first while the recording arrives. ``numbers[phase]`` (columns,): compartments by column;
    ``ends`` (phases,): the first number after each phase. ``starts``, ``lengths`` (sources,): words of the list of each
    source. ``heard``: rows of a recording that the core takes; ``kept``: those that the buffer does. ``scale``: what
    scores are multiplied by. ``sizes``: of the core whose words these are, that of the program's chip unless given.
    ``needs``: the least sizes. ``swept``: cycles between phases in which charges are cleaned. What the core cannot run
    is a ``TargetError``.
    """

    def __init__(
        self, program: ChipProgram, rows: int, steps: int | None = None, sizes: Sizes | None = None
    ) -> None:
        self.program, self.rows = program, rows
        self.sizes = sizes or program.chip.open_core or SIMULATED
        self.word = self.sizes.word
        refuse_unplayable(program)
        self.phases, self.first_source = core_phases(program, rows, steps, self.sizes.groups)
        longest = max((phase.steps for phase in self.phases[1:]), default=0)
        largest_field = (1 << VISIT_BITS) - 1
        refuse_unless(
            longest <= largest_field,
            program,
            f"phase of more than {largest_field} steps after the first",
            longest,
        )
        self.kept = max(phase.kept for phase in self.phases)
        self.heard = max(self.kept, self.phases[0].steps)
        self.row_words = -(-self.kept // self.word)
        self.channels = sum(program.streams.values())
        self.numbering = numbered(program, [phase.name for phase in self.phases], self.sizes)
        self.numbers = self.numbering.of_phase
        self.ends = self.numbering.ends
        synapses = self._synapses()
        places = self.numbering.places(synapses["target"])
        self.later = self._hears_later(_power(int(synapses["delay"].max(initial=0)) + 2))
        if self.later:
            places %= self.sizes.compartments >> self.sizes.later
        placed = {**synapses, "target": places}
        lists = packed_lists(placed, self.first_source + self.ends[-1], self.sizes.step)
        self.starts = lists.starts
        self.lengths = lists.lengths
        largest_field = (1 << LENGTH_BITS) - 1
        longest = int(self.lengths.max(initial=0))
        fits = not self.sizes.step or longest <= largest_field
        refuse_unless(
            fits,
            program,
            f"list of more than {largest_field} words where targets are told as steps",
            longest,
        )
        ratios = (
            [weight.as_integer_ratio() for weight in program.readout.weights]
            if program.readout
            else []
        )
        self.scale = max((below for _, below in ratios), default=1)
        weights = [above * (self.scale // below) for above, below in ratios]
        heaviest = max(map(abs, weights), default=0)
        what = f"weight of a readout of more than {READOUT_BITS} bits"
        refuse_unless(heaviest < 1 << READOUT_BITS, program, f"{what} as a whole number", heaviest)
        visits = np.hstack([phase.visits for phase in self.phases])
        visits = visits[:, np.argsort(visits[1])] if self.later else visits
        self.tables = {
            "axons": {
                "start": np.where(self.lengths > 0, self.starts, 0),
                "length": self.lengths,
                **lists.heads,
            },
            "synapses": lists.words,
            "compartments": self._compartments(),
            "visits": {"step": visits[0], "channel": visits[1], "source": visits[2]},
            "weights": {
                "magnitude": _array(map(abs, weights)),
                "negative": _array(weight < 0 for weight in weights),
            },
            "phases": {"value": self._phase_fields()},
        }
        self.needs = self._needs(synapses)
        self.swept = (
            self._swept(max(self.sizes.places, _power(self.needs.places)))
            if self.sizes.places
            else 0
        )

    def load_words(self, sizes: Sizes) -> BitArray:
        """Return what goes through the load port, a row a word: data, address, memory; the settings come last."""
        rows = []
        for name, (layout, columns) in self._words(sizes).items():
            data = layout.pack(columns)
            place = {
                "address": np.arange(len(data)),
                "memory": np.full(len(data), MEMORIES.index(name)),
            }
            rows.append(
                np.hstack(
                    (np.pad(data, ((0, 0), (0, LOAD_BITS - layout.width))), PLACE.pack(place))
                )
            )
        return np.concatenate(rows)

    def check_fields(self, sizes: Sizes) -> None:
        """Refuse what no field of a core of these sizes can hold, as a ``TargetError``."""
        self._words(sizes)

    def _words(self, sizes: Sizes) -> dict[str, tuple[Layout, Table]]:
        """Return what every memory holds, in the fields of its words."""
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
        """Return sizes of a simulated core that holds it: those of ``least``, or more.

        Where events are heard on arrival, charges lie as the device has room for them. Where compartments share
        places, or parents sums, there are as many as the device has.
        """
        of_device_exactly = ("compartments", "slots") if self.later else ()
        exact = {name: getattr(self.sizes, name) for name in (*of_device_exactly, "later")}
        for name in ("places", "sums"):
            if of_device := getattr(self.sizes, name):
                exact[name] = max(of_device, _power(getattr(self.needs, name)))
        return replace(sizes_for(self.needs, least), **exact)

    @property
    def words(self) -> MemoryWords:
        """Words of memories that a chip may have fewer of than its sizes say."""
        weights = max(1, len(self.tables["weights"]["magnitude"]))
        states = int(np.diff(self.ends, prepend=0).max()) if self.sizes.places else self.ends[-1]
        return MemoryWords(
            weights, len(self.tables["phases"]["value"]), states, self.numbering.sums()
        )

    def _hears_later(self, slots: int) -> bool:
        """Tell whether the second phase hears its events when they arrive; charges take ``slots`` otherwise."""
        sizes = self.sizes
        first, *others = self.phases
        # Shared places are swept before the second phase, and with them what it heard.
        if not sizes.later or sizes.places or len(others) != 1:
            return False
        (second,) = others
        # Each bit of `later` halves the compartments and doubles the slots of a memory of charges.
        places = sizes.compartments >> sizes.later
        all_slots = sizes.slots << sizes.later
        compartments_fit = (
            self.ends[-1] <= sizes.compartments
            and max(2, self.ends[0], self.ends[1] - self.ends[0]) <= places
        )
        # Each step of the second phase has a slot of its own, then come its delays and the slots of the first phase.
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
        return bool(
            compartments_fit
            and slots_fit
            and plays_all_at_visits
            and max(second.visits[0]) < second.steps
            and self.kept <= first.steps
        )

    def _settings(self, sizes: Sizes) -> dict[str, int]:
        """Return memory 0, a setting an address; writing the last one starts the core."""
        readout = self.program.readout
        slots = _power(self.needs.slots)
        return {
            "heard": self.heard,
            "kept": self.kept,
            "channels": self.channels,
            "words": self.needs.bitmap,
            # More than there are channels are never on, however many more.
            "align_events": min(
                max(phase.align_events or 0 for phase in self.phases), self.channels + 1
            ),
            "phases": len(self.phases),
            "slot_mask": slots - 1 + (self.later << STEP_BITS - 1),
            "sweep": self._swept(held(sizes)),
            "classes": self.program.populations[readout.populations[0]] if readout else 0,
            "populations": len(readout.populations) if readout else 0,
            "first_source": self.first_source,
            "run": 1,
        }

    def _swept(self, places: int) -> int:
        """Return the cycles in which memories are cleaned that hold the charges of ``places`` compartments."""
        slots = self.sizes.slots if self.later else _power(self.needs.slots)
        return max(slots * places // 2, self.needs.bitmap, self.needs.entries)

    def _phase_fields(self) -> IntArray:
        """Return eight words for each phase; :class:`hw_model.rtl.phases.CorePhase` says what they are."""
        visits = np.cumsum(
            [phase.visits.shape[1] * (not self.later) for phase in self.phases]
        ).tolist()
        fields: list[int] = []
        for phase, number_end, visits_end in zip(self.phases, self.ends, visits, strict=True):
            rows_shared = phase.by_rows + 2 * phase.shared
            is_aligned = bool(phase.align_events)
            fields += [phase.steps, number_end, visits_end, phase.rows]
            fields += [phase.row_source, phase.potentials_from, rows_shared, is_aligned]
        return _array(fields)

    def _needs(self, synapses: Table) -> Sizes:
        compartments = self.tables["compartments"]
        charges = np.abs(synapses["mantissa"]) << synapses["exponent"]
        charge = np.bincount(synapses["target"], weights=charges, minlength=1).max()
        parent = self.numbering.parent
        children = int(np.bincount(parent[parent >= 0], minlength=1).max())
        return Sizes(
            axons=len(self.starts),
            synapses=2 * int(self.lengths.sum() + 1),
            compartments=self.ends[-1],
            # A spike of step t with delay d acts at t + 1 + d, while the charges of step t are still being taken.
            slots=int(synapses["delay"].max(initial=0)) + 2,
            charge=int(charge).bit_length() + 1,  # the most that can meet in a step, and a sign
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
        """Return the synapses of all cores, in any order, with their sources."""
        parts = []
        for core in self.program.cores:
            axons = core.axons
            heard = next(phase.sources for phase in self.phases if phase.name == core.phase)
            numbers = self.numbers[core.phase]
            source = np.concatenate((heard, self.first_source + numbers))
            exponent = _array(form.exponent for form in axons.formats)[axons.format_index]
            # A negative exponent loses low bits of the mantissa, weight by weight.
            mantissa = axons.mantissa.astype(np.int64) >> np.maximum(-exponent, 0)
            parts.append({
                "source": source[self.program.senders[core.number][axons.axon_of_synapse]],
                "target": numbers[self.program.columns_of_core(core)[axons.target]],
                "delay": axons.delay,
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
        """Return the constants of every compartment; gaps have none.

        Decays are stored as what they keep, thresholds in units of 64, vmin and vmax as binary logarithms of 1 - vmin
        and vmax + 1.
        """
        numbering = self.numbering
        constant = partial(of_compartments, self.program)
        number = numbering.number
        child = numbering.parent >= 0
        parent = np.where(child, number[numbering.parent], -1)
        place_of_parent = numbering.places(np.maximum(parent, 0)) * child
        if self.sizes.sums:
            place_of_parent %= max(self.sizes.sums, numbering.sums())
        # Siblings follow each other, gaps left out.
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
        readout = self.program.readout
        for index, name in enumerate(readout.populations if readout else ()):
            phase = next(
                p.name for p in self.program.phases if name in self.program.columns_of(p.name)
            )
            members = self.numbers[phase][self.program.columns_of(phase)[name]]
            table["read_out"][members] = 1
            table["by_potential"][members] = readout is not None and name in readout.from_step
            table["entry"][members] = index * len(members) + np.arange(len(members))
        return table


def parameters(sizes: Sizes) -> dict[str, int]:
    """Return the parameters of the SystemVerilog by name; those that are 0 unless named are left out."""
    return {name.upper(): value for name, value in asdict(sizes).items() if value or name == "join"}


def sizes_for(needs: Sizes, least: Sizes) -> Sizes:
    """Return sizes that hold what is needed: those of ``least``, or twice as many words, or just enough bits."""
    exact = ("charge", "join", "one_port", "later", "groups")
    grown = {name: need if name in exact else _power(need) for name, need in asdict(needs).items()}
    grown = {name: max(value, grown[name]) for name, value in asdict(least).items()}
    shared = {name: grown[name] * (getattr(needs, name) > 0) for name in ("places", "sums")}
    return Sizes(**grown | shared | {"word": needs.word, "step": needs.step})


def _power(words: int) -> int:
    return 1 << max(words - 1, 1).bit_length()


def _array(values: Iterable[int]) -> IntArray:
    return np.array(list(values), dtype=np.int64)
