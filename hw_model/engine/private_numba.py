"""All that the loops use of numba beyond what its documentation promises, part by part.

Each part says what it buys, as ``docs/research/special-paths.md`` measures it, and what to do when
a release of numba changes it. :mod:`hw_model.engine.usable` looks for what is used here before any
of it is, so that a numba that lacks something is told in a line, and the plain engine plays.

What numba hands over has no types that a checker could see, so that it is ``Any`` here. In its
words, a *dispatcher* is a compiled function with the code of each set of kinds of its arguments, a
*library* is code on its way to the machine, and *typing* and *context* say what kinds arguments
have and how they lie in memory.
"""

import gc
import hashlib
import logging
import os
import pickle
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from inspect import Parameter, Signature
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import typeof
from numba.core import cgutils, event, types
from numba.core.caching import IndexDataCacheFile
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.runtime import rtsys
from numba.core.typing.templates import AttributeTemplate
from numba.extending import (
    NativeValue,
    infer_getattr,
    intrinsic,
    lower_getattr_generic,
    models,
    register_model,
    typeof_impl,
    unbox,
)
from numba.np.numpy_support import from_dtype

from hw_model.engine.ahead import compiled_ahead
from hw_model.engine.lanes import COUNT, Lanes, Place
from hw_model.engine.packed import Packed, is_record

_log = logging.getLogger("locsnn")

# Options of njit that are not documented. If numba no longer has one, take it out: loops do the
# same without it, and are slower.

WITHOUT_RUNTIME = {"_nrt": False, "no_cfunc_wrapper": True}
"""Without its runtime (nrt) loops count no references to arrays, which would take a locked
instruction each and most of the time of short loops; nor can they make any. A wrapper for C would
be compiled for nobody."""
WITH_RUNTIME = {"_nrt": True, "no_cfunc_wrapper": True, "pipeline_class": Compiler}
NOT_FROM_PYTHON = {"no_cpython_wrapper": True}
"""Half a second of compiling for a function of many arrays that only compiled ones call."""


# Compilers. Numba's own does the same, and takes longer: take the classes out of `OF_A_WHOLE` and
# `OF_A_PART`. The second is of code that others take in, which numba optimises at each level that
# takes it in.


class _Part(JITCodeLibrary):  # type: ignore[misc]
    """Code that only others take in.

    With theirs it is optimised and made machine code, once, not at each level.
    """

    # Numba tells loaded machine code of its environment; of a part, none is loaded.
    codegen = SimpleNamespace(set_env=lambda *_: None)

    def finalize(self) -> None:
        """Link in what this code calls, and neither optimise it nor make machine code."""
        for library in dict.fromkeys(self._linking_libraries):
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Return no address: nobody calls this code by one."""
        self._ensure_finalized()
        return 0


NEVER_NEEDED = ("InlineClosureLikes", "InlineInlinables", "InlineOverloads", "NopythonRewrites")
"""Steps of numba that look for what no loop has: closures, functions to be written out before
they are compiled, and sums of whole arrays."""


class _WholeCompiler(Compiler):  # type: ignore[misc]
    """Numba's compiler without the steps that no loop needs."""

    def define_pipelines(self) -> Any:
        """Return the steps that are left."""
        managers = super().define_pipelines()
        for manager in managers:
            manager.passes = [
                step for step in manager.passes if step[0].__name__ not in NEVER_NEEDED
            ]
        return managers


class _PartCompiler(_WholeCompiler):
    """The same, which puts what it makes into a :class:`_Part`."""

    def define_pipelines(self) -> Any:
        """Return the steps; they write to the library that the state has."""
        self.state.library = _Part(self.state.targetctx.codegen(), self.state.func_id.func_qualname)
        return super().define_pipelines()


OF_A_WHOLE = {"pipeline_class": _WholeCompiler}
OF_A_PART = NOT_FROM_PYTHON | {"pipeline_class": _PartCompiler}


# The cache of compiled code. `numba.njit(cache=True)` alone keeps code too, but does not see that a
# function of another file has changed, crashes on a damaged file, and loads a compiler with every
# loop: 0.2 s of each command.

DIGEST_BYTES = hashlib.sha256().digest_size
"""The checksum that stands behind the code in a file."""


