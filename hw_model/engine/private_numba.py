"""Everything that the loops use of numba beyond its documented interface, in one place.

The sections are: options of njit, compilers, the cache of compiled code, calls of machine code,
records by address, and kernels. The comment above each says what it is worth, as measured in
``docs/research/special-paths.md``, and what to do when a release of numba changes it.
:mod:`hw_model.engine.usable` checks beforehand that a numba has all these parts; if not, a warning
names the missing one, and the plain engine runs.

numba has no type annotations, so its objects are ``Any`` here. In numba's words, a *dispatcher* is
a compiled function with a version of its code for each set of types of arguments; a *library* is
code on its way to becoming machine code; *typing* and *context* know the types of arguments and how
they lie in memory. In ours, a *kind* is a type of numba. A *part* is a function that only other
compiled functions call and that becomes part of them; a *whole* is called from Python or by address.
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

# Options of njit that are not documented. If numba no longer has one, remove it: the loops do the
# same without it, but slower.

WITHOUT_RUNTIME = {"_nrt": False, "no_cfunc_wrapper": True}
"""Without numba's runtime (nrt), loops count no references to arrays. Each count is an atomic
instruction, and in short loops they take most of the time. Without it loops cannot create arrays
either. Nobody calls loops from C, so no wrapper for C is compiled."""
WITH_RUNTIME = {"_nrt": True, "no_cfunc_wrapper": True, "pipeline_class": Compiler}
"""For functions that create arrays. They may have expressions of whole arrays, for which numba's own
compiler has passes that ours leave out."""
NOT_FROM_PYTHON = {"no_cpython_wrapper": True}
"""For functions that only compiled ones call: it saves half a second of compiling for a function
with many arrays."""


# Compilers. numba's own compiles the same code, but takes longer: if they break, remove the classes
# from `OF_A_WHOLE` and `OF_A_PART`. numba's own would optimise a part again in each function that
# it becomes part of, at every level.


class _Part(JITCodeLibrary):  # type: ignore[misc]
    """The code of a part: a function that becomes part of other compiled functions.

    It is optimised and turned into machine code only with the outermost function, once.
    """

    # numba sets an "environment" in machine code after loading it. A part has none: do nothing.
    codegen = SimpleNamespace(set_env=lambda *_: None)

    def finalize(self) -> None:
        """Link the functions that this code calls, and leave out what numba does next: to optimise and to compile."""
        # `dict.fromkeys` removes duplicates and keeps the order.
        for library in dict.fromkeys(self._linking_libraries):
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Return 0: this code has no address, and nobody calls it by one."""
        self._ensure_finalized()
        return 0


NEVER_NEEDED = ("InlineClosureLikes", "InlineInlinables", "InlineOverloads", "NopythonRewrites")
"""Passes of numba that look for what our loops do not contain: closures, functions that are inlined
as source, and expressions of whole arrays."""


class _WholeCompiler(Compiler):  # type: ignore[misc]
    """numba's compiler without the passes that no loop needs."""

    def define_pipelines(self) -> Any:
        """Return numba's pipelines without the passes of :data:`NEVER_NEEDED`."""
        managers = super().define_pipelines()
        for manager in managers:
            manager.passes = [
                step for step in manager.passes if step[0].__name__ not in NEVER_NEEDED
            ]
        return managers


class _PartCompiler(_WholeCompiler):
    """The same compiler, which writes its code to a :class:`_Part`."""

    def define_pipelines(self) -> Any:
        """Set the library to which the passes write, and return the pipelines."""
        self.state.library = _Part(self.state.targetctx.codegen(), self.state.func_id.func_qualname)
        return super().define_pipelines()


OF_A_WHOLE = {"pipeline_class": _WholeCompiler}
OF_A_PART = NOT_FROM_PYTHON | {"pipeline_class": _PartCompiler}


# The cache of compiled code. `numba.njit(cache=True)` alone has a cache too, but it does not notice
# when a function in another file has changed, it crashes on a damaged file, and it imports the
# compiler to load a loop, which takes 0.2 s of each command.

DIGEST_BYTES = hashlib.sha256().digest_size
"""The size of the checksum at the end of each file of code."""


def keep_in(dispatcher: Any, module: str, stamp: object) -> None:
    """Make the cache of a function of ``module`` valid until ``stamp`` changes, and check its files for damage.

    ``stamp`` is the age of all files with loops. numba only looks at the file of the function itself, but the
    compiled code also contains functions from other files.
    """
    cache = dispatcher._cache
    own_stamp = cache._impl.locator.get_source_stamp()
    base = cache._impl.filename_base
    cache._cache_file = _CheckedFile(cache._cache_path, base, (own_stamp, stamp))
    cache.load_overload = partial(_load, cache, module)
    cache.save_overload = partial(_save, cache)


