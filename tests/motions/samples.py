"""Small files with made-up numbers in the layouts of the text formats that archfrag reads."""

from pathlib import Path

import numpy as np

from .helpers import at2_text, wave

G = 980.665  # [cm/s2]
BEARINGS = ("90 DEG", "UP", "360 DEG")
KIKNET = {"NS1": 1, "EW1": 2, "UD1": 3, "NS2": 4, "EW2": 5, "UD2": 6}
COSMOS_STAGES = (
    "Raw acceleration counts  ",
    "Uncorrected acceleration ",
    "Corrected acceleration   ",
)
COSMOS_UNITS = {
    2: ("g.     (02)", "{:9.6f}", 8, "(8f9.6)"),
    4: ("cm/sec2(04)", "{:10.5f}", 8, "(8F10.5)"),
    50: ("counts (50)", "{:8.0f}", 10, "(10I8)"),
}


def layout(name, **values):
    """Lines of a header."""
    path = Path(__file__).parent / "layouts" / f"{name}.txt"
    return path.read_text().format(**values).split("\n")[:-1]


def columns(values, form, number):
    """Rows of so many values, each in a Python format."""
    cells = [form.format(value) for value in values]
    return ["".join(cells[i : i + number]) for i in range(0, len(cells), number)]


def components(count=400):
    """A horizontal, a vertical and another horizontal acceleration [g]."""
    return 0.1 * wave(count), 0.05 * wave(count, frequency=3.0), -0.2 * wave(count)


def largest(values):
    return values[np.abs(values).argmax()]


def lines_of(*rows):
    return "\n".join([*rows, ""])


def dmg_v1(
    channels=None, bearings=BEARINGS, dt=0.01, total=None, peak=None, jitter=None
):
    """CSMIP volume 1 [g]; of film, pairs of time and acceleration [g/10], with a `jitter`."""
    lines = []
    channels = components() if channels is None else channels
    for number, (bearing, values) in enumerate(zip(bearings, channels), start=1):
        count = len(values)
        film = jitter is not None
        facts = {
            "number": number,
            "bearing": bearing,
            "count": count,
            "length": count * dt,
        }
        stated = np.abs(values).max() if peak is None else peak
        lines += layout(
            "dmg_1",
            **facts,
            unit="g/10" if film else "g",
            peak=stated,
            total=total or len(channels),
        )
        lines += columns([0] * 100, "{:5d}", 16)
        lines += columns([0.0] * 28 + [34.063, -117.785] + [0.0] * 20, "{:10.4f}", 8)
        if film:
            times = np.round(dt * np.arange(count), 3)
            times[3::7] += jitter
            lines += columns(
                np.column_stack([times, 10.0 * values]).ravel(), "{:7.3f}", 10
            )
        else:
            rate = f"{count} Accelerogram points at {1 / dt:.0f} pts/sec"
            lines.append(f" {rate} in units of g.   Format: (8f9.6)")
            lines += columns(values, "{:9.6f}", 8)
        lines.append(f"/&  ----------  End of Data for Channel  {number}  ----------")
    return lines_of(*lines)


def dmg_pairs(dt=0.005, jitter=0.001):
    """CSMIP volume 1 of digitised film."""
    return dmg_v1(dt=dt, jitter=jitter)


def dmg_v2(dt=0.02, peak=None):
    """CSMIP volume 2 [cm/s2], with velocity and displacement."""
    lines = []
    for number, (bearing, values) in enumerate(zip(BEARINGS, components()), start=1):
        count = len(values)
        stated = largest(G * values) if peak is None else peak
        lines += layout(
            "dmg_2", number=number, bearing=bearing, count=count, dt=dt, peak=stated
        )
        lines += [
            *columns([0] * 100, "{:5d}", 16),
            *columns([0.0] * 100, "{:10.3f}", 8),
        ]
        for kind, unit, factor in (
            ("ACCEL", "/SEC/SEC", G),
            ("VELOC", "/SEC", 1),
            ("DISPL", "", 1),
        ):
            rate = f"{kind} DATA EQUALLY SPACED AT  {dt:.3f} SEC.  (UNITS: CM{unit})"
            lines += [
                f" {count} POINTS OF {rate}",
                *columns(factor * values, "{:10.3f}", 8),
            ]
        lines.append(f"/&  ----------  END OF DATA FOR CHANNEL  {number}  ----------")
    return lines_of(*lines)


