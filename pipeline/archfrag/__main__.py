"""The command `archfrag`, also as ``python -m archfrag``.

It handles Ctrl-C and warnings before it imports the rest of the package, and lets it search less
for garbage.
"""

import atexit
import gc
import sys
import warnings

# Imports make hundreds of thousands of objects and no garbage; the default is 700.
GARBAGE = 50_000


def main() -> None:
    """Run the command.

    Ctrl-C during the imports ends it with a sentence and exit code 130. A warning never ends it:
    if PYTHONWARNINGS turns warnings into errors, `UserWarning` and `RuntimeWarning` are printed
    instead, and others are ignored.
    """
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
