"""Give commands a study, read from its file."""

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

from archfrag.cli.options import takes, takes_study
from archfrag.study.file.schema import load_study


def with_study(*options: Callable) -> Callable:
    """Give a command a study, from its file, and options."""

    def decorate(command: Callable) -> Callable:
        @functools.wraps(command)
        def wrapped(study_file: Path, overrides: tuple[str, ...], **given: Any) -> None:
            command(load_study(study_file, overrides), **given)

        return takes(takes_study, *options)(wrapped)

    return decorate
