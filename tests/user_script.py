"""What a user may write: every public name, read by ``mypy --strict`` and run by a test."""

from pathlib import Path

import numpy as np

import archfrag as af


def arches() -> dict[str, af.Arch]:
    """A drawing, a column and a block."""
    edge = np.array([[0.2, 0.0], [0.2, 0.8], [0.18, 1.6]])
    column = af.Arch.from_joints(edge, edge * [-1, 1], friction=0.8, free_end=True)
    bridge = af.Arch.from_dxf("bridge.dxf", friction=0.6)
    return {
        "bridge": bridge,
        "column": column,
        "block": af.Block(0.4, 2.0, friction=0.8),
    }


def motions() -> list[af.Motion]:
    """Two motions of one shape, from a text and as an array."""
    time = np.arange(150) * 0.01
    wave = 3.0 * np.sin(9.0 * time) * np.sin(np.pi * time / 1.5)
    np.savetxt("wave.txt", wave)
    columns = af.Columns(acceleration=1, dt=0.01)
    one = af.read_motion("wave.txt", unit="m/s2", columns=columns)
    (same,) = af.read_motions("wave.txt", unit="m/s2", columns=columns)
    assert one.pga == same.pga
    return [one, 1.5 * af.Motion(wave[::-1], dt=0.01, id="backwards")]


def single_runs(arch: af.Arch, motion: af.Motion) -> float:
    """The onset of motion, one run, and several at once."""
    start: af.Onset = af.onset(arch)
    response: af.Response = af.simulate(arch, motion, scale=0.5, history=True)
    collapsed: bool | None = response.collapsed
    runs = af.simulate_many(arch, motion, [0.5, 1.0])
    assert runs.collapsed.size == 2
    assert collapsed is not None
    return start.plus


def fits() -> float:
    """Curves of counts and of capacities."""
    curve: af.Curve = af.fit_stripes(im=[0.4, 0.8, 1.2], collapses=[1, 6, 14], n=20)
    return curve.theta / af.fit_ida([0.3, 0.5, 0.9]).theta


def study(arch: af.Arch) -> af.Results:
    """A study, its file, and its results."""
    friction = {"distribution": "uniform", "start": 0.6, "stop": 0.8}
    made = af.Study(
        {"column": arch},
        motions(),
        "PGA",
        levels=np.linspace(0.2, 1.4, 7),
        design="ida",
        vary={"samples": 2, "friction": friction},
        id="user",
    )
    path: Path = made.to_file("user.yaml")
    assert af.Study.from_file(path).id == made.id
    made.run(progress=False, cores=1)
    return af.open(made.folder)


def answers(results: af.Results) -> dict[str, float]:
    """All that results offer."""
    curve: af.Curve = results.curve
    low, high = curve.band([0.4, 0.8])
    axes = curve.limit_states["collapse"].plot(
        results.curves["column"].plot(), color="k"
    )
    assert low.shape == high.shape == curve([0.4, 0.8]).shape
    assert axes.get_xlabel() == "PGA [g]"
    Path("hazard.csv").write_text("PGA [g],rate\n0.1,0.01\n0.5,0.001\n2.0,0.0001\n")
    rates = results.risk("hazard.csv", years=100.0)
    results.response("backwards@0.6", arch="column-0001").animate(seconds=0.4).save(
        "fall.gif"
    )
    film = results.film("median")
    assert film is not None
    files = [
        results.report(),
        results.to_nrml("bridge.xml"),
        *results.to_pelicun("out"),
    ]
    files += [*results.to_incore("out"), *results.to_csv("out", members=True)]
    assert all(path.is_file() for path in files)
    assert len(results.capacities) == 2 * results.runs.sizes["arch"]
    return {"theta": curve.theta, "p": curve(0.8), "rate": float(rates["rate"].iloc[0])}


if __name__ == "__main__":
    every = arches()
    print(single_runs(every["block"], motions()[0]), fits())
    print(answers(study(every["column"])))
