"""Inner kernels as bitcode: only kernels that Python calls are optimised as a whole and become machine code.

numba optimises each function together with its callees and makes machine code of it before it links it into its
callers, where both are done again. For functions that only kernels call neither result is used. Without this module
first use takes 1.27 times the processor time (58.4 s for 46.0 s, 174 kernels). It replaces a private class of numba, so
the versions of numba are bounded in `pyproject.toml`.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

from numba.core.codegen import JITCodeLibrary

WRAPPERS = ("_ZN7cpython", "cfunc.")
"""prefixes of the names of functions that Python or C calls"""


class KernelCode(JITCodeLibrary):
    """A code library that makes machine code at the first request for a pointer to a function that Python calls."""

    _is_machine_code = False

    def _optimize_final_module(self) -> None:
        """Do nothing: the module of the caller is optimised as a whole."""

    def _finalize_final_module(self) -> None:
        if getattr(self, "_compiled_object", None) is not None:  # loaded from disk
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
        """Return the address of a function that Python calls, 0 for any other."""
        self._ensure_finalized()
        if not self._is_machine_code:
            if not name.startswith(WRAPPERS) or all(name != f.name for f in self.get_defined_functions()):
                return 0
            # other kernels link what was there before; here what Python does not call is made private, so that LLVM
            # passes on only the arguments that are used (of an array seven, of a hierarchy and a workspace 200)
            if self._get_module_for_linking() is self._final_module:
                self._shared_module = self._final_module.clone()
            for function in self._final_module.functions:
                if not function.is_declaration and not function.name.startswith(WRAPPERS):
                    function.linkage = "private"
            super()._optimize_final_module()
            self._make_machine_code()
        return super().get_pointer_to_function(name)

    @property
    def codegen(self) -> Any:
        """numba's code generator; for bitcode a stand-in, since bitcode has no place for an environment."""
        return super().codegen if self._is_machine_code else SimpleNamespace(set_env=lambda name, environment: None)

    def serialize_using_object_code(self) -> Any:
        """Return machine code and bitcode, or bitcode alone."""
        return super().serialize_using_object_code() if self._is_machine_code else self.serialize_using_bitcode()


@contextlib.contextmanager
def kernel_code(target_context: Any) -> Iterator[None]:
    """Compile and load `KernelCode` in a `with` block; the caller holds numba's compiler lock."""
    codegen = target_context.codegen()
    before = codegen._library_class
    codegen._library_class = KernelCode
    try:
        yield
    finally:
        codegen._library_class = before