def keep_in(dispatcher: Any, module: str, stamp: object) -> None:
    """Let the cache of a function of ``module`` hold its code while the stamp of all loops stays."""
    cache = dispatcher._cache
    # The cache looks at the age of the function's own file, but its code holds that of what it
    # calls elsewhere too.
    own_stamp = cache._impl.locator.get_source_stamp()
    base = cache._impl.filename_base
    cache._cache_file = _CheckedFile(cache._cache_path, base, (own_stamp, stamp))
    cache.load_overload = partial(_load, cache, module)
    cache.save_overload = partial(_save, cache)


def is_missing(dispatcher: Any) -> bool:
    """Tell whether a function has a cache, which holds no code of it for any kinds of arguments."""
    cache_file = getattr(dispatcher._cache, "_cache_file", None)
    if cache_file is None:
        return False
    try:
        return not cache_file._load_index()
    except Exception:  # as where it is loaded: what is damaged raises whatever it likes
        return True


class _CheckedFile(IndexDataCacheFile):  # type: ignore[misc]
    """The compiled code of a function on disk, with checksums.

    To run code with a wrong byte would end in a crash. Files are damaged by a power cut, or in an
    image that was copied in part. What is damaged is dropped, and the function is compiled anew.
    """

    def load(self, key: Any) -> Any:
        """Return the code of an entry; None where there is none, or where it is damaged."""
        try:
            return super().load(key)
        except Exception as error:  # unpickling what is damaged raises whatever it likes
            name = self._index_name.removesuffix(".nbi")
            _log.info("compiled code of %s is damaged, and is dropped: %s", name, error)
            with suppress(OSError):
                os.unlink(self._index_path)
            return None

    def _load_data(self, name: str) -> Any:
        content = Path(self._data_path(name)).read_bytes()
        code = content[:-DIGEST_BYTES]
        digest = content[-DIGEST_BYTES:]
        if hashlib.sha256(code).digest() != digest:
            raise ValueError("its checksum differs")
        return pickle.loads(code)

    def _save_data(self, name: str, data: Any) -> None:
        code = self._dump(data)
        with self._open_for_write(self._data_path(name)) as file:
            file.write(code + hashlib.sha256(code).digest())


def _load(cache: Any, module: str, signature: Any, target: Any) -> Any:
    """Return code from a cache, or None.

    Numba's own way loads first all that only compiling needs, for a fifth of a second.
    """
    rtsys.initialize(target)
    code = cache._load_overload(signature, target)
    if code is None and compiled_ahead(module):
        # Another process has compiled it meanwhile.
        code = cache._load_overload(signature, target)
    return code


def _save(cache: Any, signature: Any, code: Any) -> None:
    """Keep code in a cache, if there is room for it: to compile it again is better than to stop."""
    try:
        cache._save_overload(signature, code)
    except OSError as error:
        _log.info("compiled code is not kept: %s", error)


class _Announce(event.Listener):  # type: ignore[misc]
    """Log that loops are being compiled, which takes seconds, and how long it took.

    It happens once a machine. A function that calls others is compiled while these are: only the
    outermost is told.
    """

    _depth = 0
    _begun_seconds = 0.0

    def on_start(self, event: Any) -> None:
        if self._depth == 0:
            self._begun_seconds = time.perf_counter()
            module = event.data["dispatcher"].py_func.__module__
            _log.info("compiling %s for this machine, once", module)
        self._depth += 1

    def on_end(self, event: Any) -> None:
        self._depth -= 1
        if self._depth == 0:
            _log.info("compiled in %.1f s", time.perf_counter() - self._begun_seconds)


event.register("numba:compile", _Announce())


# A way in without looking at arguments, and calls by address. Without the first a session plays
# rows 4.7 times slower: `entry` in `compiled.py` may return the function itself. Without the second
# the tile is compiled into two loops.


def code_of(function: Any, kinds: tuple[Any, ...]) -> Callable[..., Any]:
    """Return the machine code of a compiled function for arguments of these kinds.

    It does not look at them.
    """
    with _no_garbage_collected():
        code: Callable[..., Any] = function.compile(kinds)
    return code


def address_of(function: Any, kinds: tuple[Any, ...]) -> np.int64:
    """Return where the machine code of a function for arguments of these kinds begins."""
    with _no_garbage_collected():
        function.compile(kinds)
    overload = function.overloads[kinds]
    return np.int64(overload.library.get_pointer_to_function(overload.fndesc.llvm_func_name))


@contextmanager
def _no_garbage_collected() -> Iterator[None]:
    """Compile without looking for garbage, which finds next to none and takes a twentieth of the time."""
    if not gc.isenabled():
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


