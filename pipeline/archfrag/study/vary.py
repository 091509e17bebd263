"""What of an arch is not known exactly: distributions, correlations and how they are sampled."""

from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from archfrag.errors import InputError
from archfrag.study.section import Rising, Section, refuse, refuse_key

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


class Distribution(Section):
    """What all distributions have in common."""

    relative: bool = False
    """Whether values are factors on what the arch's own key states, which may be a list."""

    def marginal(self) -> "Marginal":
        """Distribution to draw from."""
        from scipy import stats

        from archfrag.arch.uncertain import Marginal

        name, *numbers = self._full()
        bounds = self.model_dump(include={"lower", "upper"}, exclude_none=True)
        return Marginal(getattr(stats, name)(*numbers), **bounds)

    def _full(self) -> tuple[Any, ...]:
        """Name and parameters in `scipy.stats`, without truncation."""
        raise NotImplementedError


class Truncated(Distribution):
    """A distribution without bounds of its own."""

    lower: Value | None = None
    """Values below do not occur (the remainder of the distribution is scaled up)."""
    upper: Value | None = None
    """Values above do not occur."""

    @model_validator(mode="after")
    def _keep_something(self) -> Self:
        if self.lower is not None and self.upper is not None and self.upper <= self.lower:
            raise refuse(f"must have upper above lower = {self.lower:g}, not {self.upper:g}")
        try:
            self.marginal().quantile(0.5)
        except InputError as error:
            raise refuse(f"is cut too far: {error}") from None
        return self


class NormalDistribution(Truncated):
    """Normal distribution."""

    distribution: Literal["normal"]
    mean: Value
    """Before truncation, in the unit of the key."""
    cov: Dispersion | None = None
    """Coefficient of variation: standard deviation over mean; or give sd."""
    sd: Positive | None = None
    """Standard deviation before truncation; or give cov."""

    @model_validator(mode="after")
    def _one_scatter(self) -> Self:
        if (self.cov is None) == (self.sd is None):
            raise refuse("must have one of cov and sd")
        if self.cov is not None and self.mean <= 0.0:
            raise refuse(f"must have sd in the place of cov with mean = {self.mean:g}")
        return self

    def _full(self) -> tuple[Any, ...]:
        return "norm", self.mean, self.sd or (self.cov or 1.0) * self.mean


class LognormalDistribution(Truncated):
    """Lognormal distribution."""

    distribution: Literal["lognormal"]
    median: Positive
    """Before truncation, in the unit of the key."""
    beta: Dispersion
    """Standard deviation of the natural logarithm."""

    def _full(self) -> tuple[Any, ...]:
        return "lognorm", self.beta, 0.0, self.median


class UniformDistribution(Distribution, Rising):
    """Uniform distribution."""

    distribution: Literal["uniform"]
    start: Value
    """Least value."""
    stop: Value
    """Largest value."""

    def _full(self) -> tuple[Any, ...]:
        return "uniform", self.start, self.stop - self.start


class TriangularDistribution(Distribution):
    """Triangular distribution."""

    distribution: Literal["triangular"]
    start: Value
    """Least value."""
    mode: Value
    """Most likely value."""
    stop: Value
    """Largest value."""

    @model_validator(mode="after")
    def _rise(self) -> Self:
        if not (self.start <= self.mode <= self.stop and self.start < self.stop):
            ends = f"{self.start:g}, {self.mode:g}, {self.stop:g}"
            raise refuse(f"must have start <= mode <= stop, not {ends}")
        return self

    def _full(self) -> tuple[Any, ...]:
        width = self.stop - self.start
        return "triang", (self.mode - self.start) / width, self.start, width


AnyDistribution = Annotated[
    NormalDistribution | LognormalDistribution | UniformDistribution | TriangularDistribution,
    Field(discriminator="distribution"),
]


class JointScatter(Section):
    """How the joints of one arch differ from each other, each drawn independently."""

    recess_intrados: AnyDistribution | None = None
    """Depth over which a joint bears nothing at its intrados (mortar lost, edge spalled) [m]."""
    recess_extrados: AnyDistribution | None = None
    """Depth over which a joint bears nothing at its extrados [m]."""
    position: AnyDistribution | None = None
    """Shift of the joints between the springings along the ring, in lengths of a voussoir."""
    friction: AnyDistribution | None = None
    """Factor on the arch's friction."""

    @model_validator(mode="after")
    def _have_something(self) -> Self:
        given = {name: value for name, value in self if value is not None}
        if not given:
            raise refuse(f"must have one of {', '.join(JointScatter.model_fields)}")
        for name, distribution in given.items():
            if distribution.relative:
                raise refuse_key(f"{name}.relative", "has no place among the joints")
        return self


class Vary(Section):
    """What of an arch is not known exactly, and the arches that are drawn for it."""

    samples: Annotated[int, Field(ge=1, le=MOST_SAMPLES)]
    """Arches drawn, in all if crossed and for each record if not."""
    scheme: Literal["sobol", "latin_hypercube"] = "sobol"
    """sobol: its first samples stay when samples are added; latin_hypercube: any number."""
    seed: Annotated[int, Field(ge=0, le=2**32 - 1)] = 1
    """Of the random numbers; the same seed gives the same arches."""
    crossed: bool = True
    """Whether each sampled arch meets every record; false: each record meets its own arches."""
    of: Annotated[
        dict[str, AnyDistribution], Field(json_schema_extra={"propertyNames": {"enum": VARIABLE}})
    ] = Field(default_factory=dict)
    """Distribution of each key that varies, in the unit of the key."""
    joints: JointScatter | None = None
    """How the joints of one arch differ from each other."""
    correlation: dict[str, dict[str, float]] = Field(default_factory=dict)
    """Of keys to keys to coefficients of the Gaussian copula: correlations of normal scores."""

    @model_validator(mode="after")
    def _fit_together(self) -> Self:
        if not self.of and self.joints is None:
            raise refuse("must have a key of or joints: nothing varies")
        count = self.samples
        if self.scheme == "sobol" and self.crossed and count & (count - 1):
            some = 1 << (count.bit_length() - 1)
            text = (
                f"{count} must be a power of two with scheme sobol, such as {some} or {2 * some}"
            )
            raise refuse_key("samples", f"{text}; latin_hypercube takes any number")
        if self.correlation:
            from archfrag.arch.uncertain import correlation_factor

            try:
                correlation_factor(list(self.of), self.correlation)
            except InputError as error:
                raise refuse_key("correlation", str(error)) from None
        return self
