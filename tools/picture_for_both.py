"""One picture as deepfield's scene and as what yt_picture.py takes; for compare_with_yt.py.

The picture is emission alone, one ray through each pixel's centre: yt composites far over near, so
nothing opaque can be compared. A scene's absorption is left out on both sides.
"""

import tomllib

import numpy as np

# Points of yt's table from one end of the range to the other; as many more lie beyond each end.
BINS = 4096
# Points of the emission of a camera of one's own.
POINTS = 16
# From outside: where the eye is, from the middle of the domain, in its diagonals.
DIRECTION = np.array([0.62, 0.44, -0.91])
OUTSIDE_FOV = 36.0
# From inside: where the eye is, from the densest cell, in cells of the deepest level.
CELLS_AWAY = np.array([11.3, 7.9, -14.6])
INSIDE_FOV = 60.0


def own(camera, field, domain, densest):
    """A scene from outside or inside for any data set. The emission goes with the field's square
    root: of a core with ρ ~ 1/r² each decade of r then adds as much."""
    low, high = field["min"], field["max"]
    log = low > 0
    left, right = (np.array([float(x) for x in edge]) for edge in domain)
    diagonal = float(np.linalg.norm(right - left))
    if camera == "outside":
        look_at, distance, fov = (left + right) / 2, diagonal, OUTSIDE_FOV
        position = look_at + DIRECTION * distance
    else:
        look_at, distance, fov = np.array(densest["position"]), diagonal, INSIDE_FOV
        position = look_at + CELLS_AWAY * densest["cell"]
    decades = np.log10(high / low) / 2 if log else 0.0
    steps = np.linspace(0.0, 1.0, POINTS + 1)
    emission = 10 ** (decades * steps) if log else steps
    return {
        "camera": {"position": position.tolist(), "look_at": look_at.tolist(), "fov": fov},
        "volume": [
            {
                "field": field["name"],
                "scale": "log10" if log else "linear",
                "color": [[0.0, 0.2, 0.6, 1.0], [0.5, 0.6, 1.0, 0.6], [1.0, 1.0, 0.6, 0.2]],
                "emission": [[float(x), float(e / distance)] for x, e in zip(steps, emission)],
            }
        ],
    }


def from_file(path):
    """A scene file's camera and volume."""
    with open(path, "rb") as file:
        scene = tomllib.load(file)
    volume = scene["volume"][0]
    render = scene.get("render", {})
    if volume.get("scale", "log10") not in ("log10", "linear"):
        raise SystemExit(f"{path}: yt knows log10 and linear values only")
    if volume.get("units", "code") != "code" or render.get("interpolation", "linear") != "linear":
        raise SystemExit(f"{path}: only linear interpolation and code units are compared")
    image = scene.get("image", {})
    size = {key: image[key] for key in ("width", "height") if key in image}
    return {"image": size, "camera": scene["camera"], "volume": [volume]}


def complete(scene, field, size):
    """Fills in what yt needs to be told, and takes the absorption out."""
    volume = scene["volume"][0]
    volume.setdefault("scale", "log10")
    volume.setdefault("range", [field["min"], field["max"]])
    emission = volume.get("emission") or volume.get("absorption") or [[0.0, 0.0], [1.0, 5.0]]
    volume |= {"emission": emission, "absorption": [[0.0, 0.0], [1.0, 0.0]]}
    scene["camera"].setdefault("up", [0.0, 1.0, 0.0])
    return scene | {
        "image": {"width": size[0], "height": size[1]},
        "render": {"interpolation": "linear", "samples": 1},
    }


def toml(scene):
    """The scene file's text."""
    lines = []
    for name, table in scene.items():
        table = table[0] if name == "volume" else table
        lines.append("[[volume]]" if name == "volume" else f"[{name}]")
        lines += [f"{key} = {value(content)}" for key, content in table.items()]
    return "\n".join(lines) + "\n"


def value(content):
    """A TOML value."""
    if isinstance(content, str):
        return '"' + content.replace("\\", "\\\\").replace('"', '\\"') + '"'
    if isinstance(content, list):
        return "[" + ", ".join(map(value, content)) + "]"
    return repr(content)


def for_yt(scene, arguments, folder):
    """What yt_picture.py draws."""
    volume, camera = scene["volume"][0], scene["camera"]
    orthographic = camera.get("projection", "perspective") == "orthographic"
    view = {"height": camera.get("height", 1.0)} if orthographic else {"fov": camera.get("fov", 45)}
    places = ("position", "look_at", "up")
    return {
        "field": volume["field"],
        "log": volume["scale"] == "log10",
        "table": table(volume),
        **{place: [float(x) for x in camera[place]] for place in places},
        **view,
        "width_px": scene["image"]["width"],
        "height_px": scene["image"]["height"],
        "samples": arguments.yt_samples,
        "ghost_zones": arguments.ghost_zones,
        "threads": arguments.threads,
        "repeat": arguments.repeat,
        "out": str(folder),
    }


def table(volume):
    """Emission times colour at equal steps of the drawn value, from one range's width below to one
    above."""
    low, high = (float(x) for x in volume["range"])
    if volume["scale"] == "log10":
        low, high = np.log10(low), np.log10(high)
    steps = np.linspace(-1.0, 2.0, 3 * BINS + 1)
    points = np.array(volume["emission"], dtype=float)
    emission = np.interp(steps, points[:, 0], points[:, 1])
    color = np.array(colors(volume), dtype=float)
    rgb = [emission * np.interp(steps, color[:, 0], color[:, 1 + c]) for c in range(3)]
    width = high - low
    return {"low": low - width, "high": high + width, "rgb": np.transpose(rgb).tolist()}


def colors(volume):
    """Points x, r, g, b of the colour, linear RGB."""
    if "color" in volume:
        return volume["color"]
    import matplotlib

    name = volume.get("colormap", "viridis")
    if name not in matplotlib.colormaps:
        raise SystemExit(f"colour map {name}: matplotlib has no such; give `color` instead")
    srgb = matplotlib.colormaps[name](np.arange(256))[:, :3]
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    return np.column_stack([np.arange(256) / 255, linear])
