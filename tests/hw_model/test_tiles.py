"""The shortcuts of the fast engine change no result: matrices, lists, skipped chunks, pairs, echoes, tiles, batches.

:mod:`hw_model.engine.layout` explains these words. Each of :data:`PROGRAMS` is a small program that takes one shortcut;
it is played sparsely over several tiles of 64 steps, and compared with the reference engine, which has no shortcuts.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy import sparse

import hw_model as hw
from hw_model.engine.delivery import LONG
from hw_model.engine.lay_out import fast_layout
from hw_model.engine.layout import WIDE_LIST
from hw_model.engine.links import packed_synapses
from hw_model.engine.state import MOST_LISTED, TILE
from hw_model.simulation import ENGINES
from tests.support.register_units import FORGETS_AT_ONCE, KEEPS_ALL, LARGEST_THRESHOLD

CHIP = hw.chip("loihi-sim")
FORGETS = {"decay_u": FORGETS_AT_ONCE, "decay_v": FORGETS_AT_ONCE}
STEPS = 200


def matrix() -> hw.ProgramBuilder:
    """Return a matrix whose rows are so long that eight are added at once, and one of short rows."""
    r = np.random.default_rng(1)
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", 20)
    wide = builder.add_compartments("wide", LONG + 20, threshold=300, **FORGETS)
    narrow = builder.add_compartments("narrow", 20, threshold=300, decay_u=3000, decay_v=3000)
    builder.connect(x, wide, 2 * r.integers(1, 120, (LONG + 20, 20)), delay=2)
    builder.connect(wide, narrow, 2 * r.integers(-20, 20, (20, LONG + 20)))
    return builder


def delays_of_a_matrix() -> hw.ProgramBuilder:
    """Return a link as dense as a matrix, but with different delays, which a matrix cannot have."""
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", 4)
    n = builder.add_compartments("n", 20, threshold=90, **FORGETS)
    builder.connect(x, n, np.full((20, 4), 100), delay=np.arange(80).reshape(20, 4) % 63)
    return builder


def weights_beyond_16_bits() -> hw.ProgramBuilder:
    """Return two synapses from each source, whose sum exceeds the 16 bits of an entry of a matrix."""
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", 4)
    n = builder.add_compartments("n", 20, threshold=LARGEST_THRESHOLD, **FORGETS)
    for _ in range(2):
        builder.connect(x, n, np.full((20, 4), 254), exponent=7)
    return builder


def late_lists() -> hw.ProgramBuilder:
    """Return one synapse per source with a long delay: charges due after a tile are moved to the next one."""
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", 40)
    n = builder.add_compartments("n", 40, threshold=90, **FORGETS)
    builder.connect(x, n, 100 * np.eye(40), delay=np.where(np.eye(40), 3 + np.arange(40), 0))
    return builder


def slow_decay() -> hw.ProgramBuilder:
    """Return compartments whose voltage decays over several tiles."""
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", 2)
    n = builder.add_compartments("n", 20, decay_u=FORGETS_AT_ONCE, decay_v=40, threshold=160)
    builder.connect(x, n, np.full((20, 2), 100))
    return builder


def recurrence_ahead_of_another() -> hw.ProgramBuilder:
    """Return a block that feeds itself, which runs row by row, and one behind it that runs tile by tile."""
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", 3)
    h = builder.add_compartments("h", 20, threshold=90, **FORGETS)
    y = builder.add_compartments("y", 20, threshold=90, decay_u=FORGETS_AT_ONCE, decay_v=300)
    builder.connect(x, h, np.full((20, 3), 100))
    builder.connect(h, h, 100 * np.roll(np.eye(20), 1, axis=0) - 30 * np.eye(20), delay=4)
    builder.connect(h, y, 40 * np.eye(20))
    return builder


def chunks_that_rest_in_turn() -> hw.ProgramBuilder:
    """Return groups of two chunks whose compartments each have their own input, so that chunks rest at different times."""
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", 20)
    n = builder.add_compartments("n", 20, threshold=90, **FORGETS)
    y = builder.add_compartments("y", 20, threshold=90, **FORGETS)
    builder.connect(x, n, 100 * np.eye(20))
    builder.connect(n, y, 100 * np.eye(20), delay=1)
    return builder


def sums(bias: int, decays: tuple[int, int] = (2000, 4096)) -> hw.ProgramBuilder:
    """Return a soma that only adds its children or, with a bias, is a sum and more."""
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", 3)
    soma = builder.add_compartments("soma", 20, threshold=150, bias=bias, **FORGETS)
    for name, decay in zip("ab", decays, strict=True):
        child = builder.add_compartments(
            name, 20, decay_u=FORGETS_AT_ONCE, decay_v=decay, threshold=0, joined_to=soma
        )
        builder.connect(x, child, np.full((20, 3), 100))
    return builder


def pairs(*decays: tuple[int, int]) -> hw.ProgramBuilder:
    """Return two dendrites and their sum, at the ends of a narrow voltage and at the threshold, with the given decays."""
    limits = {"threshold": 40, "vmin": 1 - 2**13, "vmax": 2**13 - 1}
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", 3)
    soma = builder.add_compartments("soma", 20, **FORGETS, **limits)
    for name, (decay_u, decay_v) in zip("ab", decays, strict=True):
        child = builder.add_compartments(
            name, 20, decay_u=decay_u, decay_v=decay_v, joined_to=soma, **limits
        )
        weights = np.add.outer(np.arange(20) * 4 - 40, [20, 8, -6 if name == "a" else 2])
        builder.connect(x, child, weights)
        builder.connect(soma, child, np.full((20, 20), -2))
    return builder


def echoes(children: int, delays: tuple[int, ...] = (0,), shift: int = 0) -> hw.ProgramBuilder:
    """Return neurons whose spikes return to their own dendrites after some delays or, with ``shift``, to a neighbour's."""
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", 3)
    soma = builder.add_compartments("soma", 20, threshold=40, **FORGETS)
    for k in range(children):
        child = builder.add_compartments(
            f"d{k}", 20, decay_u=2000, decay_v=1000 * k, threshold=0, joined_to=soma
        )
        builder.connect(x, child, np.add.outer(2 * np.arange(20), [20, 8, 4 * k]))
        for late in delays:
            own = np.diag(2 * k - 120 + 4 * np.arange(20) + 10 * late)
            builder.connect(soma, child, np.roll(own, shift, axis=0), delay=late)
    y = builder.add_compartments("y", 20, threshold=90, decay_u=FORGETS_AT_ONCE, decay_v=300)
    builder.connect(soma, y, 40 * np.eye(20))
    return builder