def is_missing(dispatcher: Any) -> bool:
    """Return whether a function has a cache, but no code in it for any arguments."""
    cache_file = getattr(dispatcher._cache, "_cache_file", None)
    if cache_file is None:
        return False
    try:
        return not cache_file._load_index()
    except Exception:  # unpickling a damaged file may raise anything
        return True


class _CheckedFile(IndexDataCacheFile):  # type: ignore[misc]
    """The compiled code of a function on disk, with checksums.

    Running code with a wrong byte would crash. Files get damaged by a power cut, or in an image that
    was copied only in part. Damaged code is deleted, and the function is compiled again.
    """

    def load(self, key: Any) -> Any:
        """Return the code of an entry, or None if there is none or it is damaged."""
        try:
            return super().load(key)
        except Exception as error:  # unpickling a damaged file may raise anything
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
    """Return the code for a signature from a cache, or None if it must be compiled.

    It replaces a method of numba that first imports everything that only compiling needs, which takes a
    fifth of a second.
    """
    # The runtime of numba, on which loaded code relies.
    rtsys.initialize(target)
    code = cache._load_overload(signature, target)
    if code is None and compiled_ahead(module):
        # A helper process has compiled it in the meantime.
        code = cache._load_overload(signature, target)
    return code


def _save(cache: Any, signature: Any, code: Any) -> None:
    """Write code to a cache. If that fails, as on a full disk, it will be compiled again: no reason to stop."""
    try:
        cache._save_overload(signature, code)
    except OSError as error:
        _log.info("compiled code is not kept: %s", error)


class _Announce(event.Listener):  # type: ignore[misc]
    """Log that loops are being compiled, and how long it took: it takes seconds, once per machine.

    A function is being compiled while those that it calls are compiled: only the outermost is logged.
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


# Calls of machine code: from Python without a check of arguments, and from compiled code by address.
# Without the first, a session plays single rows 4.7 times slower; if it breaks, `entry` in
# `compiled.py` may return the function itself. Without the second, the tile is compiled twice, as
# part of two loops.


def code_of(function: Any, kinds: tuple[Any, ...]) -> Callable[..., Any]:
    """Return the machine code of a function for arguments of these kinds, as a callable that does not check them."""
    with _no_garbage_collected():
        code: Callable[..., Any] = function.compile(kinds)
    return code


def address_of(function: Any, kinds: tuple[Any, ...]) -> np.int64:
    """Return the address of the machine code of a function for arguments of these kinds."""
    with _no_garbage_collected():
        function.compile(kinds)
    overload = function.overloads[kinds]
    return np.int64(overload.library.get_pointer_to_function(overload.fndesc.llvm_func_name))


@contextmanager
def _no_garbage_collected() -> Iterator[None]:
    """Switch the garbage collector off while compiling: it finds next to nothing, and takes a twentieth of the time."""
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
    """In compiled code, call the function at ``address`` with a tuple of arguments; it returns an integer.

    The arguments must have the kinds for which :func:`address_of` returned the address: nothing checks it.
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


# Records by address, `hw_model.engine.packed`. Without them each array would be an argument of its
# own, and the first command on a machine, which compiles everything, would take twice as long.
# All of this is documented by numba, except how an array lies in memory.


WORD = ir.IntType(64)
DIGITS = 8
"""Digits of the checksum that distinguishes types of records with the same name but other fields."""


class _Field(NamedTuple):
    """A field of a :class:`_Record`: the word at which it begins, its kind, and whether the word is its address."""

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
        """A short name of this type, for the names of compiled functions, which contain the types of all arguments."""
        return self._short, ()


@typeof_impl.register(Packed)  # type: ignore[untyped-decorator]
def _kind_of_packed(packed: Packed[Any], _: Any) -> _Record:
    """Return the kind of a packed record."""
    fields = {field.name: _field(field.value, field.word) for field in packed.fields}
    return _Record(type(packed.record).__name__, fields)


def _field(value: Any, word: int) -> _Field:
    """Return the type of a field from its value. A record in a record lies in place, a packed one is an address."""
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
    """Read the address of a packed record that Python passes to a loop."""
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
        """Return the kind of a field, or None if there is no field of this name."""
        return record.fields[name].kind if name in record.fields else None


