"""The runs of a study, and all designs that ask for them."""

from collections.abc import Mapping
from functools import partial
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, TypeAdapter

from archfrag.study.designs.design import Cloud, Design, Stripes
from archfrag.study.designs.ida import Ida
from archfrag.study.keys import check_block

__all__ = ["AnyDesign", "Design", "Stripes", "design_of"]


# By the key `design` of a study file; the name of a design may stand for its block.
AnyDesign = Annotated[
    Stripes | Ida | Cloud, Field(discriminator="kind"),
    BeforeValidator(partial(check_block, key="kind")),
    BeforeValidator(lambda given: {"kind": given} if isinstance(given, str) else given),
]  # fmt: skip


def design_of(facts: Mapping[str, Any]) -> Design:
    """Return the design of a cube, whose facts may hold those of its arches too."""
    keys = {key: value for key, value in facts.items() if key != "arches"}
    found: Design = TypeAdapter[Any](AnyDesign).validate_python(keys)
    return found
