"""Vectors for kernels: operations on :class:`Lanes` write LLVM instructions into the loop that is being compiled.

numba compiles loops over single numbers, and LLVM then tries to find vectors in them, which often fails. A *kernel*
(:mod:`hw_model.engine.chunks`) avoids that. It is a Python function that runs once, when a loop is compiled: each
operation on :class:`Lanes` adds an instruction for all 16 compartments of a chunk, the lanes. Lanes have the type of
the arrays that are passed to the kernel, 32 or 64 bits, or they are masks of one bit per lane. Python integers in a
kernel become constants. Loads and stores go through a :class:`Place`.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from typing import Any

import numba
from llvmlite import ir
from llvmlite.binding import get_host_cpu_features

from hw_model.engine.layout import FACTOR_BITS, LANES, USUAL_WIDTHS

BIT = ir.IntType(1)
BYTE = ir.IntType(8)
COUNT = ir.IntType(32)
"""The type of counts, lane numbers, and masks as numbers."""
BITS_OF_BYTE = 8
"""Bits of a byte, each of which stands for a lane."""
LlvmValue = Any
"""A value of LLVM that a loop passes to a kernel; llvmlite has no Python types for them."""
LlvmValues = Sequence[Any]
"""The values of LLVM that a kernel returns to a loop."""
WrapHalves = Sequence[Any]
"""Half the ranges of q (in units of 64) and of u, at which they wrap: lanes or constants; None if nothing wraps."""


def _operation(name: str) -> Callable[["Lanes", "Lanes | int"], "Lanes"]:
    """Return a method of :class:`Lanes` that adds an instruction of this name in LLVM."""

    def operate(left: "Lanes", right: "Lanes | int") -> "Lanes":
        instruction = getattr(left.builder, name)
        return left.with_value(instruction(left.value, left.like(right)))

    return operate


def _comparison(sign: str) -> Callable[["Lanes", "Lanes | int"], "Lanes"]:
    """Return a method of :class:`Lanes` that adds a comparison, whose result is a mask."""

    def compare(left: "Lanes", right: "Lanes | int") -> "Lanes":
        return left.with_value(left.builder.icmp_signed(sign, left.value, left.like(right)))

    return compare


def _lane_type(kind: ir.Type) -> ir.Type:
    """Return the type of one lane of a type."""
    return kind.element if isinstance(kind, ir.VectorType) else kind


def _in_every_lane(kind: ir.Type, number: int) -> ir.Value:
    """Return a constant of a type, the same in every lane."""
    if isinstance(kind, ir.VectorType):
        return ir.Constant(kind, [number] * kind.count)
    return ir.Constant(kind, number)


class Lanes:
    """A number, or a condition, for each lane of a chunk or for one compartment (:mod:`hw_model.engine.alone`)."""

    def __init__(self, builder: ir.IRBuilder, value: ir.Value) -> None:
        self.builder = builder
        self.value = value

    def with_value(self, value: ir.Value) -> "Lanes":
        """Return lanes with another value in the same kernel."""
        return Lanes(self.builder, value)

    def like(self, other: "Lanes | int") -> ir.Value:
        """Return an operand in the type of these lanes: an integer in every lane, a condition as 0 or 1."""
        if not isinstance(other, Lanes):
            return _in_every_lane(self.value.type, other)
        wide = self.value.type
        narrow = other.value.type
        if narrow == wide:
            return other.value
        # A mask is 0 or 1, so it has no sign to extend.
        if _lane_type(narrow) == BIT:
            return self.builder.zext(other.value, wide)
        return self.builder.sext(other.value, wide)

    __add__ = _operation("add")
    __sub__ = _operation("sub")
    __mul__ = _operation("mul")
    __and__ = _operation("and_")
    __or__ = _operation("or_")
    __xor__ = _operation("xor")
    __lshift__ = _operation("shl")
    __rshift__ = _operation("ashr")
    __lt__ = _comparison("<")
    __gt__ = _comparison(">")
    __eq__ = _comparison("==")  # type: ignore[assignment]
    __ne__ = _comparison("!=")  # type: ignore[assignment]

    def __neg__(self) -> "Lanes":
        return self.with_value(self.builder.neg(self.value))


def where(mask: Lanes, chosen: Lanes | int, otherwise: Lanes) -> Lanes:
    """Return the lanes of ``chosen`` where the mask is set, else those of ``otherwise``."""
    selected = otherwise.builder.select(mask.value, otherwise.like(chosen), otherwise.value)
    return otherwise.with_value(selected)


def select(mask: Lanes, chosen: Lanes | int, otherwise: Lanes | int) -> Lanes:
    """Return what :func:`where` does, but ``chosen`` or ``otherwise`` may be an integer; not both."""
    if isinstance(otherwise, int):
        assert isinstance(chosen, Lanes)
        selected = chosen.builder.select(mask.value, chosen.value, chosen.like(otherwise))
        return chosen.with_value(selected)
    return where(mask, chosen, otherwise)


def as_factor(lanes: Lanes) -> Lanes:
    """Return lanes that are known to fit 16 bits, in a form from which LLVM knows it too.

    It then multiplies them by a short factor with a faster instruction. The numbers of a single compartment or of
    64-bit lanes may be wider, and stay as they are.
    """
    kind = lanes.value.type
    if kind == COUNT or kind.element.width > COUNT.width:
        return lanes
    factor = ir.VectorType(ir.IntType(FACTOR_BITS), LANES)
    short = lanes.builder.trunc(lanes.value, factor)
    return lanes.with_value(lanes.builder.sext(short, lanes.value.type))


def first_bits(lanes: Lanes, bits_kept: int) -> Lanes:
    """Return the highest ``bits_kept`` bits of each lane as a number >= 0; all ones for a small negative number."""
    kind = lanes.value.type
    shift = _in_every_lane(kind, _lane_type(kind).width - bits_kept)
    return lanes.with_value(lanes.builder.lshr(lanes.value, shift))


def halves_of_ranges(place: "Place", widths: LlvmValue) -> WrapHalves:
    """Return half the ranges of q and u, from the :class:`hw_model.engine.layout.Widths` that a loop passes.

    Layouts have 32 bits only with the usual widths, which are then constants. With an empty tuple nothing wraps.
    """
    if not widths.type.elements:
        return None, None
    if place.width == COUNT.width:
        return USUAL_WIDTHS
    half_charge, half_current = (place.each(widths, number) for number in range(2))
    return half_charge, half_current


def put_side_by_side(place: "Place", mask: Lanes, numbers: Lanes) -> LlvmValue:
    """Write the numbers of the lanes in the mask to a place, without gaps; return how many there are.

    The place must have room for all lanes, as some may be written behind the last number.
    """
    if can("avx512f"):
        place[0] = _side_by_side(mask, numbers)
        return count(mask)
    builder = place.builder
    numbers_of_lanes = variable(numbers)
    bits_left = _on_stack(builder, COUNT)
    builder.store(bits(mask), bits_left)
    # Without that instruction LLVM would move every lane. Most chunks have few spikes, so a loop over the set bits,
    # lowest first, is faster. `x & (x - 1)` clears the lowest bit of x.
    with _each_number(builder, count(mask)) as number:
        mask_left = builder.load(bits_left)
        lowest_lane = builder.cttz(mask_left, BIT(1))
        place.put_one(number, numbers_of_lanes.one(lowest_lane))
        without_lowest = builder.and_(mask_left, builder.sub(mask_left, COUNT(1)))
        builder.store(without_lowest, bits_left)
    return count(mask)


def put_lane_numbers(place: "Place", mask: Lanes, first: LlvmValue) -> LlvmValue:
    """Write the numbers of the lanes in the mask, each plus ``first``, to a place, without gaps.

    Return how many there are. The place must have room for all lanes.
    """
    builder = place.builder
    lanes = mask.value.type.count
    if can("avx512vbmi2"):
        lane_numbers = ir.Constant(ir.VectorType(BYTE, lanes), list(range(lanes)))
        set_lanes = _side_by_side(mask, mask.with_value(lane_numbers)).value
        set_count = count(mask)
        place.put_bytes(COUNT(0), _some_lanes(builder, set_lanes, 0, LANES), first)
        if lanes > LANES:
            # More set lanes than a vector holds are rare.
            overflows = builder.icmp_unsigned(">", set_count, COUNT(LANES))
            with builder.if_then(overflows, likely=False):
                for low in range(LANES, lanes, LANES):
                    place.put_bytes(COUNT(low), _some_lanes(builder, set_lanes, low, LANES), first)
        return set_count
    # Eight lanes at a time: a table has the lane numbers for each of the 256 values of their bits.
    mask_bits = bits(mask)
    put_so_far = COUNT(0)
    for low in range(0, lanes, BITS_OF_BYTE):
        byte = builder.and_(builder.lshr(mask_bits, mask_bits.type(low)), mask_bits.type(255))
        eight = builder.load(builder.gep(_lanes_of_bytes(builder), [COUNT(0), byte]))
        lanes_of_byte = builder.bitcast(eight, ir.VectorType(BYTE, BITS_OF_BYTE))
        place.put_bytes(put_so_far, lanes_of_byte, first, more=low)
        put_so_far = builder.add(put_so_far, _as_count(builder, builder.ctpop(byte)))
    return put_so_far


@cache
def can(feature: str) -> bool:
    """Return whether the processor that is compiled for has a feature, by LLVM's name.

    With AVX-512 (for bytes, its extension VBMI2) one instruction moves the lanes of a mask side by side.
    """
    features = numba.config.CPU_FEATURES
    if features is None:
        is_generic = numba.config.CPU_NAME == "generic"
        features = "" if is_generic else get_host_cpu_features().flatten()
    return f"+{feature}" in features.split(",")


def _side_by_side(mask: Lanes, numbers: Lanes) -> Lanes:
    """Return the numbers of the lanes in the mask, moved to the first lanes; the other lanes are undefined."""
    vector = numbers.value.type
    builder = mask.builder
    kind = ir.FunctionType(vector, [vector, mask.value.type, vector])
    name = f"llvm.experimental.vector.compress.v{vector.count}i{vector.element.width}"
    functions = builder.module.globals
    compress = functions[name] if name in functions else ir.Function(builder.module, kind, name)
    return numbers.with_value(
        builder.call(compress, [numbers.value, mask.value, ir.Constant(vector, ir.Undefined)])
    )


def _some_lanes(builder: ir.IRBuilder, vector: ir.Value, low: int, many: int) -> ir.Value:
    """Return ``many`` lanes of a vector from lane ``low`` on."""
    lanes = ir.Constant(ir.VectorType(COUNT, many), list(range(low, low + many)))
    return builder.shuffle_vector(vector, vector, lanes)


def _lanes_of_bytes(builder: ir.IRBuilder) -> ir.Value:
    """Return a table of 256 entries: for each byte the numbers of its set bits, ascending, in eight bytes."""
    name = "lanes_of_bytes"
    module = builder.module
    if name not in module.globals:
        numbers = []
        for byte in range(256):
            set_bits = bytes(bit for bit in range(BITS_OF_BYTE) if byte >> bit & 1)
            numbers.append(int.from_bytes(set_bits, "little"))
        table = ir.Constant(ir.ArrayType(ir.IntType(64), 256), numbers)
        variable_in_module = ir.GlobalVariable(module, table.type, name)
        variable_in_module.linkage = "internal"
        variable_in_module.global_constant = True
        variable_in_module.initializer = table
    return module.globals[name]


def variable(lanes: Lanes) -> "Place":
    """Return a place for lanes that change in a loop of the kernel; LLVM keeps it in registers of the processor."""
    kind = lanes.value.type
    room = _on_stack(lanes.builder, kind)
    place = Place(lanes.builder, lanes.builder.bitcast(room, kind.element.as_pointer()))
    place[0] = lanes
    return place


def each_row(place: "Place", many: LlvmValue) -> Iterator[LlvmValue]:
    """Write a machine loop over the numbers 0 to ``many - 1``.

    In the kernel it is the iterable of a ``for``, whose body runs once: the instructions that it writes are repeated.
    """
    with _each_number(place.builder, many) as number:
        yield number


@contextmanager
def _each_number(builder: ir.IRBuilder, many: LlvmValue) -> Iterator[LlvmValue]:
    """Write a machine loop over 0 to ``many - 1``, of the type of ``many``, around the body of the ``with``."""
    test = builder.append_basic_block("test")
    body = builder.append_basic_block("body")
    after = builder.append_basic_block("after")
    counter = _on_stack(builder, many.type)
    builder.store(many.type(0), counter)
    builder.branch(test)
    with builder.goto_block(test):
        goes_on = builder.icmp_signed("<", builder.load(counter), many)
        builder.cbranch(goes_on, body, after)
    builder.position_at_end(body)
    number = builder.load(counter)
    yield number
    builder.store(builder.add(number, many.type(1)), counter)
    builder.branch(test)
    builder.position_at_end(after)


def _on_stack(builder: ir.IRBuilder, kind: ir.Type) -> ir.Value:
    """Return room on the stack, reserved once at the start of the function: in a loop it would grow with each round."""
    with builder.goto_entry_block():
        return builder.alloca(kind)


def bits(mask: Lanes) -> ir.Value:
    """Return a mask as a number whose bit i is lane i: 32 bits wide, or as many as there are lanes if more."""
    mask_bits = mask.builder.bitcast(mask.value, ir.IntType(mask.value.type.count))
    if mask_bits.type.width >= COUNT.width:
        return mask_bits
    return mask.builder.zext(mask_bits, COUNT)


@contextmanager
def seldom(mask: Lanes) -> Iterator[None]:
    """Run the body of the ``with`` only if a lane of the mask is set; the processor is told that this is rare."""
    is_any_set = mask.builder.icmp_unsigned("!=", bits(mask), COUNT(0))
    with mask.builder.if_then(is_any_set, likely=False):
        yield


def first_lanes(mask: Lanes, many: LlvmValue) -> Lanes:
    """Return a mask without the lanes from number ``many`` on, which is at least 1 and may exceed the lanes."""
    builder = mask.builder
    lanes = mask.value.type.count
    mask_bits = bits(mask)
    lanes_beyond = builder.sub(COUNT(lanes), builder.trunc(many, COUNT))
    some_beyond = builder.icmp_signed(">", lanes_beyond, COUNT(0))
    lanes_beyond = builder.select(some_beyond, lanes_beyond, COUNT(0))
    if mask_bits.type != COUNT:
        lanes_beyond = builder.zext(lanes_beyond, mask_bits.type)
    all_lanes = mask_bits.type((1 << lanes) - 1)
    bits_left = builder.and_(mask_bits, builder.lshr(all_lanes, lanes_beyond))
    as_mask = builder.bitcast(builder.trunc(bits_left, ir.IntType(lanes)), mask.value.type)
    return mask.with_value(as_mask)


def mask_of(place: "Place", number: LlvmValue) -> Lanes:
    """Return the mask whose lane i is bit i of a number."""
    builder = place.builder
    low_bits = builder.trunc(number, ir.IntType(LANES))
    return Lanes(builder, builder.bitcast(low_bits, ir.VectorType(BIT, LANES)))


def count(mask: Lanes) -> ir.Value:
    """Return how many lanes of a mask are set."""
    return _as_count(mask.builder, mask.builder.ctpop(bits(mask)))


def _as_count(builder: ir.IRBuilder, number: ir.Value) -> ir.Value:
    return number if number.type == COUNT else builder.trunc(number, COUNT)


class Place:
    """An array from some element on, read and written in vectors: ``place[n]`` is vector n from there.

    With the registers of a chunk, n is the field. ``row_bytes`` is the distance of two rows of the array.
    """

    def __init__(
        self, builder: ir.IRBuilder, first: ir.Value, row_bytes: ir.Value = None, lanes: int = LANES
    ) -> None:
        self.builder = builder
        self._first = first
        self._row_bytes = row_bytes
        self._lanes = lanes

    def of(self, lanes: int) -> "Place":
        """Return the same place, read in vectors of another number of lanes."""
        return Place(self.builder, self._first, self._row_bytes, lanes)

    @property
    def _vector(self) -> ir.Type:
        return ir.VectorType(self._first.type.pointee, self._lanes)

    def _at(self, field: int) -> ir.Value:
        address = self.builder.gep(self._first, [ir.Constant(ir.IntType(64), field * self._lanes)])
        return self.builder.bitcast(address, self._vector.as_pointer())

    def __getitem__(self, field: int) -> Lanes:
        return Lanes(self.builder, self.builder.load(self._at(field), align=self._align))

    def __setitem__(self, field: int, lanes: Lanes | int) -> None:
        if isinstance(lanes, Lanes):
            value = lanes.value
        else:
            value = ir.Constant(self._vector, [lanes] * self._lanes)
        self.builder.store(value, self._at(field), align=self._align)

    @property
    def _align(self) -> int:
        """Bytes to which vectors are aligned for sure: those of one number, as a place may begin at any element."""
        return max(1, self.width // 8)

    def each(self, given: LlvmValue, number: int | None = None) -> Lanes:
        """Return a number in every lane; with ``number``, that element of a tuple of numbers."""
        vector = self._vector
        value = given if number is None else self.builder.extract_value(given, number)
        if value.type != vector.element:
            value = self.builder.trunc(value, vector.element)
        in_lane_0 = self.builder.insert_element(ir.Constant(vector, ir.Undefined), value, COUNT(0))
        lane_0_everywhere = ir.Constant(ir.VectorType(COUNT, self._lanes), [0] * self._lanes)
        filled = self.builder.shuffle_vector(in_lane_0, in_lane_0, lane_0_everywhere)
        return Lanes(self.builder, filled)

    def one(self, lane: LlvmValue) -> ir.Value:
        """Return the number of one lane."""
        return self.builder.load(self.builder.gep(self._first, [lane]))

    def put_one(self, lane: LlvmValue, number: ir.Value) -> None:
        """Write the number of one lane."""
        self.builder.store(number, self.builder.gep(self._first, [lane]))

    def put_bytes(
        self, number: LlvmValue, given: ir.Value, first: LlvmValue, more: int = 0
    ) -> None:
        """Write a vector of bytes as numbers from element ``number`` on, each plus ``first`` and ``more``."""
        place = Place(self.builder, self.builder.gep(self._first, [number]), lanes=given.type.count)
        numbers = Lanes(self.builder, self.builder.zext(given, place._vector))
        place[0] = numbers + place.each(first) + more

    def numbers(self) -> Lanes:
        """Return the number of each lane: 0, 1, 2, ..."""
        return Lanes(self.builder, ir.Constant(self._vector, list(range(self._lanes))))

    def after(self, fields: int) -> "Place":
        """Return the place that lies this many fields further on."""
        elements = ir.Constant(ir.IntType(64), fields * LANES)
        return Place(self.builder, self.builder.gep(self._first, [elements]))

    def row(self, number: LlvmValue) -> "Place":
        """Return the place that lies this many rows of the array further on."""
        first_byte = self.builder.bitcast(self._first, BYTE.as_pointer())
        offset = self.builder.mul(number, self._row_bytes)
        first = self.builder.bitcast(self.builder.gep(first_byte, [offset]), self._first.type)
        return Place(self.builder, first)

    def bits(self) -> Lanes:
        """Return the mask that is stored here as a number."""
        return mask_of(self, self.builder.load(self._first))

    def put_bits(self, mask: Lanes) -> None:
        """Store a mask here as a number."""
        self.builder.store(bits(mask), self._first)

    @property
    def width(self) -> int:
        """Bits of a lane."""
        return int(self._first.type.pointee.width)