def echoes_alone(delays: tuple[int, ...] = (0,), **decays: int) -> hw.ProgramBuilder:
    """Return neurons whose spikes return to a dendrite that nothing else reaches, updated before the one that drives."""
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", 3)
    soma = builder.add_compartments("soma", 20, threshold=40, **FORGETS)
    decays = {"decay_u": 2000, "decay_v": 1000, **decays}
    own = builder.add_compartments("own", 20, threshold=0, joined_to=soma, **decays)
    for late in delays:
        builder.connect(soma, own, np.diag(4 * np.arange(20) - 42), delay=late)
    drive = builder.add_compartments("drive", 20, threshold=0, joined_to=soma, **FORGETS)
    builder.connect(x, drive, np.add.outer(2 * np.arange(20), [20, 8, 4]))
    return builder


def sums_of_two(*, chain: bool, refractory: int) -> hw.ProgramBuilder:
    """Return a soma that keeps nothing but refractory steps, with two dendrites, side by side or one behind the other."""
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", 3)
    soma = builder.add_compartments("soma", 20, threshold=40, refractory=refractory, **FORGETS)
    first = builder.add_compartments(
        "a", 20, decay_u=FORGETS_AT_ONCE, decay_v=300, threshold=0, joined_to=soma
    )
    second = builder.add_compartments(
        "b", 20, decay_u=2000, decay_v=40, threshold=0, joined_to=first if chain else soma
    )
    for child, last in ((first, -6), (second, 2)):
        builder.connect(x, child, np.add.outer(np.arange(20) * 4 - 40, [20, 8, last]))
    return builder


