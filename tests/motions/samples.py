"""Small files with made-up numbers in the layouts of the text formats that archfrag reads."""

import numpy as np

from .helpers import at2_text, wave

G = 980.665  # [cm/s2]


def columns(values, form, number):
    """Rows of so many values, each in a Python format."""
    cells = [form.format(value) for value in values]
    return ["".join(cells[i : i + number]) for i in range(0, len(cells), number)]


def components(count=400):
    """A horizontal, a vertical and another horizontal acceleration [g]."""
    return 0.1 * wave(count), 0.05 * wave(count, frequency=3.0), -0.2 * wave(count)


def _volume_1(number, bearing, count, dt, units, peak, total):
    """Header of a channel of CSMIP volume 1."""
    return [
        "Uncorrected Accelerogram Data             Processed: 01/02/18, CGS  made-up",
        "MADE-UP EARTHQUAKE",
        "JANUARY 2, 2018 08:05 PST               (Origin(USGS): 01/02/18, 16:05:30.5 UTC)",
        "99999-L0001-18002.01                 Start time:  1/ 2/18, 16:05:37.4 UTC (GPS)",
        f"Station No. 99999   34.063N, 117.785W    Etna    s/n 1 ({total} Chns of  3 at Sta)",
        "Made-up Town - First & Main               CGS   Data: Acceleration",
        f"Chan  {number}: {bearing}",
        "MADE-UP EARTHQUAKE     JANUARY 2, 2018 08:05 PST",
        "HYPOCENTER(USGS): 34.201N,116.826W, H=7KM.     MS=6.6(NEIC), MW=6.4(CIT)",
        "Instr Period =  .0111 sec,  Damping =  .670,  Sensitivity =  .63 v/g",
        f"No. of Points =  {count}  Record Length ={count * dt:7.3f} sec",
        f"Units of uncor data are sec and {units}.     Max  = {peak:7.3f} g, at   1.0 s.",
        "RMS calc for complete record =        .",
        *columns([0] * 100, "{:5d}", 16),
        *columns([0.0] * 28 + [34.063, -117.785] + [0.0] * 20, "{:10.4f}", 8),
    ]


BEARINGS = ("90 DEG", "UP", "360 DEG")


def dmg_v1(channels=None, bearings=BEARINGS, dt=0.01, unit="g", total=None, peak=None):
    """CSMIP volume 1 with equal steps [g]."""
    lines = []
    channels = components() if channels is None else channels
    for number, (bearing, values) in enumerate(zip(bearings, channels), start=1):
        stated = np.abs(values).max() if peak is None else peak
        lines += [
            *_volume_1(number, bearing, len(values), dt, unit, stated, total or len(channels)),
            f" {len(values)} Accelerogram points at {1 / dt:.0f} pts/sec in units of {unit}.   "
            "Format: (8f9.6)",
            *columns(values, "{:9.6f}", 8),
            f"/&  ----------  End of Data for Channel  {number}  ----------",
        ]
    return "\n".join(lines) + "\n"


def dmg_pairs(channels=None, dt=0.005, jitter=0.001):
    """CSMIP volume 1 of digitised film: pairs of time and acceleration [g/10]."""
    lines = []
    channels = components() if channels is None else channels
    for number, (bearing, values) in enumerate(zip(BEARINGS, channels), start=1):
        times = np.round(dt * np.arange(len(values)), 3)
        times[3::7] += jitter
        pairs = np.column_stack([times, 10.0 * values]).ravel()
        peak = np.abs(values).max()
        lines += [
            *_volume_1(number, bearing, len(values), dt, "g/10", peak, len(channels)),
            *columns(pairs, "{:7.3f}", 10),
            f"/&  ----------  END OF DATA FOR CHANNEL  {number}  ----------",
        ]
    return "\n".join(lines) + "\n"


