"""The command `archfrag`, also as ``python -m archfrag``: ready before what it imports."""

import sys
import warnings


def main() -> None:
    """Run the command; Ctrl-C while it imports ends it with a sentence, and a warning never."""
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
