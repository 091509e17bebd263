"""The runs of a study: which ones a design asks for, where they are kept, who makes them."""

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, TypeAdapter

from archfrag.study.file import refuse
from archfrag.study.runs.design import Cloud, Design, Stripes
from archfrag.study.runs.ida import Ida

_GONE = {
    "two_stage": "is gone, since it was not cheaper than ida; write kind: ida",
    "scattered": "is gone, since it was not cheaper than the grid; write kind: ida or stripes",
}


def _is_there(given: Any) -> Any:
    kind = given.get("kind") if isinstance(given, Mapping) else None
    if isinstance(kind, str) and kind in _GONE:
        raise refuse(f"of kind {kind} {_GONE[kind]}")
    return given


# All designs, by the key `design` of a study file.
AnyDesign = Annotated[
    Annotated[Stripes | Ida | Cloud, Field(discriminator="kind")], BeforeValidator(_is_there)
]


def design_of(facts: Mapping[str, Any]) -> Design:
    """The design of a cube, whose facts may hold those of its arches too."""
    keys = {key: value for key, value in facts.items() if key != "arches"}
    found: Design = TypeAdapter[Any](AnyDesign).validate_python(keys)
    return found
