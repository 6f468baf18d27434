#!/usr/bin/env python3
"""Compare the glTF and the SPZ of a run with what a program of others makes of the same Gaussians.

usage: scripts/check-splats.py RUN [--dataset DATASET] [--erfgs BINARY]

`erfgs export RUN` writes the first instant as PLY, and `--to gltf --at 0` and `--to spz --at 0` as glTF and SPZ. SplatTransform of PlayCanvas (npm,
fetched into target/check-splats) makes a glTF of the PLY, and one of the SPZ. Ours, and that of the SPZ, are compared with that of the PLY by the
words of the extension's specification: places, covariances from scales and rotations, opacities, and colours from harmonics along some ways, of
each Gaussian that can be seen. They may turn the axes of the PLY differently, as long as it is a half turn.
"""

import argparse
import json
import math
import pathlib
import struct
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent
PACKAGE = "@playcanvas/splat-transform@3.7.0"
# Fainter ones are not in the glTF.
LEAST_OPACITY = 1 / 255
# How far off each may be: of glTF by rounding, of SPZ by its steps (a scale is a sixteenth of an e-fold, a covariance goes with its square).
MOST = {
    "gltf": {"place": 1e-4, "covariance": 1e-4, "opacity": 1e-4, "colour": 1e-4},
    "spz": {"place": 1e-4, "covariance": 0.09, "opacity": 2.1e-3, "colour": 0.02},
}

NAME = "KHR_gaussian_splatting"
WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}


def read(path: pathlib.Path) -> dict[str, list[tuple[float, ...]]]:
    """The attributes of the splats of a binary glTF."""
    data = path.read_bytes()
    magic, version, length, json_length, kind = struct.unpack_from("<4sIII4s", data)
    if (magic, version, length, kind) != (b"glTF", 2, len(data), b"JSON"):
        sys.exit(f"{path} is no binary glTF")
    document = json.loads(data[20 : 20 + json_length])
    binary = 28 + json_length
    primitive = next(p for mesh in document["meshes"] for p in mesh["primitives"] if NAME in p.get("extensions", {}))
    extension = primitive["extensions"][NAME]
    if primitive["mode"] != 0 or extension["kernel"] != "ellipse" or extension["colorSpace"] != "srgb_rec709_display":
        sys.exit(f"{path}: {primitive}")
    attributes = {}
    for name, index in primitive["attributes"].items():
        accessor = document["accessors"][index]
        if not name.startswith(NAME) and name != "POSITION":
            continue
        if accessor["componentType"] != 5126:
            sys.exit(f"{path}: {name} is not of floats")
        view = document["bufferViews"][accessor["bufferView"]]
        width = WIDTHS[accessor["type"]]
        at = binary + view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        stride = view.get("byteStride", 4 * width)
        attributes[name.removeprefix(f"{NAME}:")] = [struct.unpack_from(f"<{width}f", data, at + row * stride) for row in range(accessor["count"])]
    return attributes


def colour(splats: dict, row: int, way: tuple[float, float, float]) -> list[float]:
    """Along a way, of degrees 0 and 1."""
    x, y, z = way
    basis = {"SH_DEGREE_0_COEF_0": 0.2820948, "SH_DEGREE_1_COEF_0": -0.4886025 * y, "SH_DEGREE_1_COEF_1": 0.4886025 * z, "SH_DEGREE_1_COEF_2": -0.4886025 * x}
    return [sum(factor * splats[name][row][channel] for name, factor in basis.items() if name in splats) for channel in range(3)]


