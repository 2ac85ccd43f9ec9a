# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
``jit``, ``kernel``, ``reducing_kernel``: compile with Numba if it is installed, else interpret.

A kernel is plain Python over scalars and preallocated arrays, so both ways give the same numbers;
interpreted, it is some hundred times slower. ``NUMBA_DISABLE_JIT=1`` selects the interpreter.

Numba optimises each function with all that it calls, and generates machine code for each. Here
that happens only for the kernels that Python calls: a kernel that is called by another one is
compiled a second time as a part of it, and LLVM sees it first when the whole is complete. All
kernels together are compiled in half of the time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import functools
import sys
import threading
from typing import Any, cast, TypeVar
import warnings

import numpy as np

from .kernel_cache import KernelCache

try:
    import numba
    import numba.core.event
except ImportError:
    numba = None

Function = TypeVar('Function', bound=Callable[..., Any])

COMPILED = numba is not None and not numba.config.DISABLE_JIT

# Division by zero gives inf or NaN, as in C, and the kernels check their results: raising would
# cost a branch per division. No fast maths: interpreted and compiled code give the same bits.
# Nothing calls a kernel from C.
_OPTIONS: dict[str, Any] = {'error_model': 'numpy', 'nogil': True, 'no_cfunc_wrapper': True}

# Calls from Python compile a kernel that is not there yet; otherwise they interpret it.
_only_modules: tuple[str, ...] = ('',)
_only_thread: int | None = None


def jit(function: Function) -> Function:
    """Compile a function on its first call, and cache the result on disk."""
    return _compiled(function, **_OPTIONS)


def kernel(function: Function) -> Function:
    """
    Compile as ``jit`` does a function that allocates nothing; an allocation is an error.

    Compiled without Numba's reference counting, which costs a fifth of the minimal solver's time.
    """
    return _compiled(function, **_OPTIONS, _nrt=False)


def reducing_kernel(function: Function) -> Function:
    """
    Compile as ``kernel`` does a function whose sums may be reordered, so that they vectorise.

    The exception to equal bits: the order of a sum, and so its rounding, depends on the machine.
    """
    return _compiled(function, **_OPTIONS, _nrt=False, fastmath={'reassoc', 'contract', 'nsz'})


def inlined(function: Function) -> Function:
    """
    Compile as ``kernel`` does a function that LLVM always inlines.

    LLVM vectorises a loop only if nothing is called in it. Other than a ``part_of_kernel``, the
    function is typed once, whatever the number of calls.
    """
    return _compiled(function, **_OPTIONS, _nrt=False, forceinline=True)


def vectorised_kernel(function: Function) -> Function:
    """
    Compile as ``kernel`` does a hot loop over columns, which LLVM vectorises by itself.

    As a part of a large function it might unroll the loop instead, which is slower by half.
    """
    return _compiled(function, _by_itself=True, **_OPTIONS, _nrt=False)


def part_of_kernel(function: Function) -> Function:
    """
    Mark a function that one kernel calls, in one place, or that is a few lines: it is copied.

    A function of its own costs types, code and calls.
    """
    return _compiled(function, **_OPTIONS, inline='always')


def compile_only(modules: tuple[str, ...]) -> None:
    """From now on, interpret all kernels but those of modules with these beginnings."""
    global _only_modules
    _only_modules = modules


@contextmanager
def others_interpret() -> Iterator[None]:
    """Compile in this thread; meanwhile, others interpret the kernels that are not there yet."""
    global _only_thread
    _only_thread = threading.get_ident()
    try:
        yield
    finally:
        _only_thread = None


