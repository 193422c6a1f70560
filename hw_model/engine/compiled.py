"""Functions compiled by numba, kept in its cache where there is one to write to.

That is the folder that NUMBA_CACHE_DIR names, else the ``__pycache__`` next to the file of the function, else numba's
in the cache folder of the user: the first that can be written. Where none can, every process compiles what it uses.
"""

import hashlib
import logging
import os
import pickle
import time
from collections.abc import Callable
from contextlib import suppress
from functools import lru_cache, partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from hw_model.engine.usable import check_compiled

check_compiled()  # a numba that does not fit would end in an error of its own below, or crash

import llvmlite.binding
import numba
import numpy as np
from numba.core import cgutils, event, types
from numba.core.caching import IndexDataCacheFile
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.runtime import rtsys
from numba.extending import intrinsic

from hw_model.engine.ahead import compiled_ahead

# Many arrays take part in an update; without this the compiler gives up proving that they do not overlap, and the loop
# does not run in vectors.
llvmlite.binding.set_option("hw_model", "-runtime-memory-check-threshold=200")


FOLDERS_OF_LOOPS = ("arithmetic", "engine", "spinnaker", "streaming", "xylo")
"""A change of a file in them compiles the loops anew."""
OPTIONS = {"_nrt": False, "nogil": True, "boundscheck": False, "no_cfunc_wrapper": True}
"""Without its runtime (nrt) loops count no references to arrays, which would take a locked instruction each and most of
the time of short loops; nor can they make any. Nothing asks for the other way in."""

DIGEST_BYTES = hashlib.sha256().digest_size
CHECK_KINDS = "LOCSNN_CHECK_KINDS"
"""Set in the environment, makes every call of an :func:`entry` look at its arguments."""

_log = logging.getLogger("locsnn")


class _Announce(event.Listener):  # type: ignore[misc]
    """Log that loops are being compiled, which takes seconds, and how long it took: it happens once a machine."""

    _depth, _begun = 0, 0.0

    def on_start(self, event: Any) -> None:
        if self._depth == 0:
            self._begun = time.perf_counter()
            _log.info(
                "compiling %s for this machine, once", event.data["dispatcher"].py_func.__module__
            )
        self._depth += 1

    def on_end(self, event: Any) -> None:
        self._depth -= 1
        if self._depth == 0:
            _log.info("compiled in %.1f s", time.perf_counter() - self._begun)


event.register("numba:compile", _Announce())


def compiled(function: Callable[..., Any], **options: Any) -> Any:
    """Compile a function that takes no Python objects and holds no lock: it may run in threads."""
    options = OPTIONS | options
    try:
        dispatcher = numba.njit(cache=True, **options)(function)
    except (
        RuntimeError
    ):  # neither the package's folder nor the user's cache can be written: compile every time
        return numba.njit(**options)(function)
    cache = dispatcher._cache
    # The cache looks at the age of the function's own file, but its code holds that of what it calls elsewhere too.
    stamp = (cache._impl.locator.get_source_stamp(), _stamp_of_loops())
    cache._cache_file = _CheckedFile(cache._cache_path, cache._impl.filename_base, stamp)
    cache.load_overload = partial(_load, cache, function.__module__.rpartition(".")[0])
    cache.save_overload = partial(_save, cache)
    return dispatcher


