"""Uncertain keys of an arch: their distributions, correlations and sampling."""

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from archfrag.errors import InputError
from archfrag.study.file.messages import Section, refuse, refuse_key, refuse_missing

if TYPE_CHECKING:
    from archfrag.arch.uncertain import Marginal

# Keys of an arch that may vary, of all profiles.
VARIABLE = (
    "radius", "thickness", "embrace", "span", "rise", "width", "height", "density", "depth",
    "friction", "dead_load", "thickness_factor",
)  # fmt: skip
MOST_SAMPLES = 8192
Value = Annotated[float, Field(ge=-1e12, le=1e12)]
Positive = Annotated[float, Field(gt=0.0, le=1e12)]
Dispersion = Annotated[float, Field(gt=0.0, le=5.0)]
# Keys that each distribution needs, and keys that it may have.
DISTRIBUTIONS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "normal": (("mean",), ("cov", "sd", "lower", "upper")),
    "lognormal": (("median", "beta"), ("lower", "upper")),
    "uniform": (("start", "stop"), ()),
    "triangular": (("start", "mode", "stop"), ()),
}


class Distribution(Section):
    """Distribution of one key, in the unit of the key."""

    distribution: Literal["normal", "lognormal", "uniform", "triangular"]
    mean: Value | None = None
    """Mean of a normal distribution before truncation."""
    cov: Dispersion | None = None
    """Coefficient of variation of a normal distribution: standard deviation over mean; or sd."""
    sd: Positive | None = None
    """Standard deviation of a normal distribution before truncation; or cov."""
    median: Positive | None = None
    """Median of a lognormal distribution before truncation."""
    beta: Dispersion | None = None
    """Standard deviation of the natural logarithm of a lognormal distribution."""
    start: Value | None = None
    """Least value of a uniform or triangular distribution."""
    mode: Value | None = None
    """Most likely value of a triangular distribution."""
    stop: Value | None = None
    """Largest value of a uniform or triangular distribution."""
    lower: Value | None = None
    """Lower bound; the rest of a normal or lognormal distribution is scaled up."""
    upper: Value | None = None
    """Upper bound."""
    relative: bool = False
    """Whether values are factors on the key of the arch, which may be a list."""

    @classmethod
    def allowed_keys(cls, given: Mapping[str, Any]) -> Iterable[str]:
        """Those of the distribution; of an unknown one all."""
        name = str(given.get("distribution"))
        needs, may = DISTRIBUTIONS.get(name, (tuple(cls.model_fields), ()))
        return dict.fromkeys(("distribution", *needs, *may, "relative"))

    @model_validator(mode="after")
    def _fit_together(self) -> Self:
        needs = DISTRIBUTIONS[self.distribution][0]
        if missing := [key for key in needs if getattr(self, key) is None]:
            raise refuse_missing(missing)
        if self.distribution == "normal" and (self.cov is None) == (self.sd is None):
            raise refuse("must have one of cov and sd")
        if self.cov is not None and self.mean is not None and self.mean <= 0.0:
            raise refuse(f"must have sd in the place of cov with mean = {self.mean:g}")
        ends = [value for value in (self.start, self.mode, self.stop) if value is not None]
        if ends and (ends != sorted(ends) or ends[0] == ends[-1]):
            names = " <= ".join(needs)
            raise refuse(f"must have {names}, not {', '.join(f'{end:g}' for end in ends)}")
        if self.lower is not None and self.upper is not None and self.upper <= self.lower:
            raise refuse(f"must have upper above lower = {self.lower:g}, not {self.upper:g}")
        if self.lower is not None or self.upper is not None:
            try:
                self.marginal().quantile(0.5)
            except InputError as error:
                raise refuse(f"is cut too far: {error}") from None
        return self

    def marginal(self) -> "Marginal":
        """Distribution to draw from."""
        from scipy import stats

        from archfrag.arch.uncertain import Marginal

        keys: Any = self
        if self.distribution == "normal":
            law = stats.norm(keys.mean, keys.sd or keys.cov * keys.mean)
        elif self.distribution == "lognormal":
            law = stats.lognorm(keys.beta, 0.0, keys.median)
        elif self.distribution == "uniform":
            law = stats.uniform(keys.start, keys.stop - keys.start)
        else:
            width = keys.stop - keys.start
            law = stats.triang((keys.mode - keys.start) / width, keys.start, width)
        return Marginal(law, **self.model_dump(include={"lower", "upper"}, exclude_none=True))


class JointScatter(Section):
    """Differences between the joints of one arch, sampled independently."""

    recess_intrados: Distribution | None = None
    """Depth over which a joint transmits nothing at its intrados (lost mortar) [m]."""
    recess_extrados: Distribution | None = None
    """Depth over which a joint transmits nothing at its extrados [m]."""
    position: Distribution | None = None
    """Shift of the joints between the springings along the ring, in lengths of a voussoir."""
    friction: Distribution | None = None
    """Factor on the arch's friction."""

    @model_validator(mode="after")
    def _have_something(self) -> Self:
        given = {name: value for name, value in self if value is not None}
        if not given:
            raise refuse(f"must have one of {', '.join(JointScatter.model_fields)}")
        for name, distribution in given.items():
            if distribution.relative:
                raise refuse_key(f"{name}.relative", "cannot be used for joints")
        return self


class Vary(Section):
    """Uncertain keys of an arch, and how arches are sampled."""

    samples: Annotated[int, Field(ge=1, le=MOST_SAMPLES)]
    """Number of sampled arches: of the study if crossed, of each record if not."""
    scheme: Literal["sobol", "latin_hypercube"] = "sobol"
    """sobol keeps its first samples when you add samples; latin_hypercube suits any number."""
    seed: Annotated[int, Field(ge=0, le=2**32 - 1)] = 1
    """Seed of the random numbers; the same seed gives the same arches."""
    crossed: bool = True
    """Whether each sampled arch meets every record; false: each record meets its own arches."""
    of: Annotated[
        dict[str, Distribution], Field(json_schema_extra={"propertyNames": {"enum": VARIABLE}})
    ] = Field(default_factory=dict)
    """Distribution of each uncertain key, in the unit of the key."""
    joints: JointScatter | None = None
    """Differences between the joints of one arch."""
    correlation: dict[str, dict[str, float]] = Field(default_factory=dict)
    """Coefficients of the Gaussian copula between keys: correlations of normal scores."""

    @model_validator(mode="after")
    def _fit_together(self) -> Self:
        if not self.of and self.joints is None:
            raise refuse("must have a key of or joints: nothing varies")
        count = self.samples
        if self.scheme == "sobol" and self.crossed and count & (count - 1):
            some = 1 << (count.bit_length() - 1)
            text = f"must be a power of two with scheme sobol, such as {some} or {2 * some}"
            raise refuse_key("samples", f"= {count} {text}; latin_hypercube takes any number")
        if self.correlation:
            from archfrag.arch.uncertain import correlation_factor

            try:
                correlation_factor(list(self.of), self.correlation)
            except InputError as error:
                raise refuse_key("correlation", f"is not possible: {error}") from None
        return self