def _compiled(function: Function, _by_itself: bool = False, **options: Any) -> Function:
    if not COMPILED:
        return _interpreted(function)
    compiled: Any = numba.njit(**options)(function)
    # Numba's own cache checks only the file that a kernel is defined in, and would use a stale
    # copy after a change of a kernel that it calls in another file.
    compiled._cache = KernelCache(function)
    compiled._compile_for_args = functools.partial(_compile_or_interpret, compiled, function)
    if 'inline' not in options:
        # What another kernel calls when it calls this one.
        compiler = _ByItselfCompiler if _by_itself else _CalledCompiler
        called = numba.njit(pipeline_class=compiler, **options)(function)
        compiled.get_call_template = functools.partial(_call_template, called)
        compiled.get_overload = called.get_overload
    return cast(Function, compiled)


def _compile_or_interpret(compiled: Any, function: Function, *arguments: Any) -> Any:
    """Return what to call for these arguments; Numba asks for it before the first call."""
    is_here = _only_thread in (None, threading.get_ident())
    if is_here and function.__module__.startswith(_only_modules):
        return type(compiled)._compile_for_args(compiled, *arguments)
    return _interpreted(function)


def _call_template(called: Any, arguments: tuple[Any, ...], keywords: Any) -> Any:
    """Return the types of a call; a number is any number, not a type of its own."""
    return called.get_call_template(tuple(map(numba.types.unliteral, arguments)), keywords)


def _interpreted(function: Function) -> Function:
    @functools.wraps(function)
    def quiet(*arguments: Any) -> Any:
        # Compiled code makes NaN and infinity without a warning, and the kernels check for them.
        with np.errstate(all='ignore'):
            return function(*arguments)

    return cast(Function, quiet)


if numba is None:
    warnings.warn(
        'numba is not installed: p4pfr_ros runs interpreted, some hundred times slower',
        RuntimeWarning,
        stacklevel=2,
    )
elif COMPILED:
    from numba.core.codegen import JITCodeLibrary
    from numba.core.compiler import CompilerBase, DefaultPassBuilder

    class _CalledCompiler(CompilerBase):  # type: ignore[misc]
        """Compiles a kernel as a part of others: to LLVM's code, without a door for Python."""

        optimises = False

        def define_pipelines(self) -> Any:
            state = self.state
            state.flags.no_cpython_wrapper = True
            state.library = _CalledLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
            state.library.optimises = self.optimises
            return [DefaultPassBuilder.define_nopython_pipeline(state)]

    class _ByItselfCompiler(_CalledCompiler):
        """Compiles a kernel likewise, and optimises it."""

        optimises = True

    class _CalledLibrary(JITCodeLibrary):  # type: ignore[misc]
        """The code of a kernel of which LLVM makes no machine code; mostly not optimised."""

        optimises = False

        @property
        def codegen(self) -> Any:
            return _WithoutEnvironments(self._codegen)

        def get_pointer_to_function(self, _: str) -> int:
            self._ensure_finalized()
            return 0

        def _optimize_functions(self, ll_module: Any) -> None:
            if self.optimises:
                super()._optimize_functions(ll_module)
            ll_module.data_layout = self._codegen._data_layout

        def _optimize_final_module(self) -> None:
            if self.optimises:
                super()._optimize_final_module()

        def _finalize_final_module(self) -> None:
            self._finalize_dynamic_globals()
            self._finalized = True

    class _WithoutEnvironments:
        """Numba's code generator, for functions that are not in memory."""

        def __init__(self, codegen: Any) -> None:
            self._codegen = codegen

        def __getattr__(self, name: str) -> Any:
            return getattr(self._codegen, name)

        def set_env(self, *_: Any) -> None:
            pass

    class _FirstCompilation(numba.core.event.Listener):  # type: ignore[misc]
        """Prints once why the first call takes seconds."""

        printed = False

        def on_start(self, event: Any) -> None:
            name = event.data['dispatcher'].py_func.__module__
            if not self.printed and name.startswith('p4pfr_ros.'):
                self.printed = True
                print(
                    'p4pfr_ros: compiling the numeric kernels for this machine, once; '
                    'some tens of seconds',
                    file=sys.stderr,
                    flush=True,
                )

        def on_end(self, event: Any) -> None:
            pass

    numba.core.event.register('numba:compile', _FirstCompilation())