def dmg_v2(channels=None, bearings=("90 DEG", "UP", "0 DEG"), dt=0.02, peak=None):
    """CSMIP volume 2 [cm/s2], with velocity and displacement."""
    lines = []
    for number, (bearing, values) in enumerate(
        zip(bearings, components() if channels is None else channels), start=1
    ):
        acceleration = G * values
        stated = acceleration[np.abs(acceleration).argmax()] if peak is None else peak
        count = len(values)
        lines += [
            f"CORRECTED ACCELEROGRAM   99999-S0001-83123.01       CHAN  {number}:  {bearing}  "
            " FROM",
            "UNCORRECTED ACCELEROGRAM DATA              PROCESSED:  6/06/83, CDMG MADE-UP",
            "MADE-UP EARTHQUAKE",
            "MAY 2, 1983 16:42 PDT                   (ORIGIN(BRK): 05/02/83, 23:42:38.5 UTC)",
            "99999-S0001-83123.01               TRIGGER TIME: 05/02/83, 16:42:48.2 PDT",
            "STATION NO. 99999   35.908N, 120.458W     SMA-1  S/N 4384",
            "MADE-UP FAULT ZONE 14",
            f"CHAN  {number}:  {bearing}",
            "MADE-UP EARTHQUAKE     MAY 2, 1983 16:42 PDT",
            "HYPOCENTER(BRK): 36.25N,120.28W, H=9KM. PRELIMINARY SOLUTION.  ML=6.5(BRK)",
            "INSTR PERIOD =  .0407 SEC,  DAMPING =  .630,  SENSITIVITY = 1.87 CM/G.",
            "                        RECORD LENGTH = 65.000 SEC.",
            "                                     UNCOR MAX  =  -.275 G, AT  10.947 SEC.",
            "RMS ACCEL OF (UNCOR) RECORD  =  .030 G.",
            "ACCELEROGRAM BANDPASS FILTERED WITH RAMPS AT  .050- .100 AND 23.00-25.00 CYC/SEC",
            f"  {count} POINTS OF INSTRUMENT- AND BASELINE-CORRECTED ACCEL, VELOC AND DISPL DATA",
            f"AT EQUALLY-SPACED INTERVALS OF    {dt:.3f}  SEC.",
            f"PEAK ACCELERATION =  {stated:.3f}    CM/SEC/SEC  AT   10.940   SEC.",
            "PEAK   VELOCITY   =   -28.253      CM/SEC    AT   11.100   SEC.",
            "PEAK DISPLACEMENT =     5.449        CM      AT    7.660   SEC.",
            "INITIAL VELOCITY  =     -.052   CM/SEC;   INITIAL DISPLACEMENT =    -.110   CM",
            "MADE-UP EARTHQUAKE     MAY 2, 1983 16:42 PDT",
            "",
            f"99999-S0001-83123.01      MADE-UP FAULT ZONE 14   CHAN  {number}:  {bearing}",
            "",
            *columns([0] * 100, "{:5d}", 16),
            *columns([0.0] * 100, "{:10.3f}", 8),
        ]
        kinds = ("ACCEL", "CM/SEC/SEC"), ("VELOC", "CM/SEC"), ("DISPL", "CM")
        for (kind, unit), row in zip(kinds, (acceleration, 0.1 * values, 0.01 * values)):
            lines += [
                f" {count} POINTS OF {kind} DATA EQUALLY SPACED AT  {dt:.3f} SEC.  "
                f"(UNITS: {unit})",
                *columns(row, "{:10.3f}", 8),
            ]
        lines.append(f"/&  ----------  END OF DATA FOR CHANNEL  {number}  ----------")
    return "\n".join(lines) + "\n"


COSMOS_STAGES = {0: "Raw acceleration counts  ", 1: "Uncorrected acceleration ",
                 2: "Corrected acceleration   "}  # fmt: skip
COSMOS_UNITS = {2: "g.     (02)", 4: "cm/sec2(04)", 50: "counts (50)"}


