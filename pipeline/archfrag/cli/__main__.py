"""``python -m archfrag.cli``: the command `archfrag` without its script."""

from archfrag.cli import main

main()
