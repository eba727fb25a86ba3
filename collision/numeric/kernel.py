"""Decorators for compiled functions: `kernel` for functions that Python calls, `inner_kernel` for those of kernels.

    @kernel
    def closest(a, b): ...

    @kernel(allocates=True)
    def rows(n):
        return np.empty((n, 3))

A kernel is compiled at its first call (numba, nopython, without the GIL) and kept on disk by `kernel_cache`. Signed
integers and constants count as int64, where numba alone would compile once more for each of them.
"""

from __future__ import annotations

import contextlib
import gc
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from numba.core import event
from numba.core.compiler_lock import global_compiler_lock
from numba.core.errors import NumbaError
from numba.core.registry import CPUDispatcher
from numba.core.sigutils import normalize_signature

from collision.numeric.kernel_cache import KernelCache, config, types
from collision.numeric.kernel_code import kernel_code

_Dispatcher: Any = CPUDispatcher  # numba's own annotations do not name all that it has

_UNCOUNTED = ("NRT required but not enabled", "Only accept returning of array passed")
"""numba's messages about an array that is made where no references are counted"""


def kernel(
    function: Callable[..., Any] | None = None,
    /,
    *,
    allocates: bool = False,
    error_model: str = "numpy",
    **options: Any,
) -> Any:
    """Compile a function that Python calls; a decorator.

    Parameters
    ----------
    allocates: whether the function makes or returns arrays. If not, no references to arrays are counted; counting them
        at every call took two thirds of a collision query.
    error_model: "numpy", division by zero gives inf or NaN, or "python", it raises ZeroDivisionError.
    options: further options of `numba.njit`.

    Raises
    ------
    TypeError: at the first call of a kernel that makes or returns arrays and is not declared to.
    """

    def made(function: Callable[..., Any]) -> Any:
        if config.DISABLE_JIT:
            return function
        settings = {"nopython": True, "nogil": True, "boundscheck": None, "_nrt": allocates, "error_model": error_model}
        settings["forceinline"] = False  # else callees inherit it from their caller
        return _Kernel(function, targetoptions=settings | options)

    return made if function is None else made(function)


def inner_kernel(function: Callable[..., Any] | None = None, /, **options: Any) -> Any:
    """Compile a function that only kernels call: without wrappers for Python, which take a third of the time.

    Takes the parameters of `kernel`. A call from Python raises TypeError.
    """
    return kernel(function, no_cpython_wrapper=True, no_cfunc_wrapper=True, **options)


inline_kernel = partial(inner_kernel, forceinline=True)
"""declares an inner kernel that becomes part of its caller: for those that take many arrays, each passed as seven
numbers"""


class EntryPoint:
    """A kernel of one signature as Python calls it: `entry.call(*arguments)`.

    numba's dispatcher takes 2.4 µs a call to look at the types of two hierarchies and a workspace; the compiled
    function itself takes 0.2 µs to read them. So arguments must always have the same types and layouts.
    """

    __slots__ = ("_kernel", "call")

    def __init__(self, kernel: Any) -> None:
        self._kernel = kernel
        self.call: Callable[..., Any] = self._first

    def _first(self, *arguments: Any) -> Any:
        result = self._kernel(*arguments)
        (compiled,) = self._kernel.overloads.values()
        self.call = compiled.entry_point
        return result


