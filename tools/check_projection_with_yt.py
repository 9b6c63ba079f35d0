#!/usr/bin/env python3
"""Compares deepfield's projections of a field with yt's, along each axis, pixel by pixel.

    pip install yt h5py numpy
    deepfield synth datasets_synthetic/small.toml -o out
    tools/check_projection_with_yt.py out/DD0000/DD0000 --field Density

DATASET is what both read. deepfield draws an orthographic picture without absorption whose
emission is the field itself, in the simulation's own cells (`interpolation = "cell"`), one ray
through each pixel's centre, exact: a pixel is the integral of the field along its ray. yt's value
there is that of the column of `ds.proj` which holds the pixel's centre, found by exact arithmetic.
(yt's FixedResolutionBuffer with `antialias=False` gives a pixel that several columns touch the
value of any of them, so it says the same only where columns are wider than pixels.)

Two views along each axis: the whole domain with a margin, and the deepest level from so close that
its cells are three pixels wide (`--level` chooses others). Printed for each: the largest difference
relative to the pixel's own value. Exit code 1 where one exceeds `--limit`, or a pixel is dark in
one picture alone. yt puts grids of Enzo runs from level 43 on in wrong places, so its columns
through them are wrong.
"""

import argparse
import json
import pathlib
import subprocess
import sys
import tempfile
from fractions import Fraction

import numpy as np
import yt

from check_reference import read_exr
from check_synth_with_yt import stored_field

# The axes that go right and up in a picture whose eye looks down the axis.
PLANE = {0: (1, 2), 1: (2, 0), 2: (0, 1)}
# Height of the view that holds everything, in the domain's largest extent.
WHOLE = 1.0517
# Width of a pixel of a closer view, in cells of its level.
CLOSE = 0.3391
# A view's centre lies off cells' faces, by this part of a pixel and more of it.
OFF = (0.1937, 0.2713, 0.3371)

SCENE = """[image]
width = {pixels}
height = {pixels}
[camera]
projection = "orthographic"
position = [{position}]
look_at = [{look_at}]
up = [{up}]
height = {height}
[render]
interpolation = "cell"
tolerance = 0.0
samples = 1
[[volume]]
field = "{field}"
scale = "linear"
range = [0.0, {largest!r}]
color = [[0.0, 1.0, 1.0, 1.0], [1.0, 1.0, 1.0, 1.0]]
absorption = [[0.0, 0.0], [1.0, 0.0]]
emission = [[0.0, 0.0], [1.0, {brightest!r}]]
"""
# Emission of the largest value: the field itself, but no more than a scene may ask for.
BRIGHTEST = 2.0**64


class View:
    """A square of `pixels`² rays down an axis; numbers are doubles, taken as the rationals they
    are."""

    def __init__(self, axis, centre, pixel, pixels):
        self.axis, self.pixels = axis, pixels
        self.height = float(pixel * pixels)
        self.centre = [float(c + off * pixel) for c, off in zip(centre, OFF)]

    def scene(self, field, largest):
        """The scene's text."""
        exact = [decimal(Fraction(c)) for c in self.centre]
        ahead = [decimal(Fraction(c) - (a == self.axis)) for a, c in enumerate(self.centre)]
        up = [float(a == PLANE[self.axis][1]) for a in range(3)]
        return SCENE.format(
            pixels=self.pixels,
            position=", ".join(f'"{c}"' for c in exact),
            look_at=", ".join(f'"{c}"' for c in ahead),
            up=", ".join(map(str, up)),
            height=repr(self.height),
            field=field,
            largest=largest,
            brightest=min(largest, BRIGHTEST),
        )

    def centres(self, side):
        """Exact centres of the pixels along the picture's axis `side` (0 right, 1 up)."""
        centre = Fraction(self.centre[PLANE[self.axis][side]])
        # The scene's height is the decimal that Python prints.
        pixel = Fraction(repr(self.height)) / self.pixels
        return [centre + pixel * (i + Fraction(1 - self.pixels, 2)) for i in range(self.pixels)]


def decimal(number):
    """All digits of a number whose denominator is a power of two."""
    digits = number.denominator.bit_length() - 1
    scaled = abs(number.numerator) * 10**digits // number.denominator
    whole, part = divmod(scaled, 10**digits)
    sign = "-" if number < 0 else ""
    return f"{sign}{whole}.{str(part).zfill(digits) if digits else '0'}"


