"""Demand and capacity for the limit states of building codes.

NTC 2018 (D.M. 17 January 2018), 2.4 and table 3.2.I: T_R = -V_R / ln(1 - P_VR), V_R = C_U V_N,
P_VR = 10 % (SLV) and 5 % (SLC). EN 1998-3:2005, 2.1(3), recommends 475 (SD) and 2475 years (NC);
national annexes may differ. NTC 2018, 8.3, calls capacity over demand zeta_E, as the guidelines
for bridges of 2020 (D.M. 578/2020) do. Neither gives a fragility curve or a probability at the
capacity.
"""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from archfrag.fragility.curve import Curve
from archfrag.fragility.risk import collapse_rate
from archfrag.study.answer.rates import StudyRisk
from archfrag.study.file.schema import CodeKeys

_USE = {"I": 0.7, "II": 1.0, "III": 1.5, "IV": 2.0}  # C_U, table 2.4.II
_EXCEEDED = {"SLV": 0.10, "SLC": 0.05}  # P_VR
_PERIODS = {"SD": 475.0, "NC": 2475.0}  # [years]
COLUMNS = (
    "arch",
    "code_state",
    "return_period",
    "demand",
    "limit_state",
    "probability",
    "capacity",
    "ratio",
    "rate",
    "rate_is_lower_bound",
)


def return_periods(code: CodeKeys) -> dict[str, float]:
    """Return the return periods of the limit states of a code [years]."""
    if code.norm == "eurocode8":
        return dict(_PERIODS)
    life = _USE[code.use_class] * code.life
    return {name: -life / np.log1p(-p) for name, p in _EXCEEDED.items()}


def code_table(
    curves: Mapping[str, Curve], risk: StudyRisk, code: CodeKeys
) -> pd.DataFrame:
    """Return a row for each arch, limit state of the code, and limit state that has a curve.

    `curves` have intensities in one unit, in which demand and capacity are given. The demand is
    the hazard curve's intensity, nan beyond its points; the capacity is the largest intensity at
    which the curve's probability is at most that of `code`. `ratio` is capacity over demand,
    `rate` the annual rate at which the limit state is exceeded [1/year].
    """
    rows = list[tuple]()
    for name, curve in curves.items():
        arch = risk.arches[name]
        if isinstance(arch, str):
            continue
        of_si = arch.fit.limit_states
        for state, own in curve.limit_states.items():
            onset = arch.onset if own.members is not None else np.min(arch.onset)
            rate = collapse_rate(risk.hazard.main, of_si[state], onset=onset)
            capacity = float(own.quantile(code.probability))
            for word, years in return_periods(code).items():
                demand = float(risk.hazard.main.level_of(years)) / own.si
                site = name, word, years, demand
                allowed = state, code.probability, capacity, capacity / demand
                rows.append((*site, *allowed, rate.quoted, rate.is_bound))
    return pd.DataFrame(rows, columns=list(COLUMNS))