class _Kernel(_Dispatcher):
    """numba's dispatcher with our cache and signatures."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._cache = KernelCache(self.py_func)
        self._is_inner = self.targetoptions.get("no_cpython_wrapper", False)

    def add_overload(self, cres: Any) -> None:
        if self._is_inner:
            self.overloads[tuple(cres.signature.args)] = cres  # known to kernels, not to calls from Python
        else:
            super().add_overload(cres)

    def _compile_for_args(self, *args: Any, **kws: Any) -> Any:
        if self._is_inner:
            raise TypeError(f"{self.__name__} is an inner kernel: only kernels can call it")
        return super()._compile_for_args(*args, **kws)

    def compile(self, sig: Any) -> Any:
        arguments, returns = normalize_signature(sig)
        arguments = tuple(map(_general, arguments))
        if arguments in self.overloads:
            return self.overloads[arguments].entry_point
        wanted = arguments if returns is None else returns(*arguments)
        context = self.targetctx
        with global_compiler_lock, compilation.working(), kernel_code(context), self._cache.locked(wanted, context):
            try:
                entry = super().compile(wanted)
            except NumbaError as error:
                if any(words in str(error) for words in _UNCOUNTED):
                    raise TypeError(f"{self.__name__} makes an array: declare it with allocates=True") from error
                raise
        if not self.targetoptions["_nrt"]:
            _check_no_references(self.overloads[arguments])
        return entry


class Compilation(event.Listener):
    """Number and seconds of the kernels that this process has compiled."""

    def __init__(self) -> None:
        self.kernels = 0
        """kernels compiled by this process"""
        self.announced = False
        """set to True by a progress display, in place of the line on standard error"""
        self.listeners: list[Callable[[bool], None]] = []
        """called with True when `active` begins, with False when it ends"""
        self._depth = 0  # of kernels that call each other
        self._spent = self._began = 0.0

    @property
    def active(self) -> bool:
        """Whether a kernel is being compiled or loaded, or another process compiles it."""
        return self._depth > 0

    @property
    def seconds(self) -> float:
        """Seconds spent on compiling, loading and waiting."""
        return self._spent + (time.monotonic() - self._began if self._depth else 0.0)

    @contextlib.contextmanager
    def working(self) -> Iterator[None]:
        """Count the time of a `with` block, inside which numba's compiler lock is held."""
        outermost = not self._depth
        collecting = outermost and gc.isenabled()
        if outermost:
            self._began = time.monotonic()
            gc.disable()  # collecting took a twelfth of the time and found nothing
            for listener in self.listeners:
                listener(True)
        self._depth += 1
        try:
            yield
        finally:
            self._depth -= 1
            if outermost:
                self._spent += time.monotonic() - self._began
                for listener in self.listeners:
                    listener(False)
            if collecting:
                gc.enable()

    def on_start(self, event: event.Event) -> None:
        """Print at the first kernel why the first call takes long."""
        compiled = event.data["dispatcher"]
        if isinstance(compiled, _Kernel) and not self.announced:
            self.announced = True
            package = compiled.__module__.partition(".")[0]
            print(f"compiling {package} kernels (once; they are kept) ...", file=sys.stderr, flush=True)

    def on_end(self, event: event.Event) -> None:
        """Count a kernel."""
        self.kernels += isinstance(event.data["dispatcher"], _Kernel)


compilation = Compilation()
event.register("numba:compile", compilation)


def _general(kind: Any) -> Any:
    """The type that a kernel is compiled for: int64 for constants and for smaller signed integers."""
    kind = types.unliteral(kind)
    if isinstance(kind, types.Integer) and kind.signed and kind.bitwidth < 64:
        return types.int64
    return kind


def _check_no_references(compiled: Any) -> None:
    """Raise TypeError if a kernel that counts no references returns an array, or calls a kernel that does."""
    name = compiled.fndesc.qualname
    if _holds_array(compiled.signature.return_type):
        raise TypeError(f"{name} returns an array: declare it with allocates=True")
    annotation = compiled.type_annotation
    for expression, signature in getattr(annotation, "calltypes", {}).items():
        called = annotation.typemap[expression.func.name] if getattr(expression, "op", "") == "call" else None
        if isinstance(called, types.Dispatcher) and _holds_array(signature.return_type):
            raise TypeError(f"{name} calls a kernel that returns an array: declare it with allocates=True")


def _holds_array(kind: Any) -> bool:
    return isinstance(kind, types.Array) or (isinstance(kind, types.BaseTuple) and any(map(_holds_array, kind)))
