#!/usr/bin/env python3
"""Times deepfield against yt's volume renderer on the same pictures, which must agree.

    pip install yt h5py numpy
    cargo build --release
    tools/compare_with_yt.py DD0010/DD0010 --size 512x512 --size 1920x1080
    tools/compare_with_yt.py DD0010/DD0010 --scene scene.toml

DATASET is what yt.load and `deepfield ingest` take. Cameras: `--camera outside` (all of the domain)
and `inside` (20 cells of the deepest level from its densest cell), both where nothing is named, or
a scene file's. The picture is emission alone, a ray through each pixel's centre; picture_for_both.py
and yt_picture.py say how either program is brought to draw it.

What is measured, each run in a process of its own, best of `--repeat`:

- yt: loading, building its tree and bricks, and the picture, as timed within its process after
  importing yt (`import` tells how long that takes); peak resident set of the process.
- deepfield: the whole process, from a cache that is there; `ingest` likewise.

Files are in the page cache for both. Errors are measured against deepfield's exact picture
(tolerance 0), as parts of its largest value. deepfield's tolerance is the largest of some whose
error is at most yt's in the mean square, at the 99th percentile of pixels, and at its largest;
`--tolerance T` sets it instead, and takes that picture as the reference.
yt's error is mostly that it interpolates otherwise: its values at cells' corners are means of the
cells around (extrapolated at grids' borders without `--ghost-zones`), deepfield's interpolant goes
through the cells' values. `--converged N` also tells yt's error against its own picture with N
samples a cell.

Exit code 1 where the pictures differ by more than `--limit` at the 99th percentile.
"""

import argparse
import csv
import importlib.util
import json
import pathlib
import shutil
import subprocess
import sys
import tempfile

MISSING = [name for name in ("numpy", "yt", "h5py") if not importlib.util.find_spec(name)]
if MISSING:
    sys.exit(f"error: {', '.join(MISSING)} is not installed: pip install yt h5py numpy")

import numpy as np  # noqa: E402

import picture_for_both  # noqa: E402
from check_reference import read_exr  # noqa: E402

HERE = pathlib.Path(__file__).resolve().parent
TOLERANCES = ["10%", "3%", "1%", "0.3%", "0.1%", "0.03%", "0.01%", "0.001%"]
# Starts a command and measures it. On its own, and small: a process that is forked counts the
# resident set of the one it came from in its peak.
LAUNCHER = """
import json, os, sys, time
start = time.perf_counter()
child = os.posix_spawnp(sys.argv[2], sys.argv[2:], os.environ)
_, status, used = os.wait4(child, 0)
wall = time.perf_counter() - start
cpu = used.ru_utime + used.ru_stime
with open(sys.argv[1], "w") as file:
    json.dump({"wall": wall, "cpu": cpu, "rss": used.ru_maxrss / 1024}, file)
sys.exit(os.waitstatus_to_exitcode(status))
"""


def measure(folder, *words):
    """Runs a command; wall and CPU seconds, peak resident set in MiB, and what it prints."""
    result = folder / "measured.json"
    launch = [sys.executable, "-I", "-S", "-c", LAUNCHER, str(result)]
    done = subprocess.run([*launch, *map(str, words)], capture_output=True, text=True)
    if done.returncode:
        said = done.stderr.strip().splitlines() or [f"exit code {done.returncode}"]
        raise SystemExit(f"{' '.join(map(str, words[:3]))}: {said[-1]}")
    return json.loads(result.read_text()) | {"printed": done.stdout}


def best(runs, what="wall"):
    """The run that took least."""
    return min(runs, key=lambda run: run[what])


class Errors:
    """How far a picture is from the reference, in parts of the reference's largest value."""

    def __init__(self, picture, reference):
        largest = reference.max()
        difference = np.abs(picture - reference).max(axis=2)
        lit = (reference.max(axis=2) > 0) & np.isfinite(difference)
        own = difference[lit] / reference.max(axis=2)[lit]
        self.median = float(np.median(own))
        self.rms = float(np.sqrt(np.mean(difference[lit] ** 2)) / largest)
        self.most = float(np.percentile(difference[lit], 99) / largest)
        self.largest = float(difference.max() / largest)

    def at_most(self, other):
        """Whether this is no worse in any way."""
        pairs = [(getattr(self, name), getattr(other, name)) for name in ("rms", "most", "largest")]
        return all(mine <= theirs for mine, theirs in pairs)


