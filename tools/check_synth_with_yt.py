#!/usr/bin/env python3
"""Compares what yt reads from a data set written by `deepfield synth` with what deepfield reads.

    pip install yt h5py numpy
    deepfield synth datasets_synthetic/small.toml -o out
    deepfield ingest out/DD0000/DD0000 -o small.dfc
    deepfield info out/DD0000/DD0000 --json > info.json
    tools/check_synth_with_yt.py out/DD0000/DD0000 --write-points points.csv
    deepfield probe small.dfc --field Density --points points.csv > probe.csv
    tools/check_synth_with_yt.py out/DD0000/DD0000 probe.csv --info info.json

DATASET is whatever yt.load takes, in any layout that `deepfield synth` writes: what `synth` prints.

Checked: the grids, cells and leaf cells of each level that yt counts, against INFO (of trees of
blocks the leaves alone), and for Enzo against the text hierarchy and the integers in it; and
the level and value in the leaf cell at each point of PROBE_CSV (columns x, y, z, level, value),
found in yt's own grids. Values are compared as 32-bit floats. yt cannot load Enzo sets deeper than
level 47, and misplaces blocks where the edges in a FLASH file no longer tell them apart.
"""

import argparse
import collections
import csv
import decimal
import json
import os
import random
import sys

import numpy as np
import yt


def grids_in_text(path):
    """Active sizes and edges of the grids in a text hierarchy, in order."""
    grids = []
    with open(path, encoding="ascii") as text:
        for line in text:
            key, _, value = (part.strip() for part in line.partition("="))
            if key == "Grid":
                grids.append({})
            elif key in ("GridStartIndex", "GridEndIndex"):
                grids[-1][key] = np.array(value.split(), dtype=np.int64)
            elif key in ("GridLeftEdge", "GridRightEdge"):
                grids[-1][key] = np.array(value.split(), dtype=np.float64)
    for grid in grids:
        grid["size"] = grid["GridEndIndex"] - grid["GridStartIndex"] + 1
    return grids


def check_hierarchy(dataset, text_grids):
    """Compares yt's grids with the text; the leaf cells follow from the volumes that grids of
    the next level take up."""
    index = dataset.index
    width = (dataset.domain_right_edge - dataset.domain_left_edge).d
    levels = collections.Counter()
    cells = collections.Counter()
    for grid in text_grids:
        cell = (grid["GridRightEdge"] - grid["GridLeftEdge"]) / grid["size"]
        ratio = width / dataset.domain_dimensions / cell
        level = int(round(np.log(ratio[0]) / np.log(dataset.refine_by)))
        levels[level] += 1
        cells[level] += int(np.prod(grid["size"]))
    failures = []
    from_yt = collections.Counter(int(level) for level in index.grid_levels.ravel())
    if levels != from_yt:
        failures.append(f"grids per level: text {dict(levels)}, yt {dict(from_yt)}")
    leaves = sum(cells.values()) - sum(
        count // dataset.refine_by**3 for level, count in cells.items() if level > 0
    )
    seen = sum(int(grid.child_mask.sum()) for grid in index.grids)
    if leaves != seen:
        failures.append(f"leaf cells: {leaves} from the text, {seen} in yt")
    print(f"levels {max(levels) + 1}, grids {sum(levels.values())}, leaf cells {leaves}")
    return failures


def check_info(dataset, path):
    """Compares grids, cells and leaf cells of each level with what `deepfield info --json` printed.
    Of block trees only leaves are grids of the solution, so their cells say nothing more."""
    with open(path, encoding="utf-8") as file:
        info = json.load(file)
    tree = info["format"] in ("athena++", "flash")
    counted = ("grids", "leaf_cells") if tree else ("grids", "cells", "leaf_cells")
    seen = collections.defaultdict(collections.Counter)
    for grid in dataset.index.grids:
        leaves, cells = int(grid.child_mask.sum()), int(np.prod(grid.ActiveDimensions))
        if leaves > 0 or not tree:
            seen[int(grid.Level)].update(grids=1, cells=cells, leaf_cells=leaves)
    failures = []
    for level in info["levels"]:
        found = seen.pop(level["level"], collections.Counter())
        for what in counted:
            if level["level"] is not None and level[what] != found[what]:
                place = f"level {level['level']}: {what}"
                failures.append(f"{place}: deepfield {level[what]}, yt {found[what]}")
    if seen:
        failures.append(f"levels {sorted(seen)} are in yt alone")
    print(f"{info['format']}: {len(info['levels'])} levels, {info['leaf_cells']} leaf cells")
    return failures


