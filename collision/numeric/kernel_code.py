"""Code of kernels: optimised and turned into machine code only where Python calls it.

numba optimises each function with all that it calls, and makes machine code of it, before it is linked into its
callers, which then do both again for the whole. Of functions that only kernels call, neither result is ever used.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

from numba.core.codegen import JITCodeLibrary

WRAPPERS = ("_ZN7cpython", "cfunc.")
"""how the names of functions begin that Python or C calls"""


class KernelCode(JITCodeLibrary):
    """numba's code library, that makes machine code when a pointer to a function for Python is asked for."""

    _is_machine_code = False

    def _optimize_final_module(self) -> None:
        """Nothing yet: the caller's module is optimised as a whole."""

    def _finalize_final_module(self) -> None:
        if getattr(self, "_compiled_object", None) is not None:  # it comes from disk
            self._make_machine_code()
            return
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True

    def _make_machine_code(self) -> None:
        self._is_machine_code = True
        self._dynamic_globals.clear()
        super()._finalize_final_module()

    def get_pointer_to_function(self, name: str) -> int:
        """Address of a function that Python calls, 0 for any other."""
        self._ensure_finalized()
        if not self._is_machine_code:
            if not name.startswith(WRAPPERS) or all(name != f.name for f in self.get_defined_functions()):
                return 0
            super()._optimize_final_module()
            self._make_machine_code()
        return super().get_pointer_to_function(name)

    @property
    def codegen(self) -> Any:
        """What the code belongs to; code that is no machine code has no place for its environment."""
        return super().codegen if self._is_machine_code else SimpleNamespace(set_env=lambda name, environment: None)

    def serialize_using_object_code(self) -> Any:
        """Machine code and bitcode, or bitcode alone."""
        return super().serialize_using_object_code() if self._is_machine_code else self.serialize_using_bitcode()


@contextlib.contextmanager
def kernel_code(target_context: Any) -> Iterator[None]:
    """Inside, what is compiled or loaded is `KernelCode`. Hold numba's compiler lock."""
    codegen = target_context.codegen()
    before = codegen._library_class
    codegen._library_class = KernelCode
    try:
        yield
    finally:
        codegen._library_class = before
