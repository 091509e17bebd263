"""Compile kernels with IEEE division and fixed order of sums, and keep them on disk.

A kernel is compiled for the kernels that call it without what only a call from Python needs: the
wrapper that unpacks its arguments, hundreds of them for a full chain, and machine code of its
own beside the copy in its caller. A call from Python has it compiled with both. Numbers written
out in a call make no version of their own.
"""

import contextlib
import fcntl
import functools
import hashlib
import inspect
import os
import uuid
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, ClassVar

import llvmlite.binding as llvm
from llvmlite import ir
from numba.core import compiler, config
from numba.core.caching import NullCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import CPUDispatcher
from numba.core.serialize import dumps, loads
from numba.core.types import unliteral

from archfrag.kernel_cache import use_kernel_cache

HOME = Path(__file__).resolve().parent.parent


class KernelCache(NullCache):
    """Compiled versions of one kernel: a file for each, named after the types of its arguments.

    Each file appears whole or not at all and names no other file, so that processes may
    write at the same time. A file that is damaged, or is of something else, counts as missing.
    """

    def __init__(self, py_func: Callable, options: dict[str, Any]) -> None:
        file = Path(inspect.getfile(py_func)).resolve()
        self._folder = use_kernel_cache()
        self._paths: dict[Any, Path | None] = {}
        self._name = f"{file.stem}.{py_func.__qualname__}".replace("<locals>", "_")
        if not file.is_file() or py_func.__closure__:
            self._folder = None
            return
        place, made_of = file, tuple(sorted(file.parent.glob("*.py")))
        if file.is_relative_to(HOME):  # the folder's name holds what else it is made of
            place, made_of = file.relative_to(HOME), (file,)
        line = py_func.__code__.co_firstlineno
        self._what = f"{place}:{line} {sorted(options.items())} {_digest_of(made_of)}"

    @property
    def cache_path(self) -> str | None:
        return None if self._folder is None else str(self._folder)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Compiled version for a signature; None if there is none."""
        target_context.refresh()
        path = self.path(sig, target_context)
        content = None if path is None else read_version(path)
        if content is None:
            return None
        what, signature, _, reduced = content
        if what != self._what or signature != sig:
            return None
        return compiler.CompileResult._rebuild(target_context, *reduced)

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a compiled version."""
        path = self.path(sig, data.target_context)
        if path is None or data.library.has_dynamic_globals:
            return
        called = sorted(_Compiled.compiling[-1])
        content = dumps((self._what, sig, called, data._reduce()))
        temporary = path.with_name(f"{path.name}.{uuid.uuid4().hex[:8]}.tmp")
        try:
            temporary.write_bytes(hashlib.sha256(content).digest() + content)
            os.replace(temporary, path)
        except OSError as error:
            with contextlib.suppress(OSError):
                temporary.unlink()
            _warn_once(f"compiled kernels cannot be kept in {self._folder}: {error.strerror}")

    @contextlib.contextmanager
    def claim(self, sig: Any, target_context: Any) -> Iterator[None]:
        """Keep other processes from compiling the same version meanwhile; wait if one does."""
        path = self.path(sig, target_context)
        if path is None or path.exists():
            yield
            return
        lock = path.with_suffix(".lock")
        try:
            file = os.open(lock, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o600)
        except OSError:  # no space or no permission: saving will report it
            yield
            return
        try:
            with contextlib.suppress(OSError):  # without locks at worst it is compiled twice
                fcntl.flock(file, fcntl.LOCK_EX)
            yield
        finally:
            with contextlib.suppress(OSError):
                lock.unlink()
            # Not by closing it alone: a process forked meanwhile has it open too.
            with contextlib.suppress(OSError):
                fcntl.flock(file, fcntl.LOCK_UN)
            os.close(file)

    def path(self, sig: Any, target_context: Any) -> Path | None:
        """File of the version for a signature; None if it cannot be kept."""
        if sig not in self._paths:
            text = str(sig)
            # A function among the arguments is named by its address, which others have later.
            if self._folder is None or " at 0x" in text:
                self._paths[sig] = None
            else:
                key = f"{self._what} {text} {target_context.codegen().magic_tuple()}".encode()
                name = f"{self._name}-{hashlib.sha256(key).hexdigest()[:20]}.kernel"
                self._paths[sig] = self._folder / name
        return self._paths[sig]


def read_version(path: Path) -> tuple[str, Any, list[str], Any] | None:
    """Read the file of a compiled version; None if it is missing or damaged.

    Which kernel with which options, types of the arguments, names of the files of the versions
    that it calls, and numba's result.
    """
    try:
        module_ir = path.read_bytes()
    except OSError:
        return None
    digest, content = module_ir[:32], module_ir[32:]
    return loads(content) if hashlib.sha256(content).digest() == digest else None


@functools.cache
def _digest_of(files: tuple[Path, ...]) -> str:
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()


