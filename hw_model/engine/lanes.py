"""The lanes of a chunk as one vector, in kernels that loops take in: LLVM is told what it would have to find out.

A kernel is Python that is run once, when a loop is compiled: each operation on :class:`Lanes` adds an instruction for
all compartments of a chunk. Lanes have the type of the arrays that the kernel is given, 32 or 64 bits, or are masks of
one bit; integers in a kernel are constants.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from typing import Any

import numba
from llvmlite import ir
from llvmlite.binding import get_host_cpu_features

from hw_model.engine.layout import FACTOR_BITS, LANES, USUAL_WIDTHS

BIT, BYTE, COUNT = ir.IntType(1), ir.IntType(8), ir.IntType(32)
BITS_OF_BYTE = 8
"""Bits of a byte, each of which stands for a lane."""
LlvmValue = Any
"""What a loop gives to a kernel: a value of LLVM, which has no type of its own in Python."""
LlvmValues = Sequence[Any]
"""What a kernel returns, values of LLVM."""
WrapHalves = Sequence[Any]
"""Half the ranges of q, in units, and of u, at which they wrap: lanes, or constants; None where nothing wraps."""


def _operation(name: str) -> Callable[["Lanes", "Lanes | int"], "Lanes"]:
    return lambda left, right: left.with_value(
        getattr(left.builder, name)(left.value, left.like(right))
    )


def _comparison(sign: str) -> Callable[["Lanes", "Lanes | int"], "Lanes"]:
    return lambda left, right: left.with_value(
        left.builder.icmp_signed(sign, left.value, left.like(right))
    )


def _lane_type(kind: ir.Type) -> ir.Type:
    return kind.element if isinstance(kind, ir.VectorType) else kind


def _in_every_lane(kind: ir.Type, number: int) -> ir.Value:
    """Return a constant of a type, the same in every lane."""
    return ir.Constant(kind, [number] * kind.count if isinstance(kind, ir.VectorType) else number)


class Lanes:
    """A number, or a truth, of every lane of a chunk, or of a compartment alone."""

    def __init__(self, builder: ir.IRBuilder, value: ir.Value) -> None:
        self.builder, self.value = builder, value

    def with_value(self, value: ir.Value) -> "Lanes":
        """Return other lanes of the same kernel."""
        return Lanes(self.builder, value)

    def like(self, other: "Lanes | int") -> ir.Value:
        """Return what is combined with these lanes, in their type: an integer in every lane, a truth as 0 or 1."""
        if not isinstance(other, Lanes):
            return _in_every_lane(self.value.type, other)
        wide = self.value.type
        narrow = other.value.type
        if narrow == wide:
            return other.value
        if _lane_type(narrow) == BIT:
            return self.builder.zext(other.value, wide)
        return self.builder.sext(other.value, wide)

    __add__, __sub__, __mul__ = _operation("add"), _operation("sub"), _operation("mul")
    __and__, __or__, __xor__ = _operation("and_"), _operation("or_"), _operation("xor")
    __lshift__, __rshift__ = _operation("shl"), _operation("ashr")
    __lt__, __gt__ = _comparison("<"), _comparison(">")
    __eq__ = _comparison("==")  # type: ignore[assignment]
    __ne__ = _comparison("!=")  # type: ignore[assignment]

    def __neg__(self) -> "Lanes":
        return self.with_value(self.builder.neg(self.value))


def where(mask: Lanes, chosen: Lanes | int, otherwise: Lanes) -> Lanes:
    """Return the lanes of ``chosen`` where the mask is set, else those of ``otherwise``."""
    selected = otherwise.builder.select(mask.value, otherwise.like(chosen), otherwise.value)
    return otherwise.with_value(selected)


def select(mask: Lanes, chosen: Lanes | int, otherwise: Lanes | int) -> Lanes:
    """Do the same where ``chosen`` or ``otherwise`` may be an integer, but not both."""
    if isinstance(otherwise, int):
        assert isinstance(chosen, Lanes)
        selected = chosen.builder.select(mask.value, chosen.value, chosen.like(otherwise))
        return chosen.with_value(selected)
    return where(mask, chosen, otherwise)


def as_factor(lanes: Lanes) -> Lanes:
    """Return lanes that are within the bits of a factor; LLVM, which is told that, multiplies two of them faster.

    A compartment alone may have wider registers, and is left as it is.
    """
    kind = lanes.value.type
    if kind == COUNT or kind.element.width > COUNT.width:
        return lanes
    factor = ir.VectorType(ir.IntType(FACTOR_BITS), LANES)
    return lanes.with_value(
        lanes.builder.sext(lanes.builder.trunc(lanes.value, factor), lanes.value.type)
    )


def first_bits(lanes: Lanes, bits_kept: int) -> Lanes:
    """Return the highest ``bits_kept`` bits of each lane as a number: all ones of what is negative and small."""
    kind = lanes.value.type
    shift = _in_every_lane(kind, _lane_type(kind).width - bits_kept)
    return lanes.with_value(lanes.builder.lshr(lanes.value, shift))


def halves_of_ranges(place: "Place", widths: LlvmValue) -> WrapHalves:
    """Return the pair :class:`hw_model.engine.layout.Widths`; the usual one, in 32 bits, is known beforehand.

    Without widths, an empty tuple, nothing wraps.
    """
    if not widths.type.elements:
        return None, None
    if place.width == COUNT.width:
        return USUAL_WIDTHS
    half_charge, half_current = (place.each(widths, number) for number in range(2))
    return half_charge, half_current


def put_side_by_side(place: "Place", mask: Lanes, numbers: Lanes) -> LlvmValue:
    """Put the numbers of the lanes that are set at a place, side by side; return how many there are.

    The place has room for all lanes.
    """
    if can("avx512f"):
        place[0] = _side_by_side(mask, numbers)
        return count(mask)
    builder = place.builder
    numbers_of_lanes = variable(numbers)
    bits_left = _on_stack(builder, COUNT)
    builder.store(bits(mask), bits_left)
    # One number after the other: mostly there are few, and LLVM would move every lane.
    with _each_number(builder, count(mask)) as number:
        mask_left = builder.load(bits_left)
        lowest_lane = builder.cttz(mask_left, BIT(1))
        place.put_one(number, numbers_of_lanes.one(lowest_lane))
        without_lowest = builder.and_(mask_left, builder.sub(mask_left, COUNT(1)))
        builder.store(without_lowest, bits_left)
    return count(mask)


def put_lane_numbers(place: "Place", mask: Lanes, first: LlvmValue) -> LlvmValue:
    """Put which lanes are set at a place, side by side, counted from ``first``; return how many there are.

    The place has room for all lanes.
    """
    builder = place.builder
    lanes = mask.value.type.count
    if can("avx512vbmi2"):
        lane_numbers = ir.Constant(ir.VectorType(BYTE, lanes), list(range(lanes)))
        set_lanes = _side_by_side(mask, mask.with_value(lane_numbers)).value
        set_count = count(mask)
        place.put_bytes(COUNT(0), _some_lanes(builder, set_lanes, 0, LANES), first)
        if lanes > LANES:
            # More than one vector of set lanes is rare.
            overflows = builder.icmp_unsigned(">", set_count, COUNT(LANES))
            with builder.if_then(overflows, likely=False):
                for low in range(LANES, lanes, LANES):
                    place.put_bytes(COUNT(low), _some_lanes(builder, set_lanes, low, LANES), first)
        return set_count
    # Eight lanes at a time, whose numbers a table tells.
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
    """Tell whether the processor that is compiled for has a feature, as LLVM calls it.

    With AVX-512, and for bytes its VBMI2, it moves chosen lanes side by side at once.
    """
    features = numba.config.CPU_FEATURES
    if features is None:
        is_generic = numba.config.CPU_NAME == "generic"
        features = "" if is_generic else get_host_cpu_features().flatten()
    return f"+{feature}" in features.split(",")


def _side_by_side(mask: Lanes, numbers: Lanes) -> Lanes:
    """Return the numbers of the lanes that are set in the first lanes; what the others hold does not count."""
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
    """Return the table of the bits that are set in a byte: their numbers, ascending, in eight bytes."""
    name = "lanes_of_bytes"
    module = builder.module
    if name not in module.globals:
        of_bytes = (
            bytes(bit for bit in range(BITS_OF_BYTE) if byte >> bit & 1) for byte in range(256)
        )
        numbers = [int.from_bytes(of_byte, "little") for of_byte in of_bytes]
        table = ir.Constant(ir.ArrayType(ir.IntType(64), 256), numbers)
        made = ir.GlobalVariable(module, table.type, name)
        made.linkage, made.global_constant, made.initializer = "internal", True, table
    return module.globals[name]


def variable(lanes: Lanes) -> "Place":
    """Return a place for lanes that change in a loop, which keeps them in registers of the processor."""
    kind = lanes.value.type
    room = _on_stack(lanes.builder, kind)
    place = Place(lanes.builder, lanes.builder.bitcast(room, kind.element.as_pointer()))
    place[0] = lanes
    return place


def each_row(place: "Place", many: LlvmValue) -> Iterator[LlvmValue]:
    """Loop over the numbers of several rows: what is done with one, in a kernel, becomes a loop of the machine."""
    with _each_number(place.builder, many) as number:
        yield number


@contextmanager
def _each_number(builder: ir.IRBuilder, many: LlvmValue) -> Iterator[LlvmValue]:
    """Write a loop of the machine over the numbers from 0 to before ``many``, of its type."""
    test, body, after = (builder.append_basic_block(name) for name in ("test", "body", "after"))
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
    """Return room on the stack, taken once where the function begins, not in each round of a loop."""
    with builder.goto_entry_block():
        return builder.alloca(kind)


def bits(mask: Lanes) -> ir.Value:
    """Return a mask as a number, of 32 bits or, if there are more lanes, as many: lane i is bit i."""
    mask_bits = mask.builder.bitcast(mask.value, ir.IntType(mask.value.type.count))
    if mask_bits.type.width >= COUNT.width:
        return mask_bits
    return mask.builder.zext(mask_bits, COUNT)


@contextmanager
def seldom(mask: Lanes) -> Iterator[None]:
    """Leave out what is inside, which is expected, where no lane of a mask is set."""
    with mask.builder.if_then(mask.builder.icmp_unsigned("!=", bits(mask), COUNT(0)), likely=False):
        yield


def first_lanes(mask: Lanes, many: LlvmValue) -> Lanes:
    """Return a mask without the lanes from number ``many`` on, which is above 0 and may be more than there are."""
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
    """Return the mask that a number is."""
    builder = place.numbers().builder
    return Lanes(
        builder,
        builder.bitcast(builder.trunc(number, ir.IntType(LANES)), ir.VectorType(BIT, LANES)),
    )


def count(mask: Lanes) -> ir.Value:
    """Return in how many lanes a mask is set."""
    return _as_count(mask.builder, mask.builder.ctpop(bits(mask)))


def _as_count(builder: ir.IRBuilder, number: ir.Value) -> ir.Value:
    return number if number.type == COUNT else builder.trunc(number, COUNT)


class Place:
    """Vectors of an array from an element on, by number: fields of a chunk, or a row's charges."""

    def __init__(
        self, builder: ir.IRBuilder, first: ir.Value, row_bytes: ir.Value = None, lanes: int = LANES
    ) -> None:
        self.builder, self._first, self._row_bytes, self._lanes = builder, first, row_bytes, lanes

    def of(self, lanes: int) -> "Place":
        """Return the same place with vectors of so many lanes."""
        return Place(self.builder, self._first, self._row_bytes, lanes)

    @property
    def _vector(self) -> ir.Type:
        return ir.VectorType(self._first.type.pointee, self._lanes)

    def _at(self, field: int) -> ir.Value:
        address = self.builder.gep(self._first, [ir.Constant(ir.IntType(64), field * self._lanes)])
        return self.builder.bitcast(address, self._vector.as_pointer())

    def __getitem__(self, field: int) -> Lanes:
        return Lanes(
            self.builder, self.builder.load(self._at(field), align=max(1, self.width // 8))
        )

    def __setitem__(self, field: int, lanes: Lanes | int) -> None:
        value = (
            lanes.value
            if isinstance(lanes, Lanes)
            else ir.Constant(self._vector, [lanes] * self._lanes)
        )
        self.builder.store(value, self._at(field), align=max(1, self.width // 8))

    def each(self, given: LlvmValue, number: int | None = None) -> Lanes:
        """Return a number, or one of a pair, in each lane."""
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
        """Put the number of one lane."""
        self.builder.store(number, self.builder.gep(self._first, [lane]))

    def put_bytes(
        self, number: LlvmValue, given: ir.Value, first: LlvmValue, more: int = 0
    ) -> None:
        """Put a vector of bytes as numbers from element ``number`` on, each with ``first`` and ``more`` added."""
        place = Place(self.builder, self.builder.gep(self._first, [number]), lanes=given.type.count)
        numbers = Lanes(self.builder, self.builder.zext(given, place._vector))
        place[0] = numbers + place.each(first) + more

    def numbers(self) -> Lanes:
        """Return the number of each lane."""
        return Lanes(self.builder, ir.Constant(self._vector, list(range(self._lanes))))

    def after(self, fields: int) -> "Place":
        """Return the place that many fields on."""
        return Place(
            self.builder,
            self.builder.gep(self._first, [ir.Constant(ir.IntType(64), fields * LANES)]),
        )

    def row(self, number: LlvmValue) -> "Place":
        """Return the place that many rows of the array on."""
        first = self.builder.bitcast(self._first, BYTE.as_pointer())
        first = self.builder.gep(first, [self.builder.mul(number, self._row_bytes)])
        return Place(self.builder, self.builder.bitcast(first, self._first.type))

    def bits(self) -> Lanes:
        """Return the mask that the number here is."""
        return mask_of(self, self.builder.load(self._first))

    def put_bits(self, mask: Lanes) -> None:
        """Put a mask here as a number."""
        self.builder.store(bits(mask), self._first)

    @property
    def width(self) -> int:
        """Bits of a lane."""
        return int(self._first.type.pointee.width)