class _CheckedFile(IndexDataCacheFile):  # type: ignore[misc]
    """The compiled code of a function on disk, with checksums: to run code with a wrong byte would end in a crash.

    Files are damaged by a power cut, or in an image that was copied in part. What is damaged is dropped, and the
    function is compiled anew.
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
        code, digest = content[:-DIGEST_BYTES], content[-DIGEST_BYTES:]
        if hashlib.sha256(code).digest() != digest:
            raise ValueError("its checksum differs")
        return pickle.loads(code)

    def _save_data(self, name: str, data: Any) -> None:
        code = self._dump(data)
        with self._open_for_write(self._data_path(name)) as file:
            file.write(code + hashlib.sha256(code).digest())


compiled_with_arrays = partial(compiled, _nrt=True)
"""Compile a function that makes arrays of its own: it has the runtime, and counts references to them."""
shared = partial(compiled, no_cpython_wrapper=True)
"""Compile a function that others call by :func:`call_at`: once, and not again in each of them."""


class _Part(JITCodeLibrary):  # type: ignore[misc]
    """Code that only others take in: with theirs it is optimised and made machine code, once, not at each level."""

    codegen = SimpleNamespace(set_env=lambda *_: None)

    def finalize(self) -> None:
        for library in dict.fromkeys(self._linking_libraries):
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        self._ensure_finalized()
        return 0


class _PartCompiler(Compiler):  # type: ignore[misc]
    def define_pipelines(self) -> Any:
        self.state.library = _Part(self.state.targetctx.codegen(), self.state.func_id.func_qualname)
        return super().define_pipelines()


def inner(function: Callable[..., Any], **options: Any) -> Any:
    """Compile a function that only other compiled ones call: Python cannot, and what it becomes is kept with theirs."""
    return numba.njit(no_cpython_wrapper=True, pipeline_class=_PartCompiler, **OPTIONS, **options)(
        function
    )


def absorbed(function: Callable[..., Any]) -> Any:
    """Compile a function that its callers take in as machine code: passing many arrays costs more than a short loop."""
    return inner(function, forceinline=True)


def entry(function: Any, *arguments: Any) -> Callable[..., Any]:
    """Return the machine code of a compiled function for arguments of these kinds; it must never be given others.

    A call of the function itself looks at the kind of every array that it is given, which takes longer than a short
    loop. With :data:`CHECK_KINDS` in the environment, as in the tests, it does so: others are then a ``TypeError``.
    """
    kinds = tuple(map(numba.typeof, arguments))
    found: Callable[..., Any] = function.compile(kinds)
    if CHECK_KINDS not in os.environ:
        return found

    named = [*map(_named, kinds)]

    def checked(*given: Any) -> Any:
        for expected, argument in zip(named, given, strict=True):
            if (kind := _named(numba.typeof(argument))) != expected:
                raise TypeError(f"{function.py_func.__name__}: made for {expected}, given {kind}")
        return found(*given)

    return checked


def _named(kind: types.Type) -> str:
    """Return a kind without what does not matter: what is read-only lies in memory as other arrays do."""
    return str(kind).replace("readonly ", "")


def address(function: Any, *arguments: Any) -> np.int64:
    """Return where the machine code of a :func:`shared` function for arguments of these kinds begins."""
    kinds = tuple(numba.typeof(argument) for argument in arguments)
    function.compile(kinds)
    made = function.overloads[kinds]
    return np.int64(made.library.get_pointer_to_function(made.fndesc.llvm_func_name))


@intrinsic  # type: ignore[untyped-decorator]
def call_at(typing: Any, address: Any, arguments: Any) -> Any:
    """Call a shared function at its :func:`address` with a tuple of arguments; it returns an integer.

    They must be of the kinds that the address was asked for: others would be read as if they were.
    """

    def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        kinds, convention = arguments.types, context.call_conv
        code = builder.inttoptr(
            given[0], convention.get_function_type(types.int64, kinds).as_pointer()
        )
        values = cgutils.unpack_tuple(builder, given[1], len(kinds))
        _, returned = convention.call_function(builder, code, types.int64, kinds, values)
        return returned

    return types.int64(address, arguments), generate


_of_one_kind: dict[Any, Callable[..., Any]] = {}


def called(function: Any, *arguments: Any) -> Any:
    """Call a compiled function whose arguments are of the same kinds in every call: only the first looks at them.

    As with :func:`entry`, others would be read as if they were of those kinds.
    """
    code = _of_one_kind.get(function)
    if code is None:
        code = _of_one_kind[function] = entry(function, *arguments)
    return code(*arguments)


def _load(cache: Any, package: str, signature: Any, target: Any) -> Any:
    """Return code from a cache; numba's own way loads first all that only compiling needs, for a fifth of a second."""
    rtsys.initialize(target)
    code = cache._load_overload(signature, target)
    if code is None and compiled_ahead(package):
        code = cache._load_overload(signature, target)
    return code


def _save(cache: Any, signature: Any, code: Any) -> None:
    """Keep code in a cache, if there is room for it: to compile it again is better than to stop."""
    try:
        cache._save_overload(signature, code)
    except OSError as error:
        _log.info("compiled code is not kept: %s", error)


@lru_cache(maxsize=1)
def _stamp_of_loops() -> tuple[tuple[int, int], ...]:
    """Return age and size of every file that may hold compiled loops, or constants of theirs."""
    folders = [Path(__file__).parents[1] / name for name in FOLDERS_OF_LOOPS]
    files = [path.stat() for folder in folders for path in sorted(folder.glob("*.py"))]
    return tuple((file.st_mtime_ns, file.st_size) for file in files)