@intrinsic  # type: ignore[untyped-decorator]
def call_at(typing: Any, address: Any, arguments: Any) -> Any:
    """Call a function at its :func:`address_of` with a tuple of arguments; it returns an integer.

    They must be of the kinds that the address was asked for: others would be read as if they were.
    """

    def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        address_value, tuple_value = given
        kinds = arguments.types
        convention = context.call_conv
        code_type = convention.get_function_type(types.int64, kinds)
        code = builder.inttoptr(address_value, code_type.as_pointer())
        values = cgutils.unpack_tuple(builder, tuple_value, len(kinds))
        _, returned = convention.call_function(builder, code, types.int64, kinds, values)
        return returned

    return types.int64(address, arguments), generate


# Records by address, `hw_model.engine.packed`. Without them each array is an argument of its own:
# with nothing compiled, a command takes twice as long. How an array lies in memory is not
# documented, the rest is.


WORD = ir.IntType(64)
DIGITS = 8
"""Of the checksum that tells kinds of records with one name apart."""


class _Field(NamedTuple):
    """A field of a :class:`_Record`: where it begins, in words, its kind, and whether that is an address."""

    word: int
    kind: Any
    is_address: bool


class _Record(types.Type):
    """The kind of a :class:`hw_model.engine.packed.Packed`."""

    def __init__(self, name: str, fields: dict[str, _Field]) -> None:
        self.fields = fields
        described = ", ".join(f"{field}: {place.kind}" for field, place in fields.items())
        super().__init__(name=f"{name}({described})")
        digest = hashlib.sha256(described.encode()).hexdigest()
        self._short = f"{name}.{digest[:DIGITS]}"

    @property
    def mangling_args(self) -> tuple[str, tuple[Any, ...]]:
        """What stands for this kind in names of functions, which occur thousands of times."""
        return self._short, ()


@typeof_impl.register(Packed)  # type: ignore[untyped-decorator]
def _kind_of_packed(packed: Packed[Any], _: Any) -> _Record:
    """Return the kind of a packed record."""
    fields = {field.name: _field(field.value, field.word) for field in packed.fields}
    return _Record(type(packed.record).__name__, fields)


def _field(value: Any, word: int) -> _Field:
    if isinstance(value, Packed):
        return _Field(word, typeof(value), is_address=True)
    if is_record(value):
        return _Field(word, typeof(Packed(value)), is_address=False)
    if isinstance(value, np.ndarray):
        return _Field(word, types.Array(from_dtype(value.dtype), value.ndim, "C"), is_address=False)
    return _Field(word, typeof(value), is_address=False)


@register_model(_Record)
class _RecordModel(models.PrimitiveModel):  # type: ignore[misc]
    """In compiled code a record is the address of its words."""

    def __init__(self, manager: Any, kind: _Record) -> None:
        super().__init__(manager, kind, WORD.as_pointer())


@unbox(_Record)  # type: ignore[untyped-decorator]
def _unbox(kind: _Record, packed: Any, context: Any) -> Any:
    """Read the address of a packed record that Python gives to a loop."""
    api = context.pyapi
    builder = context.builder
    attribute = api.object_getattr_string(packed, "address")
    address = api.long_as_longlong(attribute)
    api.decref(attribute)
    return NativeValue(builder.inttoptr(address, WORD.as_pointer()))


@infer_getattr
class _RecordFields(AttributeTemplate):  # type: ignore[misc]
    """The kinds of the fields of a record."""

    key = _Record

    def generic_resolve(self, record: _Record, name: str) -> Any:
        """Return the kind of a field; None where there is none of this name."""
        return record.fields[name].kind if name in record.fields else None


@lower_getattr_generic(_Record)  # type: ignore[untyped-decorator]
def _read_field(context: Any, builder: Any, record: _Record, address: Any, name: str) -> Any:
    """Read a field of a record."""
    field = record.fields[name]
    kind = field.kind

    def word(number: int, as_type: Any = WORD) -> Any:
        at = builder.gep(address, [WORD(field.word + number)])
        value = builder.load(builder.bitcast(at, as_type.as_pointer()))
        # LLVM may read it again or not, whatever is written meanwhile.
        value.set_metadata("invariant.load", builder.module.add_metadata([]))
        return value

    if isinstance(kind, types.Array):
        data = word(0, context.get_data_type(kind.dtype).as_pointer())
        shape = [word(1 + axis) for axis in range(kind.ndim)]
        return _array(context, builder, kind, data, shape)
    if isinstance(kind, types.BaseTuple):  # type: ignore[attr-defined]
        return context.make_tuple(builder, kind, [word(number) for number in range(len(kind))])
    if not isinstance(kind, _Record):
        return context.cast(builder, word(0), types.int64, kind)
    if field.is_address:
        return word(0, WORD.as_pointer())
    return builder.gep(address, [WORD(field.word)])


