"""Compile kernels: each version once by numba, all that a set calls as one module by LLVM."""

import functools
import hashlib
import importlib
import re
from collections.abc import Iterable
from typing import Any, NamedTuple

import llvmlite.binding as llvm
from numba import types
from numba.core.compiler import Flags, compile_extra
from numba.core.registry import cpu_target
from numba.extending import lower_builtin, models, register_model, typeof_impl

from archfrag.physics.kernels import lower
from archfrag.physics.kernels.structs import Source


class Version(NamedTuple):
    """A kernel compiled for some types of arguments, before LLVM sees it."""

    name: str  # in LLVM code
    returned: Any  # numba's type of its result
    described: Any  # numba's description, for callers
    code: str  # LLVM code
    calls: frozenset[str]  # names of versions that it calls
    libraries: list[str]  # LLVM code of numba's own functions that it calls


class _Collected:
    """Replacement of numba's code library; it keeps what numba would link and optimise."""

    def __init__(self, codegen, name: str) -> None:
        self.codegen = codegen
        self.name = name
        self.modules: list[str] = []
        self.libraries: list[str] = []
        self.recorded_timings: dict[str, Any] = {}
        self._reload_init: set[Any] = set()

    def create_ir_module(self, name: str):
        """Make an empty module for numba."""
        return self.codegen.create_library(name).create_ir_module(name)

    def add_ir_module(self, module) -> None:
        """Keep a module that numba has finished."""
        self.modules.append(str(module))

    def add_linking_library(self, library) -> None:
        """Keep the code of numba's own functions that the module calls."""
        assert not library.has_dynamic_globals  # which has numba finish the library
        self.libraries.append(_without_paths(library.get_llvm_str()))


def _without_paths(code: str) -> str:
    """Return LLVM code with numba's pickled exceptions emptied, and numbered anew.

    They say where numba is installed, and no kernel raises one.
    """
    constant = r"(@\.const\.pickle\S+ = .*?constant (?:\[.*?\]|{.*?})) .*"
    code = re.sub(constant, r"\1 zeroinitializer", code)
    names: dict[str, str] = {}
    return re.sub(
        r"(?<=\.const\.pickle)(data|buf)\.[0-9a-f]{40}",
        lambda found: f"{found[1]}.{names.setdefault(found[0][-40:], str(len(names)))}",
        code,
    )


_versions: dict[tuple[str, Any], Version] = {}
_named: dict[str, Version] = {}
# names of the versions called by each version that is being compiled, the innermost last
_calls: list[set[str]] = []


def version_of(kernel: Source, args: tuple[Any, ...]) -> Version:
    """Return the version of a kernel for numba's types of its arguments."""
    found = _versions.get((kernel.name, args))
    if found is None:
        found = _compiled(kernel, args)
        _versions[kernel.name, args] = _named[found.name] = found
    if _calls:
        _calls[-1].add(found.name)
    return found


def _compiled(kernel: Source, args: tuple[Any, ...]) -> Version:
    flags: Any = Flags()
    flags.nrt = False
    flags.error_model = "numpy"
    flags.forceinline = kernel.inline
    flags.no_compile = flags.no_cpython_wrapper = flags.no_cfunc_wrapper = True
    typing = cpu_target.typing_context
    target = cpu_target.target_context
    library = _Collected(target.codegen(), kernel.name)
    _calls.append(set())
    try:
        made = compile_extra(
            typing, target, kernel.py_func, args, None, flags, {}, library
        )
    finally:
        calls = _calls.pop()
    # numba's names count what was compiled before; ours follow from kernel and types.
    described = made.fndesc
    types = " ".join(map(str, args))
    digest = hashlib.sha256(types.encode()).hexdigest()[:16]
    name = f"{kernel.name.replace(':', '.')}.{digest}"
    code = library.modules[0].replace(described.mangled_name, name)
    described.mangled_name = name
    returned = made.signature.return_type
    return Version(name, returned, described, code, frozenset(calls), library.libraries)


