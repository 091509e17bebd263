"""Paths in a study file."""

import os
from typing import Annotated

from pydantic import AfterValidator, Field

from archfrag.study.arches import refuse

LONGEST_NAME, LONGEST_PATH = 255, 3900  # [bytes] of file systems; results add to a path


def _usable_path(value: str) -> str:
    if value.startswith("~"):
        raise refuse("begins with the home folder of a user that there is not")
    if max(map(len, os.fsencode(value).split(b"/"))) > LONGEST_NAME:
        raise refuse(f"must have names of at most {LONGEST_NAME} bytes between its slashes")
    if len(os.fsencode(value)) > LONGEST_PATH:
        raise refuse(f"must have at most {LONGEST_PATH} bytes with the folders above it")
    return value


PathText = Annotated[str, Field(min_length=1), AfterValidator(_usable_path)]