def pairs_in_turn() -> hw.ProgramBuilder:
    """Return pairs of dendrites with a channel each, so that one is reached while the other rests."""
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", 2)
    soma = builder.add_compartments("soma", 20, threshold=90, **FORGETS)
    for channel, name in enumerate("ab"):
        relay = builder.add_compartments(f"to {name}", 1, threshold=90, **FORGETS)
        builder.connect(x, relay, 100 * np.eye(2)[[channel]])
        child = builder.add_compartments(name, 20, threshold=0, joined_to=soma, **FORGETS)
        builder.connect(relay, child, np.full((20, 1), 100))
    return builder


def columns_in_reverse() -> hw.ProgramBuilder:
    """Return a group that is updated after the group that drives it, though its columns come first."""
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", 3)
    y = builder.add_compartments("y", 20, threshold=90, **FORGETS)
    h = builder.add_compartments("h", 20, threshold=90, **FORGETS)
    builder.connect(x, h, np.full((20, 3), 100))
    builder.connect(h, y, 100 * np.eye(20))
    return builder


def always(*, circle: bool) -> hw.ProgramBuilder:
    """Return three groups that spike in every step, so that their lists of spikes are full.

    The list of ``first`` is written after that of ``h`` but lies before it, and ``last`` reads the list of ``h`` later.
    """
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", 3)
    first, h, last = (
        builder.add_compartments(name, 3, threshold=0, bias=64, **FORGETS)
        for name in ("first", "h", "last")
    )
    builder.connect(x, h, np.full((3, 3), 100))
    builder.connect(h, first, 2 * np.eye(3))
    builder.connect(h, last, np.diag([2, 4, 6]))
    if circle:
        builder.connect(first, h, 2 * np.eye(3))
    return builder


def lists_by_delay() -> hw.ProgramBuilder:
    """Return links with so many synapses per source and delay that each delay has its own lists: outside and in a circle."""
    r = np.random.default_rng(0)
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", 4)
    n = builder.add_compartments("n", 200, threshold=300, decay_u=2000, decay_v=500)
    for source, size in ((x, 4), (n, 200)):
        weights = 2 * r.integers(-99, 100, (200, size)) * (r.random((200, size)) < 0.24)
        builder.connect(source, n, weights, delay=2 * r.integers(0, 2, (200, size)))
    return builder


def wide_lists() -> hw.ProgramBuilder:
    """Return lists whose synapses need more than 32 bits: ten for the slot, six for the delay, and 17 for the weight."""
    builder = hw.ProgramBuilder(CHIP)
    size = 520
    x = builder.add_input("x", size)
    n = builder.add_compartments("n", size, threshold=90, **FORGETS)
    delay = sparse.diags_array(np.arange(size) % 63, dtype=int)
    heavy = np.where(np.arange(size) % 3, 100, -256)
    builder.connect(x, n, sparse.diags_array(heavy, dtype=int), exponent=7, delay=delay)
    builder.connect(x, n, sparse.eye_array(size, dtype=int), delay=delay, sign_mode="excitatory")
    return builder


def refractory() -> hw.ProgramBuilder:
    """Return compartments that would be plain if they had no refractory steps."""
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", 2)
    n = builder.add_compartments("n", 20, threshold=90, refractory=4, **FORGETS)
    builder.connect(x, n, np.full((20, 2), 100))
    return builder


PROGRAMS = {
    "matrices": matrix,
    "delays of a matrix": delays_of_a_matrix,
    "weights beyond 16 bits": weights_beyond_16_bits,
    "late lists": late_lists,
    "slow decay": slow_decay,
    "recurrence ahead of another": recurrence_ahead_of_another,
    "chunks that rest in turn": chunks_that_rest_in_turn,
    "refractory": refractory,
    "sums": lambda: sums(0),
    "sums of a slow one last": lambda: sums(0, (4096, 2000)),
    "sums with a bias": lambda: sums(640),
    "sums that block": lambda: sums_of_two(chain=False, refractory=5),
    "sums in a row": lambda: sums_of_two(chain=True, refractory=1),
    "pairs": lambda: pairs((4096, 4096), (1000, 300)),
    "pairs that forget": lambda: pairs((4096, 4096), (4096, 4096)),
    "pairs, the first slow": lambda: pairs((4096, 300), (4096, 4096)),
    "echoes": lambda: echoes(2),
    "echoes of three": lambda: echoes(3),
    "echoes into what rests": echoes_alone,
    "late echoes into what rests": lambda: echoes_alone((2, 4), **FORGETS),
    "echoes, a step too late": lambda: echoes(2, (1,)),
    "echoes, over some steps": lambda: echoes(2, (0, 1, 2, 4)),
    "echoes, seven steps too late": lambda: echoes(2, (7,)),
    "echoes from a neighbour": lambda: echoes(2, shift=1),
    "pairs in turn": pairs_in_turn,
    "columns in reverse": columns_in_reverse,
    "full lists": lambda: always(circle=False),
    "full lists in a circle": lambda: always(circle=True),
    "lists by delay": lists_by_delay,
    "wide lists": wide_lists,
    "pairs, the second slow": lambda: pairs((4096, 4096), (4096, 300)),
}