@lower_getattr_generic(_Record)  # type: ignore[untyped-decorator]
def _read_field(context: Any, builder: Any, record: _Record, address: Any, name: str) -> Any:
    """Write the instructions that read a field of a record."""
    field = record.fields[name]
    kind = field.kind

    def word(number: int, as_type: Any = WORD) -> Any:
        """Load a word of the field, by its number."""
        at = builder.gep(address, [WORD(field.word + number)])
        value = builder.load(builder.bitcast(at, as_type.as_pointer()))
        # The words never change, so LLVM need not load them again after a store to an array.
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
    """Return an array in C order. `meminfo=None`: numba counts no references to it, as a record keeps it alive."""
    # Imported here, as it takes a fifth of a second, which only processes that compile should spend.
    from numba.np.arrayobj import populate_array

    array = context.make_array(kind)(context, builder)
    itemsize = WORD(context.get_abi_sizeof(context.get_data_type(kind.dtype)))
    strides = [itemsize]
    # From the last axis to the second: each is as far apart as all that lies behind it.
    for length in shape[:0:-1]:
        strides.insert(0, builder.mul(strides[0], length, flags=("nsw",)))
    populate_array(array, data, shape, strides, itemsize, meminfo=None)
    return array._getvalue()


# Kernels, which write vector instructions. `intrinsic` is documented by numba, how an array lies in
# memory is not. From loops over lanes LLVM makes slower vectors or none, so there is no replacement.


def kernel(given: str, returns: int) -> Callable[[Callable[..., Any]], Any]:
    """Decorate a function over places so that compiled loops can call it.

    ``given`` lists the parameters with which a loop calls it, separated by commas. For a place, a loop
    passes an array and the indices of its first element; all other arguments go to the function
    unchanged. It returns ``returns`` 32-bit numbers.
    """
    kind = types.void
    if returns:
        kind = types.UniTuple(types.int32, returns)  # type: ignore[attr-defined]

    def decorate(function: Callable[..., Any]) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            returned = function(*_places(context, builder, signature.args, values))
            if not returns:
                return context.get_dummy_value()
            return context.make_tuple(builder, signature.return_type, returned)

        return _intrinsic(function.__name__, given, lambda kinds: kind(*kinds), generate)

    return decorate


def _places(context: Any, builder: Any, kinds: Any, values: Any) -> list[Any]:
    """Return the arguments of a kernel's function: each array and the indices behind it become one place."""
    places: list[Any] = []
    # An array is followed by as many indices as it has axes.
    arguments = list(zip(kinds, values, strict=True))
    while arguments:
        kind, value = arguments.pop(0)
        if not isinstance(kind, types.Array):
            places.append(value)
            continue
        indices = [
            context.cast(builder, index, index_kind, types.intp)
            for index_kind, index in arguments[: kind.ndim]
        ]
        del arguments[: kind.ndim]
        array = context.make_array(kind)(context, builder, value)
        first = cgutils.get_item_pointer(context, builder, kind, array, indices)
        row_bytes = cgutils.unpack_tuple(builder, array.strides)[0]
        places.append(Place(builder, first, row_bytes))
    return places


def of_numbers(given: str, returns: int) -> Callable[[Callable[..., Any]], Any]:
    """Decorate a function over single compartments so that compiled loops can call it.

    ``given`` lists its parameters, separated by commas. Arguments and results are 32-bit numbers; a
    condition is returned as 0 or 1.
    """
    kind = types.UniTuple(types.int32, returns)  # type: ignore[attr-defined]

    def decorate(function: Callable[..., Any]) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            returned = function(*[Lanes(builder, value) for value in values])
            zero = Lanes(builder, ir.Constant(COUNT, 0))
            numbers = [zero.like(number) for number in returned]
            return context.make_tuple(builder, signature.return_type, numbers)

        def signature_of(kinds: tuple[Any, ...]) -> Any:
            return kind(*[types.int32] * len(kinds))

        return _intrinsic(function.__name__, given, signature_of, generate)

    return decorate


def _intrinsic(
    name: str, given: str, signature: Callable[..., Any], generate: Callable[..., Any]
) -> Any:
    """Return a function of compiled code whose instructions ``generate`` writes.

    numba reads the names of its parameters from the signature of a Python function, after a first
    parameter for the typing context. So a function gets a signature with the names in ``given``.
    """

    def typed(typing: Any, *kinds: Any) -> Any:
        return signature(kinds), generate

    names = f"typing, {given}".split(",")
    parameters = [Parameter(name.strip(), Parameter.POSITIONAL_ONLY) for name in names]
    typed.__name__ = name
    typed.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
    return intrinsic(typed)