@functools.cache
def _warn_once(message: str) -> None:
    warnings.warn(message, RuntimeWarning, stacklevel=2)


class _ForLinking(JITCodeLibrary):
    """Code of a kernel that is linked into its callers and optimised only there.

    What is made machine code in its place are the variables in which numba keeps what belongs to
    a function; they are common to a caller's copies.
    """

    def _optimize_final_module(self) -> None:
        """Leave out what nothing uses; addresses of this process, which no file can hold."""
        passes = llvm.create_new_module_pass_manager()
        passes.add_aggressive_dce_pass()
        passes.add_global_dead_code_eliminate_pass()
        passes.run(self._final_module, self._codegen._pass_builder())

    def _finalize_final_module(self) -> None:
        module_ir = self._final_module
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        module = ir.Module(module_ir.name)
        module.triple, module.data_layout = module_ir.triple, module_ir.data_layout
        for variable in module_ir.global_variables:
            if variable.name.startswith("_ZN08NumbaEnv"):
                pointer = ir.IntType(8).as_pointer()
                shared = ir.GlobalVariable(module, pointer, variable.name)
                shared.linkage = "common"
                shared.initializer = ir.Constant(pointer, None)
        self._final_module = llvm.parse_assembly(str(module))
        super()._finalize_final_module()
        self._final_module = module_ir


def _of_many(given: Any) -> bool:
    """Whether a type is a tuple that holds numbers of several runs."""
    entries = getattr(given, "types", ())
    return any(getattr(getattr(entry, "dtype", entry), "lanes", False) for entry in entries)


class _CompilerForLinking(compiler.Compiler):
    def __init__(
        self, typingctx: Any, targetctx: Any, library: Any, args: Any, result: Any, flags: Any,
        *others: Any,
    ) -> None:  # fmt: skip
        if library is None:
            library = _ForLinking(targetctx.codegen(), "kernel")
            library.enable_object_caching()
        # Several runs are stepped by kernels that are called from one place each; a call that
        # passes State and Work writes hundreds of pointers and sizes.
        flags.forceinline = any(map(_of_many, args))
        super().__init__(typingctx, targetctx, library, args, result, flags, *others)


class _Compiled(CPUDispatcher):
    """A numba function with our cache."""

    # Names of the versions that those being compiled now have called so far, the innermost last.
    compiling: ClassVar[list[set[str]]] = []

    def enable_caching(self) -> None:
        self._cache = KernelCache(self.py_func, self.targetoptions)

    def compile(self, sig: Any) -> Any:
        """Compile a version, or take it from the cache, or from whoever compiles it now."""
        with global_compiler_lock:
            path = self._cache.path(sig, self.targetctx)
            if path is not None and self.compiling:
                self.compiling[-1].add(path.name)
            if sig in self.overloads:
                return super().compile(sig)
            self.compiling.append(set())
            try:
                with self._cache.claim(sig, self.targetctx):
                    return super().compile(sig)
            finally:
                self.compiling.pop()


class Kernel(_Compiled):
    """A kernel: called from Python it has a wrapper, called from other kernels it has none."""

    @functools.cached_property
    def inner(self) -> Any:
        """What other kernels call."""
        options = {**self.targetoptions, "no_cpython_wrapper": True}
        return _made(_Compiled, self.py_func, options, _CompilerForLinking)

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """How another kernel calls this one; for any number of a type the version is the same."""
        args = [unliteral(given) for given in args]
        return self.inner.get_call_template(args, {k: unliteral(v) for k, v in kws.items()})

    def get_overload(self, sig: Any) -> Any:
        """What the call of another kernel ends in."""
        return self.inner.get_overload(sig)


def _made(
    kind: type[_Compiled],
    py_func: Callable,
    options: dict[str, Any],
    pipeline: type[compiler.CompilerBase] = compiler.Compiler,
) -> Any:
    made = kind(py_func=py_func, targetoptions=options, pipeline_class=pipeline)
    made.enable_caching()
    return made


def _decorator(**options: Any) -> Callable[[Callable], Any]:
    shared = {"nopython": True, "boundscheck": None, "error_model": "numpy"}

    def decorate(py_func: Callable) -> Any:
        if config.DISABLE_JIT:  # type: ignore[attr-defined]
            return py_func
        return _made(Kernel, py_func, {**shared, "no_cfunc_wrapper": True, **options})

    return decorate


allocating = _decorator(_nrt=True)
# Kernels that make no arrays of their own do without numba's reference counts, which cost more
# than the arithmetic of a short chain: every call counts each array of its arguments up and down.
kernel = _decorator(_nrt=False)
inlined = _decorator(_nrt=False, inline="always")
# LLVM inlines these, not numba. Their arguments hold some hundred arrays, which numba would copy
# at each call and whose types it would infer again: a third of the time to compile.
llvm_inlined = _decorator(_nrt=False, forceinline=True)