class Comparison:
    """A data set, its cache, and what was measured of it."""

    def __init__(self, arguments, folder):
        self.arguments, self.folder = arguments, folder
        self.cache = folder / "cache.dfc"
        self.scene = picture_for_both.from_file(arguments.scene) if arguments.scene else None
        self.name = self.scene["volume"][0]["field"] if self.scene else arguments.field
        options = ["-o", self.cache, "--field", self.name, "--threads", arguments.threads]
        command = [arguments.binary, "ingest", arguments.dataset, *options]
        self.ingest = best([measure(folder, *command) for _ in range(arguments.repeat)])
        info = measure(folder, arguments.binary, "info", self.cache, "--json")
        facts = json.loads(info["printed"])
        self.levels = facts["max_level"] + 1
        self.domain = facts["domain"]["left"], facts["domain"]["right"]
        self.field = facts["fields"][0]

    def scenes(self):
        """Names of cameras, and scenes."""
        if self.scene:
            yield pathlib.Path(self.arguments.scene).stem, self.scene
            return
        look = [sys.executable, HERE / "yt_picture.py", self.arguments.dataset]
        densest = json.loads(measure(self.folder, *look, "densest", self.name)["printed"])
        for camera in self.arguments.camera or ["outside", "inside"]:
            yield camera, picture_for_both.own(camera, self.field, self.domain, densest)

    def rows(self):
        """Rows of the table."""
        for camera, scene in self.scenes():
            image = {"width": 512, "height": 512} | scene.get("image", {})
            for size in self.arguments.size or [(image["width"], image["height"])]:
                scene = picture_for_both.complete(scene, self.field, size)
                (self.folder / "scene.toml").write_text(picture_for_both.toml(scene))
                self.drawn = {}
                self.times, self.rss = self.yt(scene)
                for samples in self.arguments.yt_samples:
                    names = {"camera": camera, "size": "x".join(map(str, size)), "samples": samples}
                    yield names | self.row(samples)

    def deepfield(self, tolerance):
        """A picture, and its best run; the exact one is drawn once."""
        if tolerance in self.drawn:
            return self.drawn[tolerance]
        picture = self.folder / "picture.exr"
        options = ["-o", picture, "--tolerance", tolerance, "--threads", self.arguments.threads]
        options += ["--memory", self.arguments.memory]
        scene = self.folder / "scene.toml"
        command = [self.arguments.binary, "render", self.cache, scene, *options]
        repeat = 1 if tolerance == "0" else self.arguments.repeat
        runs = [measure(self.folder, *command) for _ in range(repeat)]
        self.drawn[tolerance] = read_exr(picture)[:, :, :3].astype(np.float64), best(runs)
        return self.drawn[tolerance]

    def yt(self, scene):
        """What yt took, and its peak resident set."""
        spec = picture_for_both.for_yt(scene, self.arguments, self.folder)
        (self.folder / "spec.json").write_text(json.dumps(spec))
        words = [sys.executable, HERE / "yt_picture.py", self.arguments.dataset]
        run = measure(self.folder, *words, self.folder / "spec.json")
        return json.loads(run["printed"].splitlines()[-1]), run["rss"]

    def matched(self, errors, reference):
        """The largest tolerance whose measured error is at most `errors`, its error and run."""
        for tolerance in [self.arguments.tolerance] if self.arguments.tolerance else TOLERANCES:
            picture, run = self.deepfield(tolerance)
            measured = Errors(picture, reference)
            if measured.at_most(errors):
                break
        return tolerance, measured, run

    def row(self, samples):
        """One comparison."""
        reference, reference_run = self.deepfield(self.arguments.tolerance or "0")
        times, rss = self.times, self.rss
        theirs = np.load(self.folder / f"yt_{samples}.npy")
        errors = Errors(theirs, reference)
        tolerance, measured, run = self.matched(errors, reference)
        picture = best([p for p in times["pictures"] if p["samples"] == samples])
        first = {k: times["load"][k] + times["bricks"][k] + picture[k] for k in ("wall", "cpu")}
        row = {
            "yt median": errors.median,
            "yt p99": errors.most,
            "yt max": errors.largest,
            "tolerance": tolerance,
            "df max": measured.largest,
            "yt import s": times["import"]["wall"],
            "yt load s": times["load"]["wall"],
            "yt bricks s": times["bricks"]["wall"],
            "yt picture s": picture["wall"],
            "yt picture cpu s": picture["cpu"],
            "yt first cpu s": first["cpu"],
            "yt MiB": rss,
            "ingest s": self.ingest["wall"],
            "df s": run["wall"],
            "df cpu s": run["cpu"],
            "reference cpu s": reference_run["cpu"],
            "df MiB": run["rss"],
            "later ×": picture["wall"] / run["wall"],
            "later cpu ×": picture["cpu"] / run["cpu"],
            "first ×": first["wall"] / run["wall"],
            "first cpu ×": first["cpu"] / run["cpu"],
            "with ingest ×": first["wall"] / (self.ingest["wall"] + run["wall"]),
            "with ingest cpu ×": first["cpu"] / (self.ingest["cpu"] + run["cpu"]),
            "memory ×": rss / max(run["rss"], 1.0),
            "ingest memory ×": rss / max(self.ingest["rss"], 1.0),
        }
        return row | self.own_error(samples, theirs)

    def own_error(self, samples, theirs):
        """yt's error against yt with many samples a cell."""
        converged = self.arguments.converged
        if not converged or samples == converged:
            return {}
        own = Errors(theirs, np.load(self.folder / f"yt_{converged}.npy"))
        return {"yt own p99": own.most, "yt own max": own.largest}