def cosmos(stage=1, unit=2, channels=None, dt=0.005, factor=1.0, total=None, scnl=True, **reals):
    """COSMOS V0, V1 or V2; `factor` converts [g] to the unit of the file."""
    lines = []
    channels = components() if channels is None else channels
    names = (("HNN", "360 deg"), ("HNZ", "Up"), ("HNE", "90 deg"))
    for number, (values, (code, bearing)) in enumerate(zip(channels, names), start=1):
        data = factor * values
        integers = np.full(100, -999)
        integers[:4] = stage, 1, unit, 120
        numbers = np.full(100, -999.0)
        numbers[[0, 1, 9, 10, 11, 12, 16]] = 34.0625, -117.785, 34.2, -116.8, 8.0, 5.6, 45.0
        numbers[[33, 61, 62]] = dt, 1000.0 * dt, dt * len(data)
        numbers[63] = data[np.abs(data).argmax()]
        for key, value in reals.items():
            numbers[int(key[1:])] = value
        cells = {50: ("{:8.0f}", 10, "(10I8)"), 2: ("{:9.6f}", 8, "(8f9.6)"),
                 4: ("{:10.5f}", 8, "(8F10.5)")}[unit]  # fmt: skip
        lines += [
            f"{COSMOS_STAGES[stage]} (Format v01.20 with 13 text lines) Src:  made-up",
            "Record of Made-up Earthquake of Tue Aug 28, 2018 19:33 UTC",
            "Hypocenter: 34.2000 -116.8000   H=  8km       ML= 5.5 Mw=5.6",
            "Origin: 08/28/2018, 19:33:26.1 UTC",
            "Statn No: 05- 99999 Code:CE-99999  CGS  Made-up Town - First & Main",
            "Coords: 34.063  -117.785   Site geology:",
            f"Recorder: Etna   s/n 1193 ({total or len(channels)} Chns of   3 at Sta) Sensor: FBA",
            "Rcrd start time: 8/28/2018, 19:33: 9.0 UTC (Q=5) RcrdId: 99999-L1193-18241.36",
            f"Sta Chan  {number}: {bearing} (Rcrdr Chan  {number})",
            "Raw record length =  67.000 sec, Uncor max =   -.105 g, at   31.575 sec.",
            "Processed:                         CGS . Max =    -.105 g       at   31.575 sec",
            "Record not filtered.",
            "Values used when parameter or data value is unknown/unspecified:   -999, -999.0",
            " 100 Integer-header values follow on  10 lines, Format= (10I8)",
            *columns(integers, "{:8d}", 10),
            " 100 Real-header values follow on  17 lines, Format= (6F13.6)",
            *columns(numbers, "{:13.6f}", 6),
            '   1 Comment line(s) follow, each starting with a "|":',
            f"|<SCNL>99999.{code}.CE.--   <AUTH>CE 2018/08/29" if scnl else "| nothing",
            f"   {len(data)} acceleration pts, approx  2 secs, units={COSMOS_UNITS[unit]}"
            f"Format={cells[2]}",
            *columns(data, *cells[:2]),
            f"End-of-data for Chan  {number} acceleration",
        ]
    return "\n".join(lines) + "\n"


def scientific(value):
    """A number in ten columns with an exponent of one digit, as SMC files have it."""
    mantissa, exponent = f"{value if abs(value) > 1e-9 else 0.0:.4E}".split("E")
    return f"{mantissa}E{int(exponent):+d}".rjust(10)


def smc(values=None, dt=0.005, kind="2 CORRECTED ACCELEROGRAM", count=None, times=None, filler=0,
        peak=None, bearing="133"):  # fmt: skip
    """SMC file [cm/s2]; pairs of time and acceleration where `times` are given."""
    data = G * (components()[0] if values is None else np.asarray(values))
    numbers = data if times is None else np.column_stack([times, data]).ravel()
    integers = np.full(48, -32768)
    integers[[1, 2, 3, 4, 8]] = 1989, 291, 0, 4, 1
    integers[12] = 0 if bearing == "up" else 90
    integers[13] = -32768 if bearing == "up" else int(bearing)
    integers[16] = len(numbers) if count is None else count
    reals = np.full(50, 1.7e38)
    reals[[2, 3, 4, 5, 10, 11, 16]] = 37.037, -121.883, 18.0, 6.9, 37.52, -122.25, 63.0
    reals[29], reals[31] = data.max() if peak is None else peak, data.min()
    if times is None:
        reals[1] = 1.0 / dt
    rows = [scientific(value) for value in (*numbers, *[1.0] * filler)]
    lines = [
        kind, "*", "MADEA", "     1989  10  18    0004 Made-up, CA",
        "Moment Mag=      6.9 Ms=      7.1 Ml=      7.0",
        f"station = MADE-UP Array #2               component=    {bearing}",
        "epicentral dist =     63.0       pk     =   -222.5",
        "inst type=SMA-1      data source = USGS", "*", "*", "*",
        *columns(integers, "{:10d}", 8),
        *columns(reals, "{:15.7E}", 5),
        "|", "|ref - nobody, nowhere", "|",
        *("".join(rows[i : i + 8]) for i in range(0, len(rows), 8)),
    ]  # fmt: skip
    return "\n".join(line.ljust(80) for line in lines) + "\n"


KIKNET = {"NS1": 1, "EW1": 2, "UD1": 3, "NS2": 4, "EW2": 5, "UD2": 6}


