#!/usr/bin/env python3
"""Draws one emission-only picture with yt's volume renderer; compare_with_yt.py runs it in a
process of its own.

    tools/yt_picture.py DATASET densest FIELD    # where to look: JSON
    tools/yt_picture.py DATASET SPEC.json        # SPEC names the picture; prints times: JSON

SPEC: `field`, `log` (whether its logarithm is drawn), `table` (`low`, `high`, and `rgb`, the
emission at equal steps from one to the other, 1 / code length), `position`, `look_at`, `up`
(code length), `fov` (vertical, degrees) or `height` (plane-parallel, code length), `width_px`,
`height_px`, `samples` (a list: how many a cell, a picture each), `ghost_zones`, `threads`,
`repeat` and `out` (a folder for the pictures, `.npy`, rows from the top).

What yt computes, and what is done to get the integral of the emission along each pixel's ray in
code length:

- yt's rays are `position + t·direction`, 0 ≤ t ≤ 1, and it sums `emission(value)·dt`, so that its
  pixels are to be multiplied by the direction's length, which differs from pixel to pixel.
- The first and last pixels' rays go through the picture's edges (`linspace`), deepfield's through
  pixels' centres: the view given to yt is narrower by one pixel. PerspectiveLens ties the
  height to the width by the resolution, which is not the same number: `CentredLens` puts it right.
- Values outside a table count as 0 and so does its last: tables are extended on both sides.
- Opacity would be composited far over near; with `grey_opacity` and an opacity of 0 there is none.
"""

import json
import os
import sys
import time


def main():
    if len(sys.argv) < 3:
        raise SystemExit(__doc__)
    if sys.argv[2] == "densest":
        print(json.dumps(densest(load(sys.argv[1]), sys.argv[3])))
        return
    with open(sys.argv[2], encoding="utf-8") as file:
        spec = json.load(file)
    # Before OpenMP starts.
    os.environ["OMP_NUM_THREADS"] = str(spec["threads"])
    # yt starts its threads once a brick. On a machine that others use too, threads that spin
    # between bricks cost it several seconds a picture.
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    print(json.dumps(draw(sys.argv[1], spec)))


def load(path):
    """The data set, in code units."""
    import yt

    yt.set_log_level("error")
    return yt.load(path, unit_system="code")


def densest(dataset, name):
    """Centre and width of the cell with the largest value on the deepest level."""
    import numpy as np
    from check_synth_with_yt import stored_field

    field, best = stored_field(dataset, name), None
    deepest = dataset.index.max_level
    for grid in dataset.index.grids:
        if int(grid.Level) == deepest:
            values = grid[field].d
            cell = np.unravel_index(np.argmax(values), values.shape)
            if best is None or values[cell] > best[0]:
                centre = grid.LeftEdge.d + (np.array(cell) + 0.5) * grid.dds.d
                best = values[cell], centre.tolist(), float(grid.dds.d.max())
    return {"position": best[1], "cell": best[2], "level": int(deepest)}


class Clock:
    """Wall and CPU seconds since the last reading."""

    def __init__(self):
        self.read()

    def read(self):
        """Both, and starts anew."""
        now = time.perf_counter(), time.process_time()
        since = [b - a for a, b in zip(getattr(self, "last", now), now)]
        self.last = now
        return {"wall": since[0], "cpu": since[1]}


