"""The same study with other numbers of voussoirs: whether its curves depend on the number."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from archfrag.errors import InputError
from archfrag.files import make_folder, write_csv
from archfrag.study.file.arches import PROFILES
from archfrag.study.file.members import check_buildable, checked
from archfrag.study.file.schema import Study
from archfrag.study.steps import finished

CONVERGE = "converge.csv"
_DIVIDED = [name for name, (needed, _) in PROFILES.items() if "voussoirs" in needed]


def with_voussoirs(study: Study, counts: Sequence[int]) -> dict[int, Study]:
    """Return the study with each number of voussoirs, in folders of their own in its results.

    InputError if there are fewer than two numbers, or an arch has no such key or cannot exist.
    """
    if len(set(counts)) < 2:
        raise InputError(f"voussoirs = {list(counts)} must be two different numbers or more")
    for number, entry in enumerate(study.arches):
        own = [k for k in ("table", "drawing", "joints") if getattr(entry, k) is not None]
        if own or entry.profile not in _DIVIDED:
            what = f"a key {own[0]}" if own else f"profile {entry.profile}"
            known = f"must be of profile {', '.join(_DIVIDED)}, without joints of its own"
            raise InputError(f"arches[{number}] ({entry.id}) has {what}; to converge it {known}")
    found = {}
    for count in dict.fromkeys(counts):
        arches = [entry.model_copy(update={"voussoirs": count}) for entry in study.arches]
        folder = str(study.folder / "converge" / f"voussoirs-{count}")
        found[count] = study.model_copy(update={"arches": arches, "output": folder})
        check_buildable(checked(found[count].members))
    return found


def write_convergence(study: Study, made: dict[int, Study]) -> pd.DataFrame:
    """Write and return ``converge.csv`` of finished studies, by their numbers of voussoirs.

    `ratio` is that of theta to theta of the last number, `scatter` the standard deviation of the
    logarithm of the same ratio of capacities, over the `records` that have both.
    """
    rows: list[list[Any]] = []
    last: dict[str, tuple[float, Any]] = {}
    for count in reversed(made):
        fitted = finished(made[count])
        answers = fitted.quoted()
        every = {name: fitted.runs[name].brackets.middle for name in answers}
        for name, curve in answers.items():
            theta, beta = curve.theta, curve.beta
            thetas = np.array([theta, *curve.theta_interval]) / study.intensity.factor
            base = last.setdefault(name, (theta, every[name]))
            logs = np.log(every[name] / base[1])
            known = logs[np.isfinite(logs)]
            scatter = known.std(ddof=1) if known.size > 1 else np.nan
            ratio = theta / base[0]
            betas = beta, *curve.beta_interval
            rows.append([name, count, *thetas, *betas, ratio, scatter, known.size])
    ends = [f"theta{end} [{study.intensity.unit}]" for end in ("", "_lower", "_upper")]
    heads = ["arch", "voussoirs", *ends, "beta", "beta_lower", "beta_upper"]
    table = pd.DataFrame(rows[::-1], columns=[*heads, "ratio", "scatter", "records"])
    table = table.sort_values("arch", kind="stable", ignore_index=True)
    write_csv(make_folder(study.folder) / CONVERGE, [table], float_format="%.7g")
    return table