def recordings(channels: int) -> np.ndarray:
    """Return four recordings.

    The first has few or many events around the ends of tiles, the second one in its first and last row; the third is
    silent; the fourth has an event in every seventh row.
    """
    rows = np.zeros((4, STEPS, channels), dtype=np.uint8)
    # Rows around the ends of tiles, at 64 and 128, and how many channels have an event there.
    for row, many in ((3, 1), (4, 11), (61, 2), (63, 8), (64, 1), (70, 9), (130, 16), (131, 3)):
        rows[0, row, :many] = 1
    rows[1, [0, STEPS - 1]] = 1
    for row in range(0, STEPS, 7):
        rows[3, row, (row * 5) % channels] = 1
    return rows


@pytest.mark.slow
@pytest.mark.parametrize("build", PROGRAMS.values(), ids=PROGRAMS)
@pytest.mark.parametrize("watched", [False, True], ids=["spikes alone", "registers, too"])
def test_a_shortcut_changes_nothing(build, watched):
    program = build().build()
    rows = recordings(program.streams["x"])
    probe = ("spikes", "u", "v", "potential") if watched else ("spikes",)
    fast, slow = (hw.simulate(program, rows, engine=engine, probe=probe) for engine in ENGINES)
    plain = hw.simulate(program, rows, probe=probe, skip=False)
    assert plain.counts.skipped_steps == 0
    assert slow.counts.neuron_updates_active > 0
    for result in (fast, plain):
        assert replace(result.counts, skipped_steps=0) == slow.counts
        for kind in probe:
            for name, expected in getattr(slow, kind).items():
                assert np.array_equal(getattr(result, kind)[name], expected), (kind, name)


@pytest.mark.parametrize("build", PROGRAMS.values(), ids=PROGRAMS)
def test_no_recording_is_influenced_by_the_one_before(build):
    program = build().build()
    rows = recordings(program.streams["x"])
    together = hw.simulate(program, rows).per_recording
    assert list(together) == [hw.simulate(program, recording).counts for recording in rows]


def test_inputs_of_a_phase_have_lists_of_their_own():
    builder = hw.ProgramBuilder(CHIP)
    n = builder.add_compartments("n", 2, threshold=90, **FORGETS)
    for name, weights in (("x", np.eye(2)), ("z", np.eye(2)[::-1])):
        builder.connect(builder.add_input(name, 2), n, 100 * weights)
    program = builder.build()
    first, second = np.zeros((2, 2, 5, 2), dtype=np.uint8)
    first[:, 0, 0] = second[:, 1, 0] = second[:, 3, 1] = 1
    for engine in ENGINES:
        spikes = hw.simulate(program, {"x": first, "z": second}, engine=engine).spikes["n"]
        assert spikes.tolist() == [[[0, 0], [1, 0], [0, 1], [0, 0], [1, 0]]] * 2


def test_synapses_due_after_the_end_are_counted_by_input():
    """The second input has a delay of two steps: of the events in row 3 of five, only its own come too late."""
    builder = hw.ProgramBuilder(CHIP)
    n = builder.add_compartments("n", 2, threshold=90, **FORGETS)
    for name, delay in (("x", 0), ("z", 2)):
        builder.connect(builder.add_input(name, 2), n, np.full((2, 2), 100), delay=delay)
    program = builder.build()
    first, second = np.zeros((2, 5, 2), dtype=np.uint8)
    first[3, 0] = second[1, 0] = second[3, 1] = 1
    for engine in ENGINES:
        counts = hw.simulate(program, {"x": first, "z": second}, engine=engine).counts
        assert (counts.synaptic_ops, counts.synaptic_ops_after_end) == (6, 2), engine