def _array(context: Any, builder: Any, kind: Any, data: Any, shape: list[Any]) -> Any:
    """Return an array in C order, which belongs to no one."""
    # Only what compiles loads it, for a fifth of a second.
    from numba.np.arrayobj import populate_array

    array = context.make_array(kind)(context, builder)
    itemsize = WORD(context.get_abi_sizeof(context.get_data_type(kind.dtype)))
    strides = [itemsize]
    for length in shape[:0:-1]:
        strides.insert(0, builder.mul(strides[0], length, flags=("nsw",)))
    populate_array(array, data, shape, strides, itemsize, meminfo=None)
    return array._getvalue()


# Kernels, which write instructions for vectors: `intrinsic` is documented, how an array lies in
# memory is not. LLVM, given loops over lanes, makes slower ones or none: there is no other way to
# write them.


def kernel(given: str, returns: int) -> Callable[[Callable[..., Any]], Any]:
    """Make a function over places one that compiled loops call.

    ``given`` are the names of what they call it with, with commas. A place is given as an array and
    the indices of its first element; all else goes to the function as it is. It returns ``returns``
    32-bit numbers.
    """
    kind = types.void
    if returns:
        kind = types.UniTuple(types.int32, returns)  # type: ignore[attr-defined]

    def made(function: Callable[..., Any]) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            returned = function(*_places(context, builder, signature.args, values))
            if not returns:
                return context.get_dummy_value()
            return context.make_tuple(builder, signature.return_type, returned)

        return _intrinsic(function.__name__, given, lambda kinds: kind(*kinds), generate)

    return made


def _places(context: Any, builder: Any, kinds: Any, values: Any) -> list[Any]:
    """Return what a kernel is given, with each array and its indices as one place."""
    places: list[Any] = []
    # Each array takes as many of what follows it as it has axes: its indices.
    rest = list(zip(kinds, values, strict=True))
    while rest:
        kind, value = rest.pop(0)
        if not isinstance(kind, types.Array):
            places.append(value)
            continue
        indices = [
            context.cast(builder, index, index_kind, types.intp)
            for index_kind, index in rest[: kind.ndim]
        ]
        del rest[: kind.ndim]
        array = context.make_array(kind)(context, builder, value)
        first = cgutils.get_item_pointer(context, builder, kind, array, indices)
        row_bytes = cgutils.unpack_tuple(builder, array.strides)[0]
        places.append(Place(builder, first, row_bytes))
    return places


def of_numbers(given: str, returns: int) -> Callable[[Callable[..., Any]], Any]:
    """Make a function over compartments alone one that compiled loops call.

    ``given`` are the names of what they call it with, with commas. What is given and returned are
    numbers of 32 bits; a truth is returned as 0 or 1.
    """
    kind = types.UniTuple(types.int32, returns)  # type: ignore[attr-defined]

    def made(function: Callable[..., Any]) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            returned = function(*[Lanes(builder, value) for value in values])
            zero = Lanes(builder, ir.Constant(COUNT, 0))
            numbers = [zero.like(number) for number in returned]
            return context.make_tuple(builder, signature.return_type, numbers)

        def signature_of(kinds: tuple[Any, ...]) -> Any:
            return kind(*[types.int32] * len(kinds))

        return _intrinsic(function.__name__, given, signature_of, generate)

    return made


def _intrinsic(
    name: str, given: str, signature: Callable[..., Any], generate: Callable[..., Any]
) -> Any:
    """Return an intrinsic: numba wants its parameters by name, after the context of types.

    It reads the names from the signature of the function, which is written here as ``given`` says.
    """

    def typed(typing: Any, *kinds: Any) -> Any:
        return signature(kinds), generate

    names = f"typing, {given}".split(",")
    parameters = [Parameter(name.strip(), Parameter.POSITIONAL_ONLY) for name in names]
    typed.__name__ = name
    typed.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
    return intrinsic(typed)
