"""The command `archfrag`, also as ``python -m archfrag``.

It handles Ctrl-C and warnings before it imports the rest of the package, and sets what costs
time in a process of its own: threads for linear algebra, and searches for garbage.
"""

import atexit
import gc
import os
import sys
import warnings

# Each library of linear algebra starts threads of its own; here arrays are small.
THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
# Imports make hundreds of thousands of objects and no garbage; the default is 700.
GARBAGE = 50_000


def main() -> None:
    """Run the command.

    Ctrl-C during the imports ends it with a sentence and exit code 130. A warning never ends it:
    if PYTHONWARNINGS turns warnings into errors, `UserWarning` and `RuntimeWarning` are printed
    instead, and others are ignored. Linear algebra gets one thread, unless the user has given it
    a number.
    """
    if not os.environ.keys() & {*THREADS}:  # read when numpy and scipy are imported
        os.environ.update(dict.fromkeys(THREADS, "1"))
    gc.set_threshold(GARBAGE)
    atexit.register(gc.freeze)  # at the end nothing is searched that ends anyway
    if any(
        entry[0] == "error" for entry in warnings.filters
    ):  # asked for by PYTHONWARNINGS
        warnings.simplefilter("ignore")
        for kind in (UserWarning, RuntimeWarning):
            warnings.simplefilter("default", kind)
    try:
        from archfrag.cli import main as command

        command()
    except KeyboardInterrupt:
        print("archfrag: stopped by SIGINT", file=sys.stderr)
        sys.exit(130)


if __name__ == "__main__":
    main()