def covariance(splats: dict, row: int) -> list[float]:
    # SplatTransform 3.7 leaves quaternions as they are in the PLY, of any length, where the specification has unit ones.
    length = math.sqrt(sum(part * part for part in splats["ROTATION"][row]))
    x, y, z, w = (part / length for part in splats["ROTATION"][row])
    r = [[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
         [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
         [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]]
    s = [scale * scale for scale in splats["SCALE"][row]]
    return [sum(r[i][k] * s[k] * r[j][k] for k in range(3)) for i in range(3) for j in range(i, 3)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run")
    parser.add_argument("--dataset")
    parser.add_argument("--erfgs", default=str(ROOT / "target/release/erfgs"))
    arguments = parser.parse_args()
    packages = ROOT / "target/check-splats"
    stamp = packages / "packages.txt"
    if not stamp.is_file() or stamp.read_text() != PACKAGE:
        packages.mkdir(parents=True, exist_ok=True)
        (packages / "package.json").write_text('{"private": true}')
        subprocess.run(["npm", "install", "--silent", "--no-audit", "--no-fund", "--ignore-scripts", PACKAGE], cwd=packages, check=True)
        stamp.write_text(PACKAGE)
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        export = [arguments.erfgs, "export", arguments.run, *(["--dataset", arguments.dataset] if arguments.dataset else [])]
        transform = packages / "node_modules/.bin/splat-transform"
        glb, spz, splats = folder / "scene.glb", folder / "scene.spz", folder / "splats"
        subprocess.run([*export, "--to", "gltf", "--at", "0", "--out", glb], check=True)
        subprocess.run([*export, "--to", "spz", "--at", "0", "--out", spz], check=True)
        subprocess.run([*export, "--instants", "1", "--out", splats], check=True, stdout=subprocess.DEVNULL)
        of_ply, of_spz = folder / "of-ply.glb", folder / "of-spz.glb"
        for source, target in ((splats / "point_cloud_t/00000.ply", of_ply), (spz, of_spz)):
            subprocess.run([transform, source, target], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        theirs, ours = read(of_ply), {"gltf": read(glb), "spz": read(of_spz)}
    off = max(abs(sum(part * part for part in rotation) - 1) for rotation in ours["gltf"]["ROTATION"])
    if off > 1e-5:
        sys.exit(f"rotations are off unit length by {off}")
    for format, splats in ours.items():
        compare(format, splats, theirs)


def compare(format: str, ours: dict, theirs: dict) -> None:
    if set(ours) != set(theirs):
        sys.exit(f"{format}: other attributes: {sorted(ours)} and {sorted(theirs)}")
    # Ours leaves out what cannot be seen.
    seen = [row for row, (opacity,) in enumerate(theirs["OPACITY"]) if opacity >= LEAST_OPACITY]
    if len(seen) != len(ours["POSITION"]):
        sys.exit(f"{format}: {len(ours['POSITION'])} Gaussians, and there {len(seen)}")
    first, other = ours["POSITION"][0], theirs["POSITION"][seen[0]]
    signs = tuple(1 if abs(a - b) <= abs(a + b) else -1 for a, b in zip(first, other))
    if signs[0] * signs[1] * signs[2] != 1:
        sys.exit(f"{format}: one is mirrored: {first} and {other}")
    worst = {"place": 0.0, "covariance": 0.0, "opacity": 0.0, "colour": 0.0}
    tell = lambda what, pairs: worst.update({what: max(worst[what], *(abs(a - b) for a, b in pairs))})
    turned = [signs[i] * signs[j] for i in range(3) for j in range(i, 3)]
    for own, other in enumerate(seen):
        tell("place", ((a * sign, b) for a, b, sign in zip(ours["POSITION"][own], theirs["POSITION"][other], signs)))
        tell("opacity", zip(ours["OPACITY"][own], theirs["OPACITY"][other]))
        mine, its = covariance(ours, own), covariance(theirs, other)
        size = max(map(abs, its))
        tell("covariance", ((a * sign / size, b / size) for a, b, sign in zip(mine, its, turned)))
        for way in ((0.6, -0.64, 0.48), (-0.36, 0.48, 0.8)):
            there = tuple(v * sign for v, sign in zip(way, signs))
            tell("colour", zip(colour(ours, own, way), colour(theirs, other, there)))
    print(f"{format}: {len(seen)} Gaussians, axes times {signs}; off by at most:", ", ".join(f"{name} {off:.1g}" for name, off in worst.items()))
    if any(worst[name] > most for name, most in MOST[format].items()):
        sys.exit("they are not the same")


if __name__ == "__main__":
    main()