def leaf_at(dataset, point):
    """Level and index of the leaf cell of yt's grids at a point, and the grid."""
    index = dataset.index
    inside = np.all((index.grid_left_edge.d <= point) & (point < index.grid_right_edge.d), axis=1)
    if not inside.any():
        return None
    candidates = np.flatnonzero(inside)
    grid = index.grids[candidates[np.argmax(index.grid_levels.ravel()[candidates])]]
    cell = np.floor((point - grid.LeftEdge.d) / grid.dds.d).astype(int)
    return grid, tuple(np.clip(cell, 0, grid.ActiveDimensions - 1))


def stored_field(dataset, name):
    """yt's name of the stored field `name`, whatever the case."""
    for field in dataset.field_list:
        if field[1].lower() == name.lower():
            return field
    raise SystemExit(f"yt knows no field {name}: {dataset.field_list}")


def check_points(dataset, name, path):
    """Compares the rows of a probe with yt."""
    failures, checked = [], 0
    field = stored_field(dataset, name)
    with open(path, newline="", encoding="ascii") as rows:
        for row in csv.DictReader(rows):
            point = np.array([float(decimal.Decimal(row[axis])) for axis in "xyz"])
            found = leaf_at(dataset, point)
            level, value = int(row["level"]), np.float32(row["value"])
            if found is None:
                if level != -1:
                    failures.append(f"{row}: yt has no cell there")
                continue
            grid, cell = found
            expected = np.float32(grid[field].d[cell])
            if level != grid.Level or not np.isclose(value, expected, rtol=2e-7, atol=0):
                failures.append(f"{row}: yt has level {grid.Level}, value {expected}")
            checked += 1
    print(f"{checked} points compared")
    if checked == 0:
        failures.append(f"{path}: no point lies inside the domain")
    return failures


def write_points(dataset, path, count):
    """Writes points off the faces of cells: `count` in all, as many in each grid as in any."""
    choose = random.Random(1)
    grids = dataset.index.grids
    with open(path, "w", newline="", encoding="ascii") as file:
        rows = csv.writer(file)
        rows.writerow("xyz")
        for number in range(count):
            grid = grids[number % len(grids)]
            cell = [choose.randrange(int(n)) for n in grid.ActiveDimensions]
            offset = [cell[a] + choose.uniform(0.3, 0.7) for a in range(3)]
            point = grid.LeftEdge.d + np.array(offset) * grid.dds.d
            rows.writerow([repr(float(x)) for x in point])


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("dump", metavar="dataset", help="what yt.load takes")
    parser.add_argument("probe_csv", nargs="?", help="output of `deepfield probe`")
    parser.add_argument("--field", default="Density")
    parser.add_argument("--info", metavar="JSON", help="output of `deepfield info --json`")
    parser.add_argument("--write-points", metavar="CSV", help="write points to probe, and stop")
    parser.add_argument("--count", type=int, default=1000, help="how many points")
    arguments = parser.parse_args()
    yt.set_log_level("error")
    dataset = yt.load(arguments.dump)
    if arguments.write_points:
        write_points(dataset, arguments.write_points, arguments.count)
        return 0
    failures, hierarchy = [], arguments.dump + ".hierarchy"
    if os.path.exists(hierarchy):
        failures += check_hierarchy(dataset, grids_in_text(hierarchy))
    if arguments.info:
        failures += check_info(dataset, arguments.info)
    if arguments.probe_csv:
        failures += check_points(dataset, arguments.field, arguments.probe_csv)
    for failure in failures[:20]:
        print(failure)
    print(f"{len(failures)} differences" if failures else "no differences")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
