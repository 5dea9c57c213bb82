"""Makes the tables of this folder from the records of the rig: python3 cycles.py <folder of the records> .

Every record is cut at the rising crossings of the mean of heave, and a Fourier series with five harmonics is fitted to
each of its cycles, without the readings of pitch that jumped to 2 pi. What the README says of the columns is computed
from these series. Standard deviations are those of the mean over 20 s, from the scatter of its five fifths, so that slow
drifts count.
"""
import csv
import sys
from pathlib import Path

import numpy as np

HEAVE_M_PER_V = 0.18
HARMONICS = 5
JUMP_RAD = 3.0  # readings above are 2 pi, whatever the wing does
DIFFERENCE_RAD_PER_M, DIFFERENCE_RATE = 1.5, 100.0  # as in the model: d' = rate (pitch - 1.5 heave - d)
RECORDS = {
    "case1_stable": [("Model1_CBC_stable_v14_9", 14.9), ("Model1_CBC_stable_v15_6", 15.6),
                     ("Model1_CBC_stable_v16_5", 16.5), ("Model1_CBC_stable_v17_3", 17.3)],
    "case1_unstable": [("Model1_CBC_unstable_v14_9", 14.9)],
    "case2_stable": [("Model2_CBC_stable_v20_7", 20.7), ("Model2_CBC_stable_v21_5", 21.5),
                     ("Model2_CBC_stable_v22_4", 22.4), ("Model2_CBC_stable_v23_2", 23.2)],
    "case2_unstable": [("Model2_CBC_v22_4", 22.4)],
}
ORDERS = np.arange(HARMONICS + 1)
ANGLES = np.linspace(0.0, 2.0 * np.pi, 2000, endpoint=False)


def rising_crossings(t, x):
    """Instants at which x crosses 0 upwards, by straight lines; crossings within 0.2 s of the last one are noise."""
    k = np.flatnonzero((x[:-1] < 0.0) & (x[1:] >= 0.0))
    at = t[k] - x[k] * (t[k + 1] - t[k]) / (x[k + 1] - x[k])
    return at[np.r_[True, np.diff(at) > 0.2]]


def coefficients(angle, y):
    """c of y = Re sum_k c_k exp(i k angle)."""
    columns = [np.ones_like(angle)]
    for k in ORDERS[1:]:
        columns += [np.cos(k * angle), np.sin(k * angle)]
    fitted = np.linalg.lstsq(np.column_stack(columns), y, rcond=None)[0]
    return np.r_[fitted[0], fitted[1::2] - 1j * fitted[2::2]]


def half_range(series):
    return 0.5 * np.ptp((series @ np.exp(1j * np.outer(ORDERS, ANGLES))).real)


def cycles_of(path):
    """Rows of heave, pitch, difference (half ranges), mean of the difference, period: one per cycle."""
    record = np.genfromtxt(path, delimiter=",", names=True)
    t, heave, pitch = record["t_s"], HEAVE_M_PER_V * record["heave_V"], record["pitch_rad"]
    read = pitch < JUMP_RAD
    crossings = rising_crossings(t, heave - heave.mean())
    rows = []
    for begin, end in zip(crossings[:-1], crossings[1:]):
        inside = (t >= begin) & (t < end)
        angle = 2.0 * np.pi * (t - begin) / (end - begin)
        h = coefficients(angle[inside], heave[inside])
        a = coefficients(angle[inside & read], pitch[inside & read])
        smoothed = (a - DIFFERENCE_RAD_PER_M * h) / (1.0 + 2j * np.pi * ORDERS / (end - begin) / DIFFERENCE_RATE)
        rows.append([half_range(h), half_range(a), half_range(smoothed), smoothed[0].real, end - begin])
    return np.array(rows)


def measured(path):
    """Means over the record, and their standard deviations."""
    rows = cycles_of(path)
    fifths = np.array([part.mean(axis=0) for part in np.array_split(rows, 5)])
    mean = rows.mean(axis=0)
    sd = fifths.std(axis=0, ddof=1) / np.sqrt(len(fifths))
    f = 1.0 / mean[4]
    return [*mean[:4], f], [*sd[:4], f * f * sd[4]]


def main(records, out):
    for name, list_of_records in RECORDS.items():
        with open(Path(out) / f"{name}.csv", "w", newline="", encoding="ascii") as file:
            table = csv.writer(file, lineterminator="\n")
            names = ["heave", "pitch", "difference", "difference_mean", "f"]
            table.writerow(["U", *names, *(f"{n}_sd" for n in names)])
            for record, speed in list_of_records:
                values, sds = measured(Path(records) / f"{record}_250Hz.csv")
                table.writerow([speed, *(f"{v:.6g}" for v in values), *(f"{s:.2g}" for s in sds)])


if __name__ == "__main__":
    main(*sys.argv[1:3])
