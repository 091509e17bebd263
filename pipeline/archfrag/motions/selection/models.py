"""Ground-motion models, as pygmm computes them, and the correlation between periods."""

import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from archfrag.errors import InputError, from_extra

Array = NDArray[np.float64]
MODELS = {
    "ASK14": "AbrahamsonSilvaKamai2014", "BSSA14": "BooreStewartSeyhanAtkinson2014",
    "CB14": "CampbellBozorgnia2014", "CY14": "ChiouYoungs2014", "I14": "Idriss2014",
    "ASB14": "AkkarSandikkayaBommer2014",
}  # fmt: skip
SHORTEST, LONGEST = 0.01, 10.0  # periods for which correlations were fitted [s]
MECHANISMS = ("SS", "RS", "NS")
_WORDS = {
    "mag": ("magnitude", ""), "dist_rup": ("distance", " km"), "v_s30": ("Vs30", " m/s"),
    "dist_jb": ("Joyner-Boore distance", " km"), "dip": ("dip", " degrees"),
    "depth_tor": ("depth to the top of the rupture", " km"),
}  # fmt: skip


@dataclass(frozen=True)
class Rupture:
    """An earthquake and a site, as ground-motion models for active shallow crust want them.

    Moment magnitude, closest distance to the rupture [km], Vs30 of the site [m/s], mechanism
    (``SS`` strike-slip, ``RS`` reverse, ``NS`` normal), dip of the fault [degrees] and a region
    that the model knows (``italy``, ``japan``). The site is on the footwall's side; the top of
    the rupture is its closest point, as deep as Chiou and Youngs (2014) expect.
    """

    magnitude: float
    distance_km: float
    vs30_mps: float
    mechanism: str = "SS"
    dip: float = 90.0
    region: str | None = None

    def __post_init__(self) -> None:
        if self.mechanism not in MECHANISMS:
            raise InputError(
                f"mechanism {self.mechanism!r} of a rupture must be one of {', '.join(MECHANISMS)}"
            )
        for name in ("magnitude", "distance_km", "vs30_mps"):
            check_positive(getattr(self, name), f"{name} = {getattr(self, name)} of a rupture")

    def parameters(self) -> dict[str, Any]:
        """What pygmm calls the facts of a rupture."""
        # Chiou and Youngs (2014), Eqs 4 and 5: mean depth to the top, reverse or other faults.
        a, b, c = (2.704, 1.226, 5.849) if self.mechanism == "RS" else (2.673, 1.136, 4.970)
        root = max(a - b * max(self.magnitude - c, 0.0), 0.0)
        top = min(root**2, self.distance_km)
        surface = float(np.sqrt(self.distance_km**2 - top**2))
        found = {
            "mag": self.magnitude, "dist_rup": self.distance_km, "dist_jb": surface,
            "dist_x": -surface, "v_s30": self.vs30_mps, "dip": self.dip, "depth_tor": top,
            "mechanism": self.mechanism, "on_hanging_wall": False, "region": self.region,
        }  # fmt: skip
        return {key: value for key, value in found.items() if value is not None}


class Prediction(NamedTuple):
    """ln of the median Sa [ln g] and standard deviation of ln Sa [1], (n_period,) each."""

    ln_median: Array
    sd: Array
    notes: tuple[str, ...]


def predict(rupture: Rupture, model: str, periods: ArrayLike) -> Prediction:
    """Predict Sa at periods [s] by a ground-motion model, 5 % damping.

    `model` is ``ASK14``, ``BSSA14``, ``CB14``, ``CY14``, ``I14`` (Earthquake Spectra 30(3), 2014)
    or ``ASB14`` (Akkar, Sandikkaya and Bommer 2014, Bull. Earthquake Eng. 12). Those of NGA-West2
    (the first five) give RotD50, ASB14 the geometric mean of two components; a single component
    varies somewhat more than either. Notes name what of the rupture is beyond what the model is
    recommended for. InputError if the model is unknown or does not know the mechanism or region,
    or a period is outside the model's.
    """
    if model not in MODELS:
        raise InputError(f"ground-motion model {model!r} must be one of {', '.join(MODELS)}")
    pygmm = from_extra("pygmm", "select")
    kind, wanted = getattr(pygmm, MODELS[model]), np.atleast_1d(np.asarray(periods, dtype=float))
    facts = rupture.parameters()
    notes = tuple(_beyond(kind, facts, model))
    known = {parameter.name for parameter in kind.PARAMS}
    scenario = pygmm.Scenario(**{k: v for k, v in facts.items() if k in known})
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # in whose place are the notes
        prediction = kind(scenario)
    first, last = prediction.periods.min(), prediction.periods.max()
    # A period of the table's end may differ from the one typed by rounding.
    _check_within(wanted, first * (1 - 1e-9), last * (1 + 1e-9), f"of the model {model}")
    inside = np.clip(wanted, first, last)
    return Prediction(
        prediction.interp_ln_spec_accels(inside), prediction.interp_ln_stds(inside), notes
    )


def _beyond(kind: Any, facts: dict[str, Any], model: str) -> Iterator[str]:
    for parameter in (each for each in kind.PARAMS if each.name in facts):
        value = facts[parameter.name]
        word, unit = _WORDS.get(parameter.name, (parameter.name, ""))
        options = getattr(parameter, "options", None)
        if options and value not in options:
            raise InputError(
                f"{word} {value!r} is none of the model {model}, which has {', '.join(options)}"
            )
        for name, side, sign in (("min", "from", 1.0), ("max", "up to", -1.0)):
            limit = getattr(parameter, name, None)
            if limit is not None and sign * value < sign * limit:
                recommended = f"recommended for {word} {side} {limit:g}{unit}"
                yield f"{model} is {recommended}, not {value:g}{unit}"


def correlation(first: ArrayLike, second: ArrayLike) -> Array:
    """Correlation of ln Sa at periods [s], broadcast, about the median of a ground-motion model.

    Baker and Jayaram (2008), Earthquake Spectra 24(1), 299-317, as pygmm computes it; InputError
    for a period outside 0.01 to 10 s, where it was fitted.
    """
    calc_correls = from_extra("pygmm.baker_jayaram_2008", "select").calc_correls
    both = [np.asarray(periods, dtype=np.float64) for periods in (first, second)]
    fitted = "for which the correlations of Baker and Jayaram (2008) were fitted"
    for periods in both:
        _check_within(np.atleast_1d(periods).ravel(), SHORTEST, LONGEST, fitted)
    return np.asarray(calc_correls(*both), dtype=np.float64)


def check_positive(value: float, name: str) -> None:
    if not (np.isfinite(value) and value > 0.0):
        raise InputError(f"{name} must be a number above 0")


def _check_within(periods: Array, low: float, high: float, what: str) -> None:
    outside = periods[~((periods >= low) & (periods <= high))]
    if outside.size:
        raise InputError(f"period {outside[0]:g} s is outside {low:g} to {high:g} s {what}")