@pytest.mark.parametrize(
    ("build", "has_echo"),
    [
        (lambda: echoes(2), True), (lambda: echoes(3), True), (echoes_alone, True), (lambda: echoes(2, (1,)), True),
        (lambda: echoes(2, (0, 1, 2, 4)), True), (lambda: echoes(2, (7,)), False),
        (lambda: echoes(2, shift=1), False), (lambda: pairs((4096, 4096), (1000, 300)), False),
    ],
    ids=["pairs", "three", "alone", "late", "over some steps", "seven steps late", "of a neighbour", "of all"],
)  # fmt: skip
def test_spikes_that_return_to_their_own_dendrite_are_an_echo(build, has_echo):
    program = build().build()
    chunks = fast_layout(program, "time").tables.chunks
    assert (chunks.echo_to >= 0).any() == has_echo
    if has_echo:
        assert chunks.echo.any()


def test_wide_synapses_are_in_a_list_of_their_own():
    assert fast_layout(wide_lists().build(), "time").tables.links.kind.tolist() == [WIDE_LIST]
    assert fast_layout(lists_by_delay().build(), "time").tables.links.delay.tolist() == [0, 2, 0, 2]


@pytest.mark.parametrize(
    ("widest", "fits"), [(2**30 - 1, True), (2**30 + 1, False)], ids=["31 bits", "one more"]
)
def test_a_packed_weight_has_a_sign(widest, fits):
    """One bit is for the slot, so 31 bits are left for the weight and its sign."""
    words, _ = packed_synapses(np.array([0, 1]), np.array([widest, -widest]), np.array([3, 3]), 1)
    assert words.dtype == (np.int32 if fits else np.int64)
    assert (words >> 1).tolist() == [widest, -widest]


def many_children(count: int, **limits) -> hw.ChipProgram:
    """Return children that each add their lowest voltage to one soma."""
    builder = hw.ProgramBuilder(CHIP)
    builder.add_input("x", 1)
    soma = builder.add_compartments("soma", 1, threshold=0, **FORGETS, **limits)
    for i in range(count):
        builder.add_compartments(
            f"c{i}",
            1,
            decay_u=FORGETS_AT_ONCE,
            decay_v=KEEPS_ALL,
            bias=-4095 << 7,
            threshold=0,
            joined_to=soma,
            **limits,
        )
    return builder.build()


@pytest.mark.parametrize(
    ("children", "bits"), [(254, 32), (255, 64)], ids=["the most in 32 bits", "one more"]
)
def test_sums_that_exceed_32_bits_make_a_layout_of_64(children, bits):
    """256 voltages and a current, all at the ends of their ranges, are 2^31 + 2^23 - 256: too much for 32 bits."""
    assert (
        fast_layout(many_children(children), "time").tables.chunks.registers.dtype == f"int{bits}"
    )


def test_many_lowest_voltages_do_not_wrap_to_a_spike():
    """The sum of 300 lowest voltages must not wrap to a positive number, which would spike."""
    program = many_children(300, vmin=1 - 2**23, vmax=2**9 - 1)
    for engine in ENGINES:
        result = hw.simulate(program, np.zeros((30, 1), dtype=np.uint8), engine=engine)
        assert result.counts.spikes == 0, engine


@pytest.mark.parametrize("lines", [256, 257], ids=["the most in a tile", "one line more"])
def test_more_spikes_than_one_loop_delivers_give_the_same(lines):
    assert 256 * TILE == MOST_LISTED
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", lines)
    n = builder.add_compartments("n", 20, decay_u=1024, decay_v=128, threshold=4000)
    builder.connect(x, n, 2 * (np.arange(20)[:, None] - np.arange(lines) % 7))
    spikes = np.ones((TILE + 3, lines), dtype=np.uint8)
    fast, slow = (
        hw.simulate(builder.build(), spikes, engine=engine, probe=("u",), skip=False)
        for engine in ENGINES
    )
    assert (fast.u["n"] == slow.u["n"]).all()
    assert slow.counts.spikes > 0
    assert fast.counts == slow.counts
