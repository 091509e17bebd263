"""The processor for which LLVM code is shipped, and the one of this machine."""

import functools

import llvmlite.binding as llvm

# All processors with these features, those of the last ten years, give the same bits: they have
# fused multiply-adds.
PROCESSOR = "x86-64-v3"
NEEDED = ("avx2", "fma", "bmi2")
ARM = ("arm64-", "aarch64-")


def has_common_features() -> bool:
    """Return whether this processor has what `PROCESSOR` has."""
    return all(llvm.get_host_cpu_features().get(each) for each in NEEDED)


def can_use_shipped() -> bool:
    """Return whether LLVM can make machine code for this machine of the code that is shipped.

    It has no instruction of any processor, but needs fused multiply-adds, which all processors of
    64 bits by ARM have.
    """
    return has_common_features() or llvm.get_process_triple().startswith(ARM)


@functools.cache
def machine(processor: str = ""):
    """Return LLVM's description of `processor`, or of this machine's processor if it is empty."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    features = "" if processor else llvm.get_host_cpu_features().flatten()
    return llvm.Target.from_default_triple().create_target_machine(
        cpu=processor or llvm.get_host_cpu_name(),
        features=features,
        opt=3,
        reloc="static",
        codemodel="jitdefault",
        jit=True,
    )
