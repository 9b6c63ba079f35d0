#!/usr/bin/env python3
"""Compares `deepfield probe --interpolation linear` on a one-level data set with scipy.

Usage: check_linear_with_scipy.py [DEEPFIELD] [--points N]

Writes the set of datasets_synthetic/one_level.toml with `deepfield synth`, ingests it with bricks
of 8, 16 and 32 cells, probes random points (half of them in the outer half cell of some axis) and
compares with scipy.interpolate.RegularGridInterpolator over the cell centres of the HDF5 file,
continued by its outermost values. Needs numpy, scipy and h5py.
"""

import argparse
import csv
import io
import pathlib
import subprocess
import sys
import tempfile
import tomllib

import h5py
import numpy as np
from scipy.interpolate import RegularGridInterpolator

ROOT = pathlib.Path(__file__).resolve().parent.parent
RECIPE = ROOT / "datasets_synthetic" / "one_level.toml"
LARGEST_DIFFERENCE = 1e-12  # of the largest value


def run(*command):
    """Runs the program and returns what it printed."""
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def read_density(folder):
    """The root grid's density as [x, y, z], rounded to f32 as the cache stores it."""
    for path in sorted(folder.rglob("*.cpu*")):
        with h5py.File(path) as file:
            for grid in file.values():
                if "Density" in grid:
                    return grid["Density"][...].T.astype(np.float32).astype(np.float64)
    sys.exit(f"{folder}: no Density in any .cpu file")


def interpolator(values, left, right):
    """Trilinear between cell centres; the outermost values continue to the faces."""
    padded = np.pad(values, 1, mode="edge")
    axes = []
    for count, low, high in zip(values.shape, left, right):
        axes.append(low + (np.arange(-1, count + 1) + 0.5) * (high - low) / count)
    return RegularGridInterpolator(axes, padded, method="linear")


def random_points(count, shape, left, right):
    """Points in the domain; one coordinate of every second one lies in the outer half cell."""
    random = np.random.default_rng(1)
    parts = random.random((count, 3))
    for point in parts[::2]:
        axis = random.integers(3)
        part = 0.5 * random.random() / shape[axis]
        point[axis] = part if random.random() < 0.5 else 1.0 - part - 1e-12
    return left + parts * (right - left)


def probe(program, cache, points, folder):
    """Values of `deepfield probe` at the points."""
    file = folder / "points.csv"
    lines = [",".join(repr(float(x)) for x in point) for point in points]
    file.write_text("x,y,z\n" + "\n".join(lines) + "\n")
    printed = run(program, "probe", str(cache), "--field", "Density", "--points", str(file),
                  "--interpolation", "linear")
    rows = list(csv.DictReader(io.StringIO(printed)))
    if len(rows) != len(points) or any(row["level"] != "0" for row in rows):
        sys.exit(f"probe printed {len(rows)} rows for {len(points)} points, or other levels than 0")
    return np.array([float(row["value"]) for row in rows])


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("program", nargs="?", default=str(ROOT / "target/release/deepfield"))
    parser.add_argument("--points", type=int, default=20000)
    options = parser.parse_args()
    domain = tomllib.loads(RECIPE.read_text())["domain"]
    left, right = np.array(domain["left"]), np.array(domain["right"])
    failed = False
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        run(options.program, "synth", str(RECIPE), "-o", str(folder))
        values = read_density(folder)
        points = random_points(options.points, values.shape, left, right)
        expected = interpolator(values, left, right)(points)
        parameters = next(folder.rglob("*.hierarchy")).with_suffix("")
        for brick in (8, 16, 32):
            cache = folder / f"{brick}.dfc"
            run(options.program, "ingest", str(parameters), "-o", str(cache), "--brick", str(brick))
            found = probe(options.program, cache, points, folder)
            largest = np.abs(found - expected).max() / np.abs(values).max()
            failed |= not largest <= LARGEST_DIFFERENCE
            print(f"bricks of {brick}³: {len(points)} points, largest difference {largest:.1e} "
                  "of the largest value")
    sys.exit("they differ" if failed else 0)


if __name__ == "__main__":
    main()