class Columns:
    """yt's projection: columns that tile the plane, and the integral along each, code length."""

    def __init__(self, dataset, field, axis):
        projection = dataset.proj(field, axis)
        units = dataset.field_info[field].units or "dimensionless"
        length = dataset.quan(1.0, "code_length")
        self.values = (projection[field] / length).to(units).d
        self.left = [dataset.domain_left_edge.d[a] for a in PLANE[axis]]
        self.width = [dataset.domain_width.d[a] for a in PLANE[axis]]
        places = [("px", "pdx"), ("py", "pdy")]
        self.edges, self.counts = [], []
        for side, (place, half) in enumerate(places):
            place, half = (projection[name].to("code_length").d for name in (place, half))
            # Cells of the column's level along the whole domain.
            self.counts.append(np.round(self.width[side] / (2 * half)))
            self.edges.append((place - half, place + half))

    def at(self, view):
        """Values at the centres of a view's pixels, rows from the top; 0 outside the domain."""
        picture = np.zeros((view.pixels, view.pixels))
        centres = [view.centres(0), view.centres(1)]
        for column in np.flatnonzero(self.near(view, centres)):
            inside = []
            for side in range(2):
                low, high = self.exact(column, side)
                inside.append([i for i, c in enumerate(centres[side]) if low <= c < high])
            for row in inside[1]:
                picture[view.pixels - 1 - row, inside[0]] = self.values[column]
        return picture

    def near(self, view, centres):
        """Which columns hold a pixel's centre, or nearly."""
        near = np.ones(len(self.values), dtype=bool)
        for side in range(2):
            first, pixel = float(centres[side][0]), view.height / view.pixels
            low, high = ((edge - first) / pixel for edge in self.edges[side])
            low, high = np.ceil(low - 0.5), np.floor(high + 0.5)
            near &= (low <= high) & (high >= 0) & (low <= view.pixels - 1)
        return near

    def exact(self, column, side):
        """Both edges of a column as rationals: its place is a whole number of its cells."""
        cell = Fraction(self.width[side]) / int(self.counts[side][column])
        left = Fraction(self.left[side])
        index = round((Fraction(self.edges[side][0][column]) - left) / cell)
        return left + cell * index, left + cell * (index + 1)


def views(dataset, axis, arguments):
    """The views down an axis, with what they show."""
    pixels = arguments.pixels
    middle = (dataset.domain_left_edge.d + dataset.domain_right_edge.d) / 2
    yield "whole", View(axis, middle, WHOLE * dataset.domain_width.d.max() / pixels, pixels)
    grids = sorted(dataset.index.grids, key=lambda grid: grid.Level)
    for level in arguments.level or [int(grids[-1].Level)]:
        grid = next((grid for grid in grids if grid.Level == level), None)
        if grid is None:
            raise SystemExit(f"no grid has level {level}")
        centre = (grid.LeftEdge.d + grid.RightEdge.d) / 2
        yield f"level {level}", View(axis, centre, CLOSE * grid.dds.d.max(), pixels)


def run(*words):
    """Runs a command; what it prints."""
    done = subprocess.run([str(word) for word in words], capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(done.stderr)
    return done.stdout


def compare(expected, drawn):
    """The largest relative difference, and how many pixels are dark in one picture alone."""
    drawn = drawn[:, :, :3]
    lit = expected > 0
    alone = int(((drawn > 0).any(axis=2) != lit).sum())
    differences = np.abs(drawn[lit] / expected[lit, None] - 1.0)
    return differences.max() if lit.any() else 0.0, alone


def check(dataset, cache, arguments, folder):
    """Compares all views; how many differ."""
    facts = json.loads(run(arguments.binary, "info", cache, "--json"))
    known = {field["name"].lower(): field for field in facts["fields"]}
    stated = known[arguments.field.lower()]
    if stated["min"] < 0 or stated["max"] <= 0:
        raise SystemExit(f"{arguments.field}: negative values, which no emission stands for")
    largest = float(2.0 ** np.ceil(np.log2(stated["max"])))
    field, failed = stored_field(dataset, arguments.field), 0
    for axis in range(3):
        columns = Columns(dataset, field, axis)
        for name, view in views(dataset, axis, arguments):
            scene, picture = folder / "scene.toml", folder / "picture.exr"
            scene.write_text(view.scene(stated["name"], largest))
            run(arguments.binary, "render", cache, scene, "-o", picture)
            expected = columns.at(view)
            drawn = read_exr(picture).astype(np.float64) * max(1.0, largest / BRIGHTEST)
            worst, alone = compare(expected, drawn)
            # A comparison that NaN fails.
            good = worst <= arguments.limit and alone == 0
            failed += not good
            print(
                f"{'xyz'[axis]} {name}: {np.count_nonzero(expected)} pixels, largest relative "
                f"difference {worst:.2e}, {alone} dark in one alone{'' if good else ' FAILED'}"
            )
    return failed


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("dataset", help="what yt.load and `deepfield ingest` take")
    parser.add_argument("--field", default="Density")
    parser.add_argument("--cache", help="the data set's cache (default: one made for this)")
    parser.add_argument("--binary", default="target/release/deepfield")
    parser.add_argument("--level", type=int, action="append", help="levels of closer views")
    parser.add_argument("--pixels", type=int, default=64, help="of a picture's edge")
    parser.add_argument("--limit", type=float, default=1e-5)
    arguments = parser.parse_args()
    yt.set_log_level("error")
    # In other units yt labels projections of stored fields as products of cm and code units, but
    # their numbers are in code units (4.4).
    dataset = yt.load(arguments.dataset, unit_system="code")
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        cache = arguments.cache or folder / "cache.dfc"
        if not arguments.cache:
            options = ["-o", cache, "--field", arguments.field]
            run(arguments.binary, "ingest", arguments.dataset, *options)
        failed = check(dataset, cache, arguments, folder)
    print(f"{failed} views differ" if failed else "no differences")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
