"""Uncertain keys of an arch: their distributions, correlations and sampling."""

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from archfrag.errors import InputError
from archfrag.study.file import Section, refuse

if TYPE_CHECKING:
    from archfrag.arch.uncertain import Marginal

# Keys of an arch that may vary, of all profiles.
VARIABLE = (
    "radius", "thickness", "embrace", "span", "rise", "width", "height", "density", "depth",
    "friction", "dead_load", "thickness_factor",
)  # fmt: skip
Value = Annotated[float, Field(ge=-1e12, le=1e12)]
Positive = Annotated[float, Field(gt=0.0, le=1e12)]
Dispersion = Annotated[float, Field(gt=0.0, le=5.0)]


class Distribution(Section):
    """Distribution of one key, in the unit of the key."""

    kind_key, common = "distribution", ("relative",)
    kinds: ClassVar = {
        "normal": (("mean",), ("cov", "sd", "lower", "upper")),
        "lognormal": (("median", "beta"), ("lower", "upper")),
        "uniform": (("start", "stop"), ()),
        "triangular": (("start", "mode", "stop"), ()),
    }

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

    @model_validator(mode="after")
    def _fit_together(self) -> Self:
        if self.distribution == "normal" and (self.cov is None) == (self.sd is None):
            raise refuse("must have one of cov and sd")
        if self.cov is not None and self.mean is not None and self.mean <= 0.0:
            raise refuse(f"must have sd in the place of cov with mean = {self.mean:g}")
        ends = [value for value in (self.start, self.mode, self.stop) if value is not None]
        if ends and (ends != sorted(ends) or ends[0] == ends[-1]):
            values = ", ".join(f"{end:g}" for end in ends)
            raise refuse(f"must increase from start to stop, not {values}")
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
    def _have_no_factors(self) -> Self:
        for name, distribution in self:
            if distribution is not None and distribution.relative:
                raise refuse("cannot be used for joints", f"{name}.relative")
        return self

    def draw(
        self, given: Mapping[str, Any], n_joint: int, generator: np.random.Generator
    ) -> dict[str, Any]:
        """Draw the keys of an arch whose joints differ from each other."""
        from archfrag.arch.uncertain import to_digits

        keys: dict[str, Any] = {}
        # All are drawn, so that one key more leaves the others' numbers as they are.
        for name, distribution in self:
            points = np.clip(generator.random(n_joint), 2.0**-32, 1.0 - 2.0**-32)
            if distribution is None:
                continue
            values = to_digits(distribution.marginal().quantile(points))
            if name == "friction":
                keys[name] = to_digits(np.asarray(given[name]) * values).tolist()
            elif name == "position":  # the springings stay where they are
                end, count = float(given.get("embrace", 1.0)), max(n_joint - 1, 1)
                step = end / count
                joints = given.get("joints") or [*(step * j for j in range(count)), end]
                moved = np.asarray(joints[1:-1]) + step * values[1:-1]
                inner = (float(f"{joint:.12g}") for joint in moved)
                keys["joints"] = [float(joints[0]), *inner, float(joints[-1])]
            else:
                side = {name.removeprefix("recess_"): values.tolist()}
                keys["recess"] = keys.get("recess", given.get("recess", {})) | side
        return keys


class Vary(Section):
    """Uncertain keys of an arch, and how arches are sampled."""

    samples: Annotated[int, Field(ge=1, le=8192)]
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
        from archfrag.arch.uncertain import correlation_factor

        if not self.of and (self.joints is None or not self.joints.model_fields_set):
            raise refuse("must have a key of or joints: nothing varies")
        if self.scheme == "sobol" and self.crossed and self.samples & (self.samples - 1):
            text = "must be a power of two with scheme sobol; latin_hypercube takes any number"
            raise refuse(f"= {self.samples} {text}", "samples")
        try:
            correlation_factor(list(self.of), self.correlation)
        except InputError as error:
            raise refuse(f"is not possible: {error}", "correlation") from None
        return self

    def draw(
        self, plain: Mapping[str, Any], n_joint: int, count: int, stream: Sequence[int] = ()
    ) -> Iterator[tuple[dict[str, Any], dict[str, float]]]:
        """Draw arches: all keys of each, and the values of those that were drawn.

        Keys are drawn by the scheme (`archfrag.arch.uncertain.sample`), but what differs from
        joint to joint by plain random numbers, the same for the n-th sample of a seed whatever
        the number of samples: no design of a few points is even in as many coordinates as there
        are joints. `plain` has the keys of the arch itself; `stream` makes its numbers its own.
        """
        from archfrag.arch.uncertain import sample, to_digits

        seed = (self.seed, *stream)
        values = sample(
            {key: distribution.marginal() for key, distribution in self.of.items()}, count,
            scheme=self.scheme, seed=seed, correlation=self.correlation,
        )  # fmt: skip
        for i in range(count):
            given, drawn = {**plain, "id": f"{plain['id']}-{i + 1:04d}"}, {}
            for key, distribution in self.of.items():
                value = given[key] = float(values[key][i])
                if distribution.relative:
                    given[key] = to_digits(np.multiply(plain[key], value)).tolist()
                many = isinstance(given[key], list)
                drawn[f"{key}_factor" if many else key] = value if many else given[key]
            if "embrace" in self.of and "joints" in plain:
                # Joints in degrees keep their parts of an angle of embrace that varies.
                ratio = given["embrace"] / plain["embrace"]
                given["joints"] = [*(j * ratio for j in plain["joints"][:-1]), given["embrace"]]
            if self.joints is not None:
                # Zeros behind a seed are the same seed to numpy: 1 separates joints from keys.
                generator = np.random.default_rng([*seed, i, 1])
                given |= self.joints.draw(given, n_joint, generator)
            yield given, drawn