def dyna_text(samples, *, stream="HNE", unit="cm/s^2", count=None, peak=None, end="\n", **changes):
    """ESM's header; `changes` are other values of its keys, None leaves a key out."""
    peak = np.abs(samples).max() if peak is None else peak
    header = {
        "EVENT_NAME": "NOWHERE",
        "EVENT_ID": "XX-0001",
        "EVENT_DATE_YYYYMMDD": "20010203",
        "EVENT_TIME_HHMMSS": "040506",
        "EVENT_LATITUDE_DEGREE": "41.5000",
        "EVENT_LONGITUDE_DEGREE": "-13.2500",
        "EVENT_DEPTH_KM": "8.5",
        "MAGNITUDE_W": "",
        "MAGNITUDE_L": "5.1",
        "NETWORK": "XX",
        "STATION_CODE": "ABC",
        "STATION_NAME": "Somewhere",
        "STATION_LATITUDE_DEGREE": "41.600000",
        "STATION_LONGITUDE_DEGREE": "-13.300000",
        "LOCATION": "",
        "VS30_M/S": "420",
        "EPICENTRAL_DISTANCE_KM": "12.3",
        "DATE_TIME_FIRST_SAMPLE_YYYYMMDD_HHMMSS": "20010203_040510.250",
        "SAMPLING_INTERVAL_S": "0.005000",
        "NDATA": str(len(samples) if count is None else count),
        "STREAM": stream,
        "UNITS": unit,
        "PGA_CM/S^2": f"{peak:.6f}",
        "BASELINE_CORRECTION": "BASELINE REMOVED",
        "LOW_CUT_FREQUENCY_HZ": "0.100",
        "HIGH_CUT_FREQUENCY_HZ": "30.000",
        "DATA_TYPE": "ACCELERATION",
        "USER5": "",
    } | {key.upper(): value for key, value in changes.items()}
    lines = [f"{key}: {value}" for key, value in header.items() if value is not None]
    return end.join([*lines, *(f"{value:.6f}" for value in samples), ""])


def itaca_text(samples, component="WE"):
    """The header of ITACA 1: no stream, no data type, other keys."""
    header = [
        "EVENT_NAME: NOWHERE", "EVENT_DATE_YYYYMMDD: 19990405", "EVENT_TIME_HHMMSS: 060708",
        "EVENT_LATITUDE_DEGREE: 42.0", "EVENT_LONGITUDE_DEGREE: 13.0", "EVENT_DEPTH_KM: 7.0",
        "MAGNITUDE_L: 4.9", "MAGNITUDE_S: ", "MAGNITUDE_W: 5.2", "STATION_CODE: ABC",
        "VS30_MS: 610", "EPICENTRAL_DISTANCE_KM: 20.1", "SAMPLING_INTERVAL_S: 0.005000",
        f"NDATA: {len(samples)}", f"COMPONENT: {component}", "UNITS: cm/s^2",
        f"PGA_CM/S^2: {np.abs(samples).max():.6f}", "BASELINE_CORRECTION: BASELINE NOT REMOVED",
    ]  # fmt: skip
    return "\n".join([*header, *(f"{value:13.6f}" for value in samples), ""])


def resorce_text(samples, *, component="NS", unit="m/s/s", count=None, peak=None, info="Filtered"):
    rows = [
        "".join(f"{value:14.7E}" for value in samples[first : first + 5])
        for first in range(0, len(samples), 5)
    ]
    header = [
        "Event Date & Time             : 2001-02-03 04:05:06",
        "Station Code / Name           : 1234 / Some - Where, Nowhere",
        "Network                       : NONE (No network)",
        f"Orientation                   : {component}",
        f"Processing Info               : {info}",
        "Filter Cut-off Frequency (Hz) : 0.100 - 50.000",
        "Time Increment (s)            : 0.005",
        f"Number of Data                : {len(samples) if count is None else count}",
        f"PGA (m/s/s)                   : {np.abs(samples).max() if peak is None else peak:.7E}",
        f"Accelaration time series in {unit}",
    ]
    return "\n".join([*header, *rows, ""])


def geonet_text(channels, *, level="raw", count=None, dt=0.005, peak=None):
    """Components by name, each a row of accelerations [mm/s2]; V2A where the level is not raw."""
    return "".join(
        f"{line}\n"
        for component, samples in channels.items()
        for line in _geonet_block(component, samples, level == "raw", count, dt, peak)
    )


