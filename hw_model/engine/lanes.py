"""The lanes of a chunk as one vector, in kernels that loops take in: LLVM is told what it would have to find out.

A kernel is Python that is run once, when a loop is compiled: each operation on :class:`Lanes` adds an instruction for
all compartments of a chunk. Lanes have the type of the arrays that the kernel is given, 32 or 64 bits, or are masks of
one bit; integers in a kernel are constants.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from inspect import Parameter, Signature
from typing import Any

from llvmlite import ir
from llvmlite.binding import get_host_cpu_features
from numba.core import cgutils, config, types
from numba.extending import intrinsic

from hw_model.engine.layout import FACTOR_BITS, LANES, USUAL_WIDTHS

BIT, COUNT = ir.IntType(1), ir.IntType(32)
EIGHT = 8
"""Bits of a byte, each of which stands for a lane."""
Given = Any
"""What a loop gives to a kernel, a value of LLVM."""
Returned = Sequence[Any]
"""What a kernel returns, values of LLVM."""
Ends = Sequence[Any]
"""Half the ranges of q and of u: lanes, or constants; None where nothing wraps."""


def _operation(name: str) -> Callable[["Lanes", "Lanes | int"], "Lanes"]:
    return lambda one, other: one.with_value(getattr(one.builder, name)(one.value, one.like(other)))


def _comparison(sign: str) -> Callable[["Lanes", "Lanes | int"], "Lanes"]:
    return lambda one, other: one.with_value(one.builder.icmp_signed(sign, one.value, one.like(other)))


class Lanes:
    """A number, or a truth, of every lane of a chunk."""

    def __init__(self, builder: ir.IRBuilder, value: ir.Value) -> None:
        self.builder, self.value = builder, value

    def with_value(self, value: ir.Value) -> "Lanes":
        """Return other lanes of the same kernel."""
        return Lanes(self.builder, value)

    def like(self, other: "Lanes | int") -> ir.Value:
        """Return what is combined with these lanes, in their type: an integer in every lane, a truth as 0 or 1."""
        if not isinstance(other, Lanes):
            return ir.Constant(self.value.type, [other] * LANES)
        wide, narrow = self.value.type, other.value.type
        if narrow == wide:
            return other.value
        return (self.builder.zext if narrow.element == BIT else self.builder.sext)(other.value, wide)

    __add__, __sub__, __mul__ = _operation("add"), _operation("sub"), _operation("mul")
    __and__, __or__, __xor__ = _operation("and_"), _operation("or_"), _operation("xor")
    __lshift__, __rshift__ = _operation("shl"), _operation("ashr")
    __lt__, __gt__ = _comparison("<"), _comparison(">")
    __eq__ = _comparison("==")  # type: ignore[assignment]
    __ne__ = _comparison("!=")  # type: ignore[assignment]

    def __neg__(self) -> "Lanes":
        return self.with_value(self.builder.neg(self.value))


def where(mask: Lanes, one: Lanes | int, other: Lanes) -> Lanes:
    """Return lanes of one where the mask is set, else of the other."""
    return other.with_value(other.builder.select(mask.value, other.like(one), other.value))


def short(lanes: Lanes) -> Lanes:
    """Return lanes that are within the bits of a factor; LLVM, which is told that, multiplies two of them faster."""
    if lanes.value.type.element.width > 32:
        return lanes
    factor = ir.VectorType(ir.IntType(FACTOR_BITS), LANES)
    return lanes.with_value(lanes.builder.sext(lanes.builder.trunc(lanes.value, factor), lanes.value.type))


def before(lanes: Lanes, many: int) -> Lanes:
    """Return the first ``many`` bits of each lane as a number."""
    kind = lanes.value.type
    by = ir.Constant(kind, [kind.element.width - many] * LANES)
    return lanes.with_value(lanes.builder.lshr(lanes.value, by))


def halves(place: "Place", widths: Given) -> Ends:
    """Return the pair :class:`hw_model.engine.layout.Widths`; the usual one, in 32 bits, is known beforehand.

    Without widths, an empty tuple, nothing wraps.
    """
    if not widths.type.elements:
        return None, None
    return USUAL_WIDTHS if place.width == 32 else [place.each(widths, number) for number in range(2)]


def put(place: "Place", mask: Lanes, numbers: Lanes) -> Given:
    """Put the numbers of the lanes that are set at a place, side by side; return how many there are.

    The place has room for all lanes.
    """
    vector, builder = numbers.value.type, numbers.builder
    if not compresses():
        return _put_each(place, mask, numbers)
    kind = ir.FunctionType(vector, [vector, mask.value.type, vector])
    name = f"llvm.experimental.vector.compress.v{LANES}i{place.width}"
    compress = cgutils.get_or_insert_function(builder.module, kind, name)
    found = builder.call(compress, [numbers.value, mask.value, ir.Constant(vector, ir.Undefined)])
    place[0] = numbers.with_value(found)
    return count(mask)


def _put_each(place: "Place", mask: Lanes, numbers: Lanes) -> Given:
    """Put one number after the other: mostly there are few, and LLVM would move every lane."""
    builder, every = place.builder, held(numbers)
    left = cgutils.alloca_once_value(builder, bits(mask))
    with cgutils.for_range(builder, count(mask)) as loop:
        now = builder.load(left)
        place.put_one(loop.index, every.one(builder.cttz(now, BIT(1))))
        builder.store(builder.and_(now, builder.sub(now, COUNT(1))), left)
    return count(mask)


def put_numbers(place: "Place", mask: Lanes, first: Given) -> Given:
    """Put which lanes are set at a place, side by side, counted from ``first``; return how many there are.

    The place has room for all lanes.
    """
    if compresses():
        return put(place, mask, place.each(first) + place.numbers())
    builder, found, many = place.builder, bits(mask), COUNT(0)
    for low in range(0, LANES, EIGHT):
        byte = builder.and_(builder.lshr(found, COUNT(low)), COUNT(255))
        place.put_bytes(many, builder.load(builder.gep(_lanes_of_bytes(builder), [COUNT(0), byte])), first, low)
        many = builder.add(many, builder.ctpop(byte))
    return many


@cache
def compresses() -> bool:
    """Tell whether the processor that is compiled for moves chosen lanes side by side at once, as AVX-512 does."""
    features = config.CPU_FEATURES
    if features is None:
        features = "" if config.CPU_NAME == "generic" else get_host_cpu_features().flatten()
    return "+avx512f" in features.split(",")


def _lanes_of_bytes(builder: ir.IRBuilder) -> ir.Value:
    """Return the table of the bits that are set in a byte: their numbers, ascending, in eight bytes."""
    name, module = "lanes_of_bytes", builder.module
    if name not in module.globals:
        of_bytes = (bytes(bit for bit in range(EIGHT) if byte >> bit & 1) for byte in range(256))
        numbers = [int.from_bytes(of_byte, "little") for of_byte in of_bytes]
        table = ir.Constant(ir.ArrayType(ir.IntType(64), 256), numbers)
        made = ir.GlobalVariable(module, table.type, name)
        made.linkage, made.global_constant, made.initializer = "internal", True, table
    return module.globals[name]


def held(lanes: Lanes) -> "Place":
    """Return a place for lanes that change in a loop, which keeps them in registers of the processor."""
    kind = lanes.value.type
    room = lanes.builder.bitcast(cgutils.alloca_once(lanes.builder, kind), kind.element.as_pointer())
    place = Place(lanes.builder, room)
    place[0] = lanes
    return place


def each_row(place: "Place", many: Given) -> Iterator[Given]:
    """Loop over the numbers of several rows: what is done with one, in a kernel, becomes a loop of the machine."""
    with cgutils.for_range(place.builder, many) as loop:
        yield loop.index


def bits(mask: Lanes) -> ir.Value:
    """Return a mask as a number: lane i is bit i."""
    return mask.builder.zext(mask.builder.bitcast(mask.value, ir.IntType(LANES)), COUNT)


@contextmanager
def seldom(mask: Lanes) -> Iterator[None]:
    """Leave out what is inside, which is expected, where no lane of a mask is set."""
    with mask.builder.if_then(mask.builder.icmp_unsigned("!=", bits(mask), COUNT(0)), likely=False):
        yield


def first_lanes(mask: Lanes, many: Given) -> Lanes:
    """Return a mask without the lanes from number ``many`` on, above 0, of which there may be none."""
    builder = mask.builder
    beyond = builder.sub(COUNT(LANES), builder.trunc(many, COUNT))
    beyond = builder.select(builder.icmp_signed(">", beyond, COUNT(0)), beyond, COUNT(0))
    kept = builder.and_(bits(mask), builder.lshr(COUNT((1 << LANES) - 1), beyond))
    return mask.with_value(builder.bitcast(builder.trunc(kept, ir.IntType(LANES)), mask.value.type))


def mask_of(place: "Place", number: Given) -> Lanes:
    """Return the mask that a number is."""
    builder = place.numbers().builder
    return Lanes(builder, builder.bitcast(builder.trunc(number, ir.IntType(LANES)), ir.VectorType(BIT, LANES)))


def count(mask: Lanes) -> ir.Value:
    """Return in how many lanes a mask is set."""
    return mask.builder.ctpop(bits(mask))


class Place:
    """Vectors of an array from an element on, by number: fields of a chunk, or a row's charges."""

    def __init__(self, builder: ir.IRBuilder, first: ir.Value, row_bytes: ir.Value = None) -> None:
        self.builder, self._first, self._row_bytes = builder, first, row_bytes

    def _at(self, field: int) -> ir.Value:
        address = self.builder.gep(self._first, [ir.Constant(ir.IntType(64), field * LANES)])
        return self.builder.bitcast(address, ir.VectorType(self._first.type.pointee, LANES).as_pointer())

    def __getitem__(self, field: int) -> Lanes:
        return Lanes(self.builder, self.builder.load(self._at(field), align=max(1, self.width // 8)))

    def __setitem__(self, field: int, lanes: Lanes | int) -> None:
        vector = ir.VectorType(self._first.type.pointee, LANES)
        value = lanes.value if isinstance(lanes, Lanes) else ir.Constant(vector, [lanes] * LANES)
        self.builder.store(value, self._at(field), align=max(1, self.width // 8))

    def each(self, given: Given, number: int | None = None) -> Lanes:
        """Return a number, or one of a pair, in each lane."""
        vector = ir.VectorType(self._first.type.pointee, LANES)
        value = given if number is None else self.builder.extract_value(given, number)
        if value.type != vector.element:
            value = self.builder.trunc(value, vector.element)
        one = self.builder.insert_element(ir.Constant(vector, ir.Undefined), value, COUNT(0))
        first = ir.Constant(ir.VectorType(COUNT, LANES), [0] * LANES)
        return Lanes(self.builder, self.builder.shuffle_vector(one, one, first))

    def one(self, lane: Given) -> ir.Value:
        """Return the number of one lane."""
        return self.builder.load(self.builder.gep(self._first, [lane]))

    def put_one(self, lane: Given, number: ir.Value) -> None:
        """Put the number of one lane."""
        self.builder.store(number, self.builder.gep(self._first, [lane]))

    def put_bytes(self, number: Given, eight: ir.Value, first: Given, more: int) -> None:
        """Put eight bytes as numbers from element ``number`` on, each with ``first`` and ``more`` added."""
        builder, element = self.builder, self._first.type.pointee
        vector = ir.VectorType(element, EIGHT)
        start = builder.add(builder.trunc(first, element), ir.Constant(element, more))
        one = builder.insert_element(ir.Constant(vector, ir.Undefined), start, COUNT(0))
        every = builder.shuffle_vector(one, one, ir.Constant(ir.VectorType(COUNT, EIGHT), [0] * EIGHT))
        found = builder.zext(builder.bitcast(eight, ir.VectorType(ir.IntType(8), EIGHT)), vector)
        at = builder.bitcast(builder.gep(self._first, [number]), vector.as_pointer())
        builder.store(builder.add(found, every), at, align=max(1, self.width // 8))

    def numbers(self) -> Lanes:
        """Return the number of each lane."""
        return Lanes(self.builder, ir.Constant(ir.VectorType(self._first.type.pointee, LANES), list(range(LANES))))

    def after(self, fields: int) -> "Place":
        """Return the place that many fields on."""
        return Place(self.builder, self.builder.gep(self._first, [ir.Constant(ir.IntType(64), fields * LANES)]))

    def row(self, number: Given) -> "Place":
        """Return the place that many rows of the array on."""
        first = self.builder.bitcast(self._first, cgutils.voidptr_t)
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


def kernel(given: str, returns: int) -> Callable[[Callable[..., Any]], Any]:
    """Make a function over places one that compiled loops call with what is ``given``, names with commas.

    A place is given as an array and the index of its first element; all else goes to the function as it is. It returns
    ``returns`` 32-bit numbers.
    """
    names = [Parameter(name.strip(), Parameter.POSITIONAL_ONLY) for name in f"typing, {given}".split(",")]

    def made(function: Callable[..., Any]) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            given, rest = [], list(zip(signature.args, values, strict=True))
            while rest:
                kind, value = rest.pop(0)
                if isinstance(kind, types.Array):
                    indices = [context.cast(builder, at, typ, types.intp) for typ, at in rest[: kind.ndim]]
                    del rest[: kind.ndim]
                    array = context.make_array(kind)(context, builder, value)
                    first = cgutils.get_item_pointer(context, builder, kind, array, indices)
                    value = Place(builder, first, cgutils.unpack_tuple(builder, array.strides)[0])
                given.append(value)
            found = function(*given)
            return context.make_tuple(builder, signature.return_type, found) if returns else context.get_dummy_value()

        def typed(typing: Any, *kinds: Any) -> Any:
            found = types.UniTuple(types.int32, returns) if returns else types.void  # type: ignore[attr-defined]
            return found(*kinds), generate

        typed.__name__, typed.__signature__ = function.__name__, Signature(names)  # type: ignore[attr-defined]
        return intrinsic(typed)

    return made
