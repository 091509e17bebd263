"""Ground-motion models, as pygmm computes them, and the correlation between periods."""

import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from archfrag.errors import InputError

MODELS = {
    "ASK14": "AbrahamsonSilvaKamai2014",
    "BSSA14": "BooreStewartSeyhanAtkinson2014",
    "CB14": "CampbellBozorgnia2014",
    "CY14": "ChiouYoungs2014",
    "I14": "Idriss2014",
    "ASB14": "AkkarSandikkayaBommer2014",
}
SHORTEST, LONGEST = 0.01, 10.0  # periods for which correlations were fitted [s]
MECHANISMS = ("SS", "RS", "NS")
_WORDS = {
    "mag": ("magnitude", ""),
    "dist_rup": ("distance", " km"),
    "dist_jb": ("Joyner-Boore distance", " km"),
    "v_s30": ("Vs30", " m/s"),
    "depth_tor": ("depth to the top of the rupture", " km"),
    "dip": ("dip", " degrees"),
}


@dataclass(frozen=True)
class Rupture:
    """An earthquake and a site, as ground-motion models for active shallow crust want them.

    Its top is its closest point, as deep as Chiou and Youngs (2014) expect for the magnitude.

    Attributes
    ----------
    magnitude : float
        Moment magnitude.
    distance_km : float [km]
        Closest distance to the rupture.
    vs30_mps : float [m/s]
        Mean shear-wave velocity of the upper 30 m of the site.
    mechanism : str
        ``SS`` strike-slip, ``RS`` reverse, ``NS`` normal.
    dip : float [degrees]
        Of the fault. The site is on the footwall's side.
    region : str, optional
        A region that the model knows (``italy``, ``japan``); its own default where not given.
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
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0.0):
                raise InputError(f"{name} = {value} of a rupture must be a number above 0")


class Prediction(NamedTuple):
    """ln of the median Sa [ln g] and standard deviation of ln Sa [1], (n_period,) each."""

    ln_median: NDArray[np.float64]
    sd: NDArray[np.float64]
    notes: tuple[str, ...]


def predict(rupture: Rupture, model: str, periods: ArrayLike) -> Prediction:
    """Spectral acceleration at 5 % damping that a ground-motion model predicts.

    The models of NGA-West2 (the first five) give RotD50, the median over directions, ASB14 the
    geometric mean of two components. A single component varies somewhat more than either.

    Parameters
    ----------
    rupture : Rupture
    model : str
        ``ASK14``, ``BSSA14``, ``CB14``, ``CY14``, ``I14`` (Earthquake Spectra 30(3), 2014) or
        ``ASB14`` (Akkar, Sandikkaya and Bommer 2014, Bull. Earthquake Eng. 12).
    periods : array_like, shape (n_period,) [s]

    Returns
    -------
    Prediction
        Its notes name what of the rupture is beyond what the model is recommended for.

    Raises
    ------
    InputError
        If the model is unknown or does not know the mechanism or region, or a period is
        outside the model's.

    Examples
    --------
    >>> from archfrag.motions.selection import Rupture, predict
    >>> crustal = Rupture(magnitude=6.5, distance_km=20.0, vs30_mps=500.0)
    >>> predict(crustal, "CY14", [0.1, 1.0]).sd.round(2)
    array([0.58, 0.68])
    """
    if model not in MODELS:
        raise InputError(f"ground-motion model {model!r} must be one of {', '.join(MODELS)}")
    import pygmm  # half a second

    kind, wanted = getattr(pygmm, MODELS[model]), np.atleast_1d(np.asarray(periods, dtype=float))
    keys = _keys(rupture)
    notes = tuple(_beyond(kind, keys, model))
    known = {parameter.name for parameter in kind.PARAMS}
    scenario = pygmm.Scenario(**{k: v for k, v in keys.items() if k in known})
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # in whose place are the notes
        prediction = kind(scenario)
    first, last = prediction.periods.min(), prediction.periods.max()
    # A period of the table's end may differ from the one typed by rounding.
    outside = wanted[(wanted < first * (1 - 1e-9)) | (wanted > last * (1 + 1e-9))]
    if outside.size:
        raise InputError(
            f"period {outside[0]:g} s is outside {first:g} to {last:g} s of the model {model}"
        )
    inside = np.clip(wanted, first, last)
    return Prediction(
        prediction.interp_ln_spec_accels(inside), prediction.interp_ln_stds(inside), notes
    )


def _keys(rupture: Rupture) -> dict[str, Any]:
    """What pygmm calls the facts of a rupture."""
    # Chiou and Youngs (2014), Eqs 4 and 5: mean depth to the top, reverse or other faults.
    a, b, c = (2.704, 1.226, 5.849) if rupture.mechanism == "RS" else (2.673, 1.136, 4.970)
    root = max(a - b * max(rupture.magnitude - c, 0.0), 0.0)
    top = min(root**2, rupture.distance_km)
    surface = float(np.sqrt(rupture.distance_km**2 - top**2))
    keys = {
        "mag": rupture.magnitude, "dist_rup": rupture.distance_km, "dist_jb": surface,
        "dist_x": -surface, "v_s30": rupture.vs30_mps, "dip": rupture.dip,
        "mechanism": rupture.mechanism, "depth_tor": top, "on_hanging_wall": False,
        "region": rupture.region,
    }  # fmt: skip
    return {key: value for key, value in keys.items() if value is not None}


def _beyond(kind: Any, keys: dict[str, Any], model: str) -> Iterator[str]:
    for parameter in (each for each in kind.PARAMS if each.name in keys):
        value = keys[parameter.name]
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


def correlation(first: ArrayLike, second: ArrayLike) -> NDArray[np.float64]:
    """Correlation of ln Sa at periods [s], broadcast, about the median of a ground-motion model.

    Baker and Jayaram (2008), Earthquake Spectra 24(1), 299-317, as pygmm computes it; InputError
    for a period outside 0.01 to 10 s, where it was fitted.
    """
    from pygmm.baker_jayaram_2008 import calc_correls  # half a second

    both = [np.asarray(periods, dtype=np.float64) for periods in (first, second)]
    values = np.concatenate([periods.ravel() for periods in both])
    outside = values[~((values >= SHORTEST) & (values <= LONGEST))]
    if outside.size:
        raise InputError(
            f"period {outside[0]:g} s is outside {SHORTEST:g} to {LONGEST:g} s, for which the "
            "correlations of Baker and Jayaram (2008) were fitted"
        )
    return np.asarray(calc_correls(*both), dtype=np.float64)