def cosmos(stage=1, unit=2, dt=0.005, factor=1.0, total=3, **reals):
    """COSMOS V0, V1 or V2; `factor` converts [g] to the unit of the file."""
    lines = []
    names = (("HNN", "360 deg"), ("HNZ", "Up"), ("HNE", "90 deg"))
    for number, (values, (code, bearing)) in enumerate(
        zip(components(), names), start=1
    ):
        data, (name, form, width, fortran) = factor * values, COSMOS_UNITS[unit]
        integers = np.full(100, -999)
        numbers = np.full(100, -999.0)
        integers[:4] = stage, 1, unit, 120
        numbers[[0, 1, 9, 10, 11, 12, 16]] = (
            34.0625,
            -117.785,
            34.2,
            -116.8,
            8.0,
            5.6,
            45.0,
        )
        numbers[[33, 61, 62, 63]] = dt, 1000.0 * dt, dt * len(data), largest(data)
        for key, value in reals.items():
            numbers[int(key[1:])] = value
        lines += [
            *layout(
                "cosmos",
                kind=COSMOS_STAGES[stage],
                total=total,
                number=number,
                bearing=bearing,
            ),
            " 100 Integer-header values follow on  10 lines, Format= (10I8)",
            *columns(integers, "{:8d}", 10),
            " 100 Real-header values follow on  17 lines, Format= (6F13.6)",
            *columns(numbers, "{:13.6f}", 6),
            '   1 Comment line(s) follow, each starting with a "|":',
            f"|<SCNL>99999.{code}.CE.--   <AUTH>CE 2018/08/29",
            f"   {len(data)} acceleration pts, approx  2 secs, units={name}Format={fortran}",
            *columns(data, form, width),
            f"End-of-data for Chan  {number} acceleration",
        ]
    return lines_of(*lines)


def scientific(value):
    """A number in ten columns with an exponent of one digit, as SMC files have it."""
    mantissa, exponent = f"{value if abs(value) > 1e-9 else 0.0:.4E}".split("E")
    return f"{mantissa}E{int(exponent):+d}".rjust(10)


def smc(
    values=None,
    dt=0.005,
    kind="2 CORRECTED ACCELEROGRAM",
    count=None,
    times=None,
    filler=0,
    peak=None,
):
    """SMC file [cm/s2]; pairs of time and acceleration where `times` are given."""
    data = G * (components()[0] if values is None else np.asarray(values))
    numbers = data if times is None else np.column_stack([times, data]).ravel()
    integers = np.full(48, -32768)
    reals = np.full(50, 1.7e38)
    integers[[1, 2, 3, 4, 8, 12, 13]] = 1989, 291, 0, 4, 1, 90, 133
    integers[16] = len(numbers) if count is None else count
    reals[[2, 3, 4, 5, 10, 11, 16]] = 37.037, -121.883, 18.0, 6.9, 37.52, -122.25, 63.0
    reals[29], reals[31] = data.max() if peak is None else peak, data.min()
    if times is None:
        reals[1] = 1.0 / dt
    rows = [scientific(value) for value in (*numbers, *[1.0] * filler)]
    lines = [
        *layout("smc", kind=kind, bearing="133"),
        *columns(integers, "{:10d}", 8),
        *columns(reals, "{:15.7E}", 5),
        "|",
        "|ref - nobody, nowhere",
        "|",
        *columns(rows, "{}", 8),
    ]
    return lines_of(*(line.ljust(80) for line in lines))