def _geonet_block(component, samples, raw, count, dt, peak):
    n = len(samples) if count is None else count
    kind = "Uncorrected" if raw else "Corrected"
    peak = samples[np.abs(samples).argmax()] if peak is None else peak
    text = [
        f"{kind} accelerogram 20010203_040506_ABCD_20 GNS Science",
        "Site ABCD      41 30 00S  172 15 00E     Cusp file:  20010203_040506_ABCD",
        "Somewhere School",
        "Instrument None_1",
        "Resolution: 18-bit   Instr Period: 0.0050 s   Damping: 0.700",
        "Accelerogram 20010203_040506_ABCD_20                 Processed 2001 March 04",
        "10 km east of Nowhere",
        "2001 February 03         04:05:06 UT",
        "Epicentre  41 36 00S 172 30 00W  Bearing N89E  Dist   21km  Depth    9km Mw 6.25",
        f"Number of points  {n}    Duration {(n - 1) * dt:.2f} s",
        f"Raw readings in units of 1.00 mm/s/s  at intervals of {dt:.3f} s"
        if raw
        else f"Instrument corrected data at {dt:.3f} sec intervals",
        "Data is unfiltered",
        f"Component {component}  Some Accelerometer Axis",
        f"Acceleration:  Peak   {peak:.1f} mm/s/s at  1.00 s     RMS    1.00 mm/s/s",
        "Velocity record unevaluated",
        "Displacement record unevaluated",
    ]
    integers = [0] * 40
    integers[8], integers[9], integers[18], integers[19] = 2001, 2, 3, 4
    integers[33:36] = [n, 0, 0] if raw else [n, n, n]
    integers[38:] = [4, 57250]
    rows = _rows(integers, "8d") + _rows([0.0] * 60, "8.2f") + _rows(samples, "8.1f")
    if not raw:
        rows += _rows(np.cumsum(samples) * dt, "8.2f")
        rows += _rows(1000.0 + np.arange(len(samples)), "8.3f")  # columns run together
    return text + rows


def _rows(values, form):
    return [
        "".join(format(value, form) for value in values[i : i + 10])
        for i in range(0, len(values), 10)
    ]


def kiknet_text(counts, channel, *, peak=None, offset=5000, direction=None):
    """K-NET's header with the number of the channel; counts of 2000 gal / 8388608."""
    held = counts - counts.mean()
    gal = np.abs(held).max() * 2000.0 / 8388608 if peak is None else peak
    height = 502.5 if channel.endswith("1") else 720
    header = [
        "Origin Time       2011/06/30 23:45:00", "Lat.              36.213",
        "Long.             137.943", "Depth. (km)       5", "Mag.              5.4",
        "Station Code      ABCH01", "Station Lat.      36.1184", "Station Long.     137.9389",
        f"Station Height(m) {height}", "Record Time       2011/06/30 23:45:48",
        "Sampling Freq(Hz) 100Hz", f"Duration Time(s)  {len(counts) / 100:g}",
        f"Dir.              {KIKNET.get(channel) if direction is None else direction}",
        "Scale Factor      2000(gal)/8388608", f"Max. Acc. (gal)   {gal:.3f}",
        "Last Correction   2011/06/30 23:45:33", "Memo.             ",
    ]  # fmt: skip
    rows = [
        " ".join(f"{count + offset:8d}" for count in counts[i : i + 8])
        for i in range(0, len(counts), 8)
    ]
    return "\n".join([*header, *rows, ""])


def at2():
    """PEER AT2."""
    return at2_text(components()[0])


# Small files of each format: what mutations start from, and what nobody else may claim.
MADE_UP = {
    "AT2": (at2,),
    "COSMOS": (cosmos, lambda: cosmos(2, 4, factor=G), lambda: cosmos(0, 50, factor=1e5)),
    "DMG": (dmg_v1, dmg_pairs, dmg_v2),
    "DYNA": (lambda: dyna_text(98.0 * wave(400)), lambda: itaca_text(98.0 * wave(400))),
    "GEONET": (
        lambda: geonet_text(dict(zip(("S16W", "Up", "N74W"), 9800.0 * np.array(components())))),
        lambda: geonet_text({"S16W": 980.0 * wave(400)}, level="corrected"),
    ),
    "RESORCE": (lambda: resorce_text(0.98 * wave(400)),),
    "SMC": (smc, lambda: smc(kind="1 UNCORRECTED ACCELEROGRAM", times=0.003 * np.arange(400))),
}
