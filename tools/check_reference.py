#!/usr/bin/env python3
"""Renders the scenes of a folder and compares the pictures with its reference pictures.

    pip install numpy
    tools/check_reference.py REFERENCE_FOLDER --caches CACHE_FOLDER \\
        --binary target/release/deepfield

REFERENCE_FOLDER holds scenes `NAME.toml` and pictures `NAME.rgba.f32` (raw little-endian f32,
rows from the top, R G B A). The cache of scene NAME is the one in CACHE_FOLDER whose name (without
`.dfc`) NAME starts with; `--cache FILE` takes one cache for all scenes.

Printed for each scene: the largest and the mean absolute difference of any channel, both relative
to the reference's largest value. Exit code 1 if a limit is exceeded.
"""

import argparse
import pathlib
import struct
import subprocess
import sys
import tempfile
import tomllib
import zlib

import numpy as np

LARGEST = 1e-4
MEAN = 1e-6
UNCOMPRESSED, ZIPS, ZIP = 0, 2, 3


def read_exr(path):
    """R, G, B, A of a scan-line EXR with 32-bit float channels, as an array (height, width, 4)."""
    data = pathlib.Path(path).read_bytes()
    magic, version = struct.unpack_from("<II", data)
    if magic != 20000630 or version & 0x1A00:
        raise ValueError(f"{path}: not a single-part scan-line EXR")
    attributes, at = exr_attributes(data, 8)
    compression = attributes["compression"][0]
    lines = {UNCOMPRESSED: 1, ZIPS: 1, ZIP: 16}.get(compression)
    if lines is None:
        raise ValueError(f"{path}: compression {compression}: only none, ZIPS and ZIP are read")
    x0, y0, x1, y1 = struct.unpack("<4i", attributes["dataWindow"])
    width, height = x1 - x0 + 1, y1 - y0 + 1
    channels = exr_channels(attributes["channels"], path)
    picture = np.zeros((height, width, 4), dtype=np.float32)
    offsets = struct.unpack_from(f"<{-(-height // lines)}Q", data, at)
    for offset in offsets:
        first, size = struct.unpack_from("<ii", data, offset)
        row, rows = first - y0, min(lines, y1 + 1 - first)
        block = data[offset + 8 : offset + 8 + size]
        expected = rows * width * 4 * len(channels)
        if compression != UNCOMPRESSED and size < expected:
            block = unzip(block)
        values = np.frombuffer(block, dtype="<f4").reshape(rows, len(channels), width)
        for place, name in enumerate(channels):
            if name in "RGBA":
                picture[row : row + rows, :, "RGBA".index(name)] = values[:, place]
    return picture


def exr_attributes(data, at):
    """The header's attributes as bytes, and where the header ends."""
    attributes = {}
    while data[at]:
        name_end = data.index(0, at)
        kind_end = data.index(0, name_end + 1)
        (size,) = struct.unpack_from("<I", data, kind_end + 1)
        start = kind_end + 5
        attributes[data[at:name_end].decode()] = data[start : start + size]
        at = start + size
    return attributes, at + 1


def exr_channels(listed, path):
    """Names of the channels in the order of the pixel data."""
    names, at = [], 0
    while listed[at]:
        end = listed.index(0, at)
        (kind,) = struct.unpack_from("<i", listed, end + 1)
        if kind != 2:
            raise ValueError(f"{path}: a channel is not 32-bit float")
        names.append(listed[at:end].decode())
        at = end + 17
    return names


def unzip(block):
    """Undoes EXR's ZIP: zlib, then differences of bytes, then two interleaved halves."""
    coded = np.frombuffer(zlib.decompress(block), dtype=np.uint8).astype(np.int64)
    coded[1:] -= 128
    plain = (np.cumsum(coded) & 0xFF).astype(np.uint8)
    half = (len(plain) + 1) // 2
    woven = np.empty_like(plain)
    woven[0::2], woven[1::2] = plain[:half], plain[half:]
    return woven.tobytes()


def cache_of(scene, arguments):
    """The cache that a scene is rendered from."""
    if arguments.cache:
        return arguments.cache
    caches = pathlib.Path(arguments.caches).glob("*.dfc")
    fitting = [cache for cache in caches if scene.stem.startswith(cache.stem)]
    if not fitting:
        raise FileNotFoundError(f"{arguments.caches}: no cache whose name {scene.stem} starts with")
    return max(fitting, key=lambda cache: len(cache.stem))


def compare(scene, arguments, folder):
    """Renders a scene; largest and mean difference relative to the largest value."""
    size = tomllib.loads(scene.read_text())["image"]
    reference = np.fromfile(scene.with_suffix(".rgba.f32"), dtype="<f4")
    reference = reference.reshape(size["height"], size["width"], 4).astype(np.float64)
    picture = pathlib.Path(folder) / f"{scene.stem}.exr"
    command = [arguments.binary, "render", cache_of(scene, arguments), scene, "-o", picture]
    subprocess.run([str(word) for word in command + arguments.options], check=True)
    rendered = read_exr(picture)
    if rendered.shape != reference.shape:
        raise ValueError(f"{scene}: rendered as {rendered.shape}, reference {reference.shape}")
    difference = np.abs(rendered.astype(np.float64) - reference) / np.abs(reference).max()
    return difference.max(), difference.mean()


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("reference", type=pathlib.Path)
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument("--caches", help="folder of caches")
    source.add_argument("--cache", help="one cache for all scenes")
    parser.add_argument("--binary", default="target/release/deepfield")
    parser.add_argument("--only", default="", help="scenes whose names start so")
    parser.add_argument("options", nargs="*", help="more options of `render`, after `--`")
    arguments = parser.parse_args()
    scenes = sorted(arguments.reference.glob(f"{arguments.only}*.toml"))
    failed = 0
    with tempfile.TemporaryDirectory() as folder:
        for scene in scenes:
            try:
                largest, mean = compare(scene, arguments, folder)
            except (OSError, ValueError, subprocess.CalledProcessError) as error:
                print(f"{scene.stem}: FAILED: {error}")
                failed += 1
                continue
            # Comparisons that NaN fails.
            good = largest <= LARGEST and mean <= MEAN
            failed += not good
            print(f"{scene.stem}: largest {largest:.2e}, mean {mean:.2e}{'' if good else ' FAILED'}")
    print(f"{len(scenes)} scenes, {failed} failed")
    return 1 if failed or not scenes else 0


if __name__ == "__main__":
    sys.exit(main())
