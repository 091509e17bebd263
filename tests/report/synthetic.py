"""A made-up study with the shape and names of a real cube; no simulation behind it."""

from dataclasses import replace

import numpy as np
import xarray as xr

from archfrag.arch import Arch
from archfrag.fragility.curve import Curve
from archfrag.fragility.verdicts import Verdict
from archfrag.motions.motion import Motion
from archfrag.physics.status import CollapseMode
from archfrag.report.inputs import ReportInputs, Scale
from archfrag.simulation.simulate import onset
from archfrag.study.answer.curves import curve_of as fitted_curve
from archfrag.study.answer.curves import runs_of_cube

GRAVITY = 9.80665
SCALE = Scale("PGA", "g", 1.0 / GRAVITY)


def motions(n_record=6, seed=1):
    """Enveloped noise, named as records of a catalogue are."""
    generator = np.random.default_rng(seed)
    time = np.arange(0.0, 20.0, 0.01)
    envelope = (time / 3.0) * np.exp(1.0 - time / 3.0)
    made = []
    for i in range(n_record):
        scale = generator.uniform(0.5, 4.0) * envelope
        noise = np.convolve(
            generator.standard_normal(time.size), np.ones(8) / 8, "same"
        )
        made.append(
            Motion(scale * noise, 0.01, id=f"RSN{100 + i}_EVENT{i:02d}_STA{i:03d}")
        )
    return made


def arch_and_onset(voussoirs=7):
    """The arch of the reference values."""
    arch = Arch.circular(10.0, 1.5, 157.5, voussoirs, 0.7)
    return arch, onset(arch)


def cube(
    names=("ring",), items=None, n_level=9, n_joint=8, theta=4.0, beta=0.4, seed=2
):
    """Cube as the study writes it: SI units, flags as bytes, names as strings."""
    generator = np.random.default_rng(seed)
    items = items or motions()
    records = [motion.id for motion in items]
    peaks = np.array([np.abs(motion.acceleration).max() for motion in items])
    intensity = np.linspace(1.0, 8.0, n_level)
    shape = (len(names), len(records), n_level)
    record_to_record = generator.standard_normal((*shape[:2], 1))
    capacity = theta * np.exp(
        beta * record_to_record + 0.08 * generator.standard_normal(shape)
    )
    verdict = (capacity < intensity).astype(np.int8)
    verdict[0, 0, -1] = Verdict.UNFINISHED
    verdict[0, 1:2, -2] = Verdict.FAILED
    fell = verdict == Verdict.COLLAPSED
    impacts = generator.choice([0, 1, 2, 300], shape, p=[0.3, 0.2, 0.1, 0.4])
    mode = generator.choice(
        [CollapseMode.HINGING, CollapseMode.SLIDING], shape, p=[0.85, 0.15]
    )
    end = generator.uniform(20.0, 26.0, shape)
    moving = np.clip(intensity / 12.0, 0.0, 0.9) * end
    dims = ("arch", "record", "level")
    of_runs = {
        "verdict": verdict,
        "status": verdict,
        "collapse_time": np.where(fell, 0.4 * end, np.nan),
        "collapse_joint": np.where(fell, generator.integers(0, n_joint, shape), -1),
        "collapse_mode": np.where(fell, mode, 0),
        "lost_contact_time": np.where(fell, 0.3 * end, np.nan),
        "peak_rotation": generator.uniform(0, 0.1, shape),
        "residual_rotation": np.full(shape, 0.01),
        "peak_displacement": generator.uniform(0, 0.4, shape),
        "energy_error": 10.0 ** generator.normal(-8, 0.7, shape),
        "end_time": end,
        "steps": (moving * 1000).astype(int),
        "impacts": impacts,
        "contact_residual": 10.0 ** generator.normal(-13, 0.5, shape),
    }
    for name in ("events", "switches", "levels", "general", "fallbacks"):
        of_runs[name] = generator.integers(0, 40, shape)
    parts = [end - moving, *(part * moving for part in (0.3, 0.6, 0.1))]
    given = {name: (dims, values) for name, values in of_runs.items()}
    labels = {"arch": list(names), "record": records, "level": np.arange(n_level)}
    data = xr.Dataset(given, coords=labels)
    data.attrs = {"archfrag_design": '{"kind": "stripes"}', "Conventions": "CF-1.11"}
    data.attrs["loss_limit"] = "0.5"
    data["verdict"].attrs["flag_values"] = np.arange(4, dtype=np.int8)
    return data.assign(
        model_time=((*dims, "model"), np.stack(parts, axis=-1)),
        model=["rest", "four_hinges", "mega_voussoirs", "all_voussoirs"],
        scale_factor=(("record", "level"), intensity / peaks[:, None]),
        intensity=(
            "level",
            intensity,
            {"units": "m s-2", "long_name": "PGA", "measure": "PGA"},
        ),
        static_limit=("arch", np.full(len(names), 0.2)),
        event=("record", [""] * len(records)),
        record_vertical=("record", np.zeros(len(records), np.int8)),
        onset_plus=("arch", np.full(len(names), np.inf)),
        onset_minus=("arch", np.full(len(names), np.inf)),
        magnitude=("record", generator.uniform(5.5, 7.5, len(records))),
        distance=("record", generator.uniform(5.0, 60.0, len(records))),
    )


