"""Kernels: compiled functions of numbers, arrays and structs, called from Python as C functions.

numba and LLVM are used through their public interfaces as far as these go. numba types a kernel
and writes its LLVM code (`compile`). Its next steps, which would optimise each function again in
every caller and wrap it for Python, are left out. LLVM gets all kernels that a set of entries
needs as one module, optimises it once (llvmlite's public passes), and makes an object file of it
(`load`). Python calls the functions in that file by address through ctypes, without its lock.

A struct (`structs`) reaches a kernel as one pointer, to a table of the addresses and sizes of its
arrays. `lower` tells numba how to treat a struct, a kernel among a kernel's globals, and numbers
of several runs (`primitives`). If the source is that of the LLVM code in ``shipped`` (`cache`),
nothing is compiled and numba is not imported.

Names of numba that its documentation does not promise are `compile_extra`, `Flags`, `cpu_target`
and `AttributeTemplate`. Of objects that it hands over, `compile` and `lower` use these: the parts
of what `compile_extra` returns, a code library's ``get_llvm_str``, a target context's ``cast``,
``call_internal``, ``make_array``, ``make_tuple`` and those that tell how types are represented.
"""