def compile_set(entries: Iterable[tuple[str, Any]], target) -> tuple[list[Any], bytes]:
    """Compile a set of kernels; return a list of what was compiled, and LLVM's bitcode.

    `entries` are pairs: a kernel's name ("module:function"), and descriptions of its arguments. An
    item of the list is [name, descriptions, symbol in the code, description of the result].
    Entries that no longer exist in the source are left out. The code is optimised for `target`,
    LLVM's description of a machine.
    """
    offers = []
    versions = []
    for name, key in entries:
        module, _, function = name.partition(":")
        try:
            kernel = getattr(importlib.import_module(module), function)
            args = tuple(map(lower.type_of, key))
        except (
            ImportError,
            AttributeError,
            ValueError,
        ):  # of a list older than the source
            continue
        version = version_of(kernel, args)
        versions.append(version)
        offers.append([name, key, version.name, lower.description_of(version.returned)])
    whole = _linked(versions)
    _optimise(whole, target)
    return offers, whole.as_bitcode()


def _linked(entries: list[Version]):
    """Link versions and all that they call into one module of LLVM.

    Only `entries` can be called from outside. Raise NotImplementedError if a function is not
    known.
    """
    used = {}
    todo = list(entries)
    kept = {each.name for each in entries}
    while todo:
        version = todo.pop()
        if version.name not in used:
            used[version.name] = version
            todo += [_named[name] for name in version.calls]
    whole = llvm.parse_assembly("")
    libraries = set[str]()
    for _, version in sorted(used.items()):
        whole.link_in(llvm.parse_assembly(version.code))
        libraries |= set(version.libraries)
    for code in sorted(libraries):
        module = llvm.parse_assembly(code)
        for function in module.functions:
            if not function.is_declaration:
                function.linkage = "linkonce_odr"
        whole.link_in(module)
    for function in whole.functions:
        if not function.is_declaration and function.name not in kept:
            function.linkage = "internal"
        elif function.is_declaration and not _is_known(function.name):
            raise NotImplementedError(f"kernels cannot call {function.name}")
    for variable in whole.global_variables:
        if not variable.is_declaration:
            variable.linkage = "internal"
    return whole


def _is_known(name: str) -> bool:
    return name.startswith("llvm.") or llvm.address_of_symbol(name) is not None


def _optimise(module, target) -> None:
    tuning = llvm.create_pipeline_tuning_options(2)
    tuning.loop_vectorization = tuning.slp_vectorization = True
    passes = llvm.create_pass_builder(target, tuning)
    passes.getModulePassManager().run(module, passes)


class KernelType(types.Callable, types.Dummy):
    """Type of a kernel that another kernel calls."""

    def __init__(self, kernel: Source) -> None:
        self.kernel = kernel
        super().__init__(name=f"kernel {kernel.name}")

    def get_call_type(self, context, args, kws):
        """Compile the version that a call needs; return its signature."""
        if kws:
            raise TypeError(
                f"{self.kernel.name}: kernels take each other's arguments by position"
            )
        given = tuple(map(lower.plain, args))
        return version_of(self.kernel, given).returned(*given)

    def get_call_signatures(self):
        """Return that no signatures are known before a call."""
        return (), True

    def get_impl_key(self, sig):
        """Return the key of the code of a call."""
        return self.name


register_model(KernelType)(models.OpaqueModel)


@typeof_impl.register(Source)
def _type_of_value(kernel: Source, context) -> KernelType:
    return _type_of_kernel(kernel)


@functools.cache
def _type_of_kernel(kernel: Source) -> KernelType:
    of = KernelType(kernel)

    @lower_builtin(of.name, types.VarArg(types.Any))
    def call(context, builder, sig, args):
        return context.call_internal(
            builder, version_of(kernel, sig.args).described, sig, args
        )

    return of