def draw(path, spec):
    """Draws the pictures; times of each step."""
    clock, times = Clock(), {}
    import numpy as np
    from check_synth_with_yt import stored_field
    from yt.visualization.volume_rendering.api import Scene, create_volume_source

    times["import"] = clock.read()
    dataset = load(path)
    dataset.index
    times["load"] = clock.read()
    source = create_volume_source(dataset.all_data(), stored_field(dataset, spec["field"]))
    source.set_log(spec["log"])
    source.set_use_ghost_zones(spec["ghost_zones"])
    source.set_transfer_function(transfer_function(spec["table"]))
    source.num_threads = spec["threads"]
    scene = Scene()
    scene.add_source(source)
    # A picture of four pixels: all it takes is yt's tree and bricks, which are kept.
    source.num_samples = 1
    place_camera(scene, dataset, spec, 2, 2)
    scene.render()
    times["bricks"] = clock.read()
    times["pictures"] = []
    for samples in spec["samples"]:
        source.num_samples = samples
        for turn in range(spec["repeat"]):
            # An Orientation keeps the camera before: each picture has its own.
            lengths = place_camera(scene, dataset, spec, spec["width_px"], spec["height_px"])
            clock.read()
            image = scene.render()
            times["pictures"].append({"samples": samples, **clock.read()})
        picture = np.asarray(image)[:, :, :3].swapaxes(0, 1) * lengths[:, :, None]
        np.save(os.path.join(spec["out"], f"yt_{samples}.npy"), picture)
    return times


def transfer_function(table):
    """Emission alone: an opacity of 0, which does not weigh the colours."""
    import numpy as np
    from yt.visualization.volume_rendering.api import ColorTransferFunction

    rgb = np.array(table["rgb"])
    bounds = (table["low"], table["high"])
    function = ColorTransferFunction(bounds, len(rgb), grey_opacity=True)
    function.weight_table_ids = [-1] * 6
    for channel in range(3):
        function.funcs[channel].y[:] = rgb[:, channel]
    return function


def place_camera(scene, dataset, spec, across, down):
    """Puts a camera into the scene; lengths of its rays' directions, code length."""
    import numpy as np
    from yt.visualization.volume_rendering.lens import PerspectiveLens

    class CentredLens(PerspectiveLens):
        """Rows as far apart as columns."""

        def _get_sampler_params(self, camera, render_source):
            parameters = super()._get_sampler_params(camera, render_source)
            rows = camera.resolution[1]
            wanted = camera.width[0] * (rows - 1) / (camera.resolution[0] - 1)
            scale = parameters["vp_dir"][0, 0] @ camera.unit_vectors[2] / camera.width[2]
            shift = (wanted - camera.width[1]) * scale * np.linspace(-0.5, 0.5, rows)
            parameters["vp_dir"] += shift[None, :, None] * camera.unit_vectors[1]
            return parameters

    perspective = spec.get("fov") is not None
    camera = scene.add_camera(dataset, "perspective" if perspective else "plane-parallel")
    camera.resolution = (across, down)
    camera.position = dataset.arr(spec["position"], "code_length")
    camera.focus = dataset.arr(spec["look_at"], "code_length")
    camera.switch_orientation(north_vector=np.array(spec["up"], dtype=float))
    return aim(camera, dataset, spec, CentredLens() if perspective else None)


def aim(camera, dataset, spec, lens):
    """Sets the view's width; lengths of its rays' directions."""
    import numpy as np

    across, down = camera.resolution
    # Not the camera's own, which are in units of the domain's width.
    position, middle = np.array(spec["position"]), np.array(spec["look_at"])
    distance = float(np.linalg.norm(middle - position))
    if lens is None:
        pitch = spec["height"] / down
        # The whole domain, also behind `position`.
        domain = dataset.domain_left_edge.d, dataset.domain_right_edge.d
        depth = 2 * float(np.linalg.norm(np.maximum(*np.abs([e - middle for e in domain]))))
        camera.width = dataset.arr([pitch * (across - 1), pitch * (down - 1), depth], "code_length")
        return np.full((down, across), depth)
    pitch = 2 * distance * np.tan(np.radians(spec["fov"]) / 2) / down
    camera.width = dataset.arr([pitch * (across - 1), pitch * (down - 1), distance], "code_length")
    camera.set_lens(lens)
    centre, width = dataset.domain_center.d, dataset.domain_width.d
    longest = np.linalg.norm(position - centre) + 0.5 * np.linalg.norm(width)
    x, y = (pitch / distance * (np.arange(n) - (n - 1) / 2) for n in (across, down))
    return longest * np.sqrt(1 + x[None, :] ** 2 + y[:, None] ** 2)


if __name__ == "__main__":
    main()