def inputs(names=("ring",), n_record=6, n_level=9, voussoirs=7, **changes):
    """Everything `write_report` takes, for a small made-up study."""
    items = motions(n_record)
    arch, start = arch_and_onset(voussoirs)
    data = cube(names, items, n_level, arch.n_joint)
    values = {
        "cube": data,
        "scale": SCALE,
        "motions": items,
        "arches": dict.fromkeys(names, start),
        "answers": answers_of(changes.get("cube", data)),
        "timings": {name: [0.05] * (n_record * n_level) for name in names},
    }
    return ReportInputs(**(values | changes))


def in_g(curve):
    """A curve as the report shows it."""
    return curve.in_unit(GRAVITY, "PGA", "g")


def answers_of(data):
    """Curve of each arch, as `archfrag fit` stores it."""
    return {name: fitted_curve(runs, 0.9) for name, runs in runs_of_cube(data).items()}


def none(why):
    """Answer of an arch without a curve."""
    return Curve(reason=why, likelihood=Curve(reason=why))


def curve_of(theta, beta=0.4):
    return Curve(theta, beta, np.diag([0.01, 0.005]), -10.0, 9, 54, "stripes")


def answer_of(theta):
    """An answer with a band of a tenth to both sides."""
    im = np.linspace(0.0, 8.4, 120)
    chance = curve_of(theta).probability(im)
    return replace(
        curve_of(theta),
        likelihood=curve_of(1.01 * theta),
        intervals=((0.8 * theta, 1.2 * theta), (0.3, 0.6)),
        im=im.tolist(),
        lower=(0.9 * chance).tolist(),
        upper=(1.1 * chance).tolist(),
        method="made up",
        assumptions="Nothing is assumed.",
        n_independent=6.0,
        n_non_monotone=2,
    )


MEASURES = {
    "message": "PGV is best.",
    "best": "PGV",
    "rows": [
        {
            "measure": name,
            "unit": unit,
            "theta": theta,
            "beta": beta,
            "efficiency": beta,
            "p_magnitude": "nan",
            "p_distance": 0.5,
            "sufficient": True,
        }
        for name, unit, theta, beta in (
            ("PGA", "m/s2", 4.0, 0.42),
            ("Arias", "m/s", "nan", "nan"),
            ("PGV", "m/s", 0.3, 0.3),
        )
    ],
}
STATES = (
    replace(curve_of(1.0), state="motion", meaning="a joint opens"),
    Curve(reason="all collapse", state="impact", meaning="a joint closes"),
)