def dyna_text(samples, name="dyna", *, count=None, peak=None, **changes):
    """ESM's header, or ITACA's; `changes` are other values of its keys, None leaves a key out."""
    peak = np.abs(samples).max() if peak is None else peak
    rows = layout(name, count=len(samples) if count is None else count, peak=peak)
    header = dict(row.split(":", 1) for row in rows)
    header |= {key.upper(): value for key, value in changes.items()}
    lines = (f"{key}:{value}" for key, value in header.items() if value is not None)
    return lines_of(*lines, *(f"{value:.6f}" for value in samples))


def resorce_text(samples, *, count=None, peak=None):
    """RESORCE [m/s2]."""
    peak = np.abs(samples).max() if peak is None else peak
    header = layout(
        "resorce", count=len(samples) if count is None else count, peak=peak
    )
    return lines_of(*header, *columns(samples, "{:14.7E}", 5))


def geonet_text(channels, *, raw=True, count=None, dt=0.005, peak=None):
    """Components by name, each a row of accelerations [mm/s2]; V2A where the level is not raw."""
    lines = []
    for component, samples in channels.items():
        n = len(samples) if count is None else count
        data = (
            f"Raw readings in units of 1.00 mm/s/s  at intervals of {dt:.3f} s"
            if raw
            else f"Instrument corrected data at {dt:.3f} sec intervals"
        )
        lines += layout(
            "geonet",
            kind="Unc" if raw else "C",
            count=n,
            length=(n - 1) * dt,
            data=data,
            component=component,
            peak=largest(samples) if peak is None else peak,
        )
        integers = [0] * 40
        integers[8] = 2001
        integers[9] = 2
        integers[18] = 3
        integers[19] = 4
        integers[33:36] = [n, 0, 0] if raw else [n, n, n]
        integers[38:] = [4, 57250]
        lines += columns(integers, "{:8d}", 10) + columns([0.0] * 60, "{:8.2f}", 10)
        lines += columns(samples, "{:8.1f}", 10)
        if not raw:  # the last columns run together
            lines += columns(np.cumsum(samples) * dt, "{:8.2f}", 10)
            lines += columns(1000.0 + np.arange(len(samples)), "{:8.3f}", 10)
    return lines_of(*lines)


def knet_text(counts, direction="E-W", length=None, scale=8_000_000):
    """K-NET of counts of 2000 gal / `scale`, with an offset; of KiK-net by number of channel."""
    gal = np.abs(counts - counts.mean()).max() * 2000.0 / scale
    length = len(counts) / 100 if length is None else length
    height = 502.5 if direction in (1, 2, 3) else 720
    header = layout(
        "knet", height=height, direction=direction, length=length, scale=scale, peak=gal
    )
    return lines_of(*header, *columns(counts, "{:9d}", 8))


# Small files of each format: what mutations start from, and what nobody else may claim.
MADE_UP = {
    "AT2": (lambda: at2_text(components()[0]),),
    "COSMOS": (
        cosmos,
        lambda: cosmos(2, 4, factor=G),
        lambda: cosmos(0, 50, factor=1e5),
    ),
    "DMG": (dmg_v1, dmg_pairs, dmg_v2),
    "DYNA": (
        lambda: dyna_text(98.0 * wave(400)),
        lambda: dyna_text(98.0 * wave(400), "itaca"),
    ),
    "GEONET": (
        lambda: geonet_text(
            dict(zip(("S16W", "Up", "N74W"), 9800.0 * np.array(components())))
        ),
        lambda: geonet_text({"S16W": 980.0 * wave(400)}, raw=False),
    ),
    "RESORCE": (lambda: resorce_text(0.98 * wave(400)),),
    "SMC": (
        smc,
        lambda: smc(kind="1 UNCORRECTED ACCELEROGRAM", times=0.003 * np.arange(400)),
    ),
}
