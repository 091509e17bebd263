"""How the runs of a study are integrated, as its file says it."""

from typing import Annotated

from pydantic import AfterValidator, Field, model_validator

from archfrag.errors import InputError
from archfrag.study.section import Section, refuse


def _known_method(name: str) -> str:
    from archfrag.simulation.checks import method_names

    if name not in method_names():
        raise refuse(f"must be one of {', '.join(method_names())}")
    return name


class Method(Section):
    """How the equations of motion are integrated."""

    name: Annotated[str, AfterValidator(_known_method)] = "auto"
    """Method; auto lets archfrag choose."""
    dt: Annotated[float, Field(ge=1e-6, le=0.1)] | None = None
    """Step of methods with a fixed step [s]; the method's default where not given."""
    rtol: Annotated[float, Field(ge=1e-12, lt=1.0)] | None = None
    """Relative error allowed by methods with step control; the method's default if not given."""
    follow: Annotated[float, Field(ge=0.0, le=3600.0)] = 20.0
    """How long a chain still moving at the end of a record is followed [s]."""
    loss_limit: Annotated[float, Field(ge=0.02, le=10.0)] = 0.5
    """Gap at both corners of a joint, over its length, beyond which contact is lost for good."""
    settings: dict[str, float] = Field(default_factory=dict)
    """Own parameters of the method that differ from their defaults, by name."""

    @model_validator(mode="after")
    def _own_settings(self) -> "Method":
        from archfrag.simulation.checks import check_method, check_settings, check_taken

        try:
            method = check_method(self.name)
            check_taken(method, dt=self.dt, rtol=self.rtol)
            check_settings(method, self.settings)
        except InputError as error:
            raise refuse(str(error)) from error
        return self


def parameter_texts() -> dict[str, str]:
    """What the registry says of each key of `Method` that some method takes."""
    from archfrag.methods.registry import resolve
    from archfrag.simulation.checks import method_names

    takers: dict[str, list[str]] = {}
    meaning: dict[str, str] = {}
    for name in method_names():
        info = resolve(name)
        for parameter in info.parameters if info else ():
            key = parameter.name
            if key in Method.model_fields:
                own = (
                    f" ({parameter.default:g} if not given)"
                    if Method.model_fields[key].default is None
                    else ""
                )
                takers.setdefault(key, []).append(name + own)
                meaning.setdefault(key, f"{parameter.meaning} [{parameter.unit}]")
    return {
        key: f"{text[:1].upper()}{text[1:]}; used by {', '.join(takers[key])}."
        for key, text in meaning.items()
    }