def show(rows):
    """Prints the table, a block of columns a line of the picture."""
    for row in rows:
        print(f"{row['camera']} {row['size']}, yt with {row['samples']} samples a cell")
        for name, content in list(row.items())[3:]:
            print(f"    {name:18}{content if isinstance(content, str) else f'{content:10.4g}'}")


def size(text):
    """512x512 → (512, 512)."""
    width, height = text.lower().split("x")
    return int(width), int(height)


def parse():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("dataset", help="what yt.load and `deepfield ingest` take")
    parser.add_argument("--field", default="Density")
    parser.add_argument("--camera", action="append", choices=["outside", "inside"])
    parser.add_argument("--scene", help="a scene file: its camera, volume and field")
    parser.add_argument("--size", type=size, action="append", help="512x512; may repeat")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--binary", default="target/release/deepfield")
    parser.add_argument("--tolerance", help="deepfield's tolerance (default: found)")
    parser.add_argument("--memory", default="1GiB", help="deepfield's limit")
    parser.add_argument(
        "--yt-samples", type=int, action="append", help="yt's samples a cell (10, its default)"
    )
    parser.add_argument("--converged", type=int, help="yt's samples a cell of its own reference")
    parser.add_argument("--ghost-zones", action="store_true", help="yt's use_ghost_zones")
    parser.add_argument("--limit", type=float, default=0.03, help="at the 99th percentile")
    parser.add_argument("--csv", help="also write the table to this file")
    arguments = parser.parse_args()
    if not shutil.which(arguments.binary):
        parser.error(f"{arguments.binary}: not a program; build it, or name it with --binary")
    arguments.yt_samples = arguments.yt_samples or [10]
    if arguments.converged and arguments.converged not in arguments.yt_samples:
        arguments.yt_samples.append(arguments.converged)
    return arguments


def main():
    arguments = parse()
    with tempfile.TemporaryDirectory() as folder:
        comparison = Comparison(arguments, pathlib.Path(folder))
        print(f"{arguments.dataset}: {comparison.levels} levels", flush=True)
        rows = []
        for row in comparison.rows():
            rows.append(row)
            show([row])
            sys.stdout.flush()
    if arguments.csv:
        with open(arguments.csv, "w", newline="", encoding="utf-8") as file:
            names = list(dict.fromkeys(name for row in rows for name in row))
            table = csv.DictWriter(file, names)
            table.writeheader()
            table.writerows(rows)
    # A comparison that NaN fails.
    differ = [row for row in rows if not row["yt p99"] <= arguments.limit]
    print(f"{len(differ)} pictures differ" if differ else "the pictures agree")
    return 1 if differ else 0


if __name__ == "__main__":
    sys.exit(main())
