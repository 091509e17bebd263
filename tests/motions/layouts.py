"""Small files in the layouts of agencies, with made-up numbers."""

import numpy as np

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
