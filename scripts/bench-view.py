#!/usr/bin/env python3
"""Time the page of `erfgs view` in headless Chromium without a graphics processor, and a peer on the same cloud in the same run.

usage: scripts/bench-view.py [--erfgs BINARY] [--counts N,N] [--size WxH] [--frames N] [--mbit RATE] [--peers]

A made cloud (a room that stands still; a fifth of the Gaussians move) is written as a scene file and served by erfgs. Of each size:
the time from opening the page to the first picture and to all of it, once as fast as it goes and once over a line of --mbit; the
median time of a picture from a camera that moves, drawn fast and exactly; and what of it each part takes, each run alone. Beside each
stands the mean time of the processor over all processes of the browser, which other programs on the machine do not change.

With --peers the same Gaussians are also drawn by viewers of others (npm packages, fetched into target/bench-view; they draw with WebGL 2
on the same software renderer): standing still, from a PLY file, by Spark and GaussianSplats3D; with a fifth that moves, from a `.splatv`
file, by gsplat.js. They sort in a worker beside drawing, so that a picture may be in the order of an earlier view.
"""

import argparse
import base64
import functools
import gzip
import http.server
import json
import math
import os
import pathlib
import platform
import random
import signal
import statistics
import struct
import subprocess
import tempfile
import threading
import time
from array import array

ROOT = pathlib.Path(__file__).resolve().parent.parent
PEERS = ["three@0.187.0", "@sparkjsdev/spark@2.2.0", "@mkkellogg/gaussian-splats-3d@0.4.7", "gsplat@1.2.9"]
# Intervals between frames in a second of the made cloud, and the least life of a Gaussian, in intervals.
INTERVALS, LEAST_LIFE = 5.0, 0.5
FLAGS = """--no-sandbox --headless=new --enable-unsafe-webgpu --enable-features=Vulkan --use-vulkan=swiftshader --use-angle=swiftshader
    --no-first-run --disable-extensions --window-size=800,700 --remote-debugging-pipe about:blank""".split()
SH_C0 = 0.28209479
# An older page shows all or nothing.
ALL = "document.body.dataset.shown === 'all' || document.body.dataset.drawn > 0 && !document.getElementById('loading')"


def cloud(count: int, moving: int) -> dict:
    """Rows of Gaussians: core (12 numbers), colour coefficients (3), motion (8, of those that move)."""
    draw = random.Random(1)
    core, colour, motion = [], [], []
    for row in range(count):
        if row < moving:
            # A ball that flies from left to right.
            way = [draw.gauss(0, 1) for _ in range(3)]
            length = math.hypot(*way)
            mean = [0.5 * v / length + (0.2 if axis == 1 else 0) for axis, v in enumerate(way)]
            rgb = (0.95, 0.55, 0.1) if math.floor(8 * math.atan2(way[2], way[0]) / math.pi) % 2 else (0.15, 0.35, 0.95)
            scale = [0.012 * (0.7 + draw.random()) for _ in range(3)]
            motion.append([0.32, 0.06 * way[1] / length, 0, 2.5, 0, 0, 0, 1.5])
            rotation, opacity = [draw.gauss(0, 1) for _ in range(4)], 2.0
        else:
            # Floor and two walls, chequered.
            side = row % 3
            a, b = draw.uniform(-2, 2), draw.uniform(-2, 2)
            mean = [[a, 1, b], [a, b / 2, 2], [-2, a / 2, b]][side]
            dark = (math.floor(4 * a) + math.floor(4 * b)) % 2
            base = [(0.8, 0.8, 0.75), (0.5, 0.7, 0.5), (0.7, 0.5, 0.5)][side]
            rgb = [c * (0.35 if dark else 1) * (0.85 + 0.3 * draw.random()) for c in base]
            size = 0.03 * math.sqrt(50_000 / count)
            scale = [0.004 if axis == (1, 2, 0)[side] else size * (0.5 + draw.random()) for axis in range(3)]
            rotation, opacity = [1, 0, 0, 0], draw.gauss(1.5, 1)
        core.append([*mean, *map(math.log, scale), *rotation, opacity, 0])
        colour.append([(c - 0.5) / SH_C0 for c in rgb])
    return {"core": core, "colour": colour, "motion": motion}


def cameras(width: int, height: int) -> list:
    """One camera that looks at the middle of the room."""
    rotation = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
    view = {"width": width, "height": height, "fx": 0.8 * width, "fy": 0.8 * width, "cx": width / 2, "cy": height / 2}
    frames = [[k / 10, k / 10, k / 10] for k in range(11)]
    pose = {"rotation": rotation, "translation": [0.0, 0.0, 3.0]}
    return [{"name": "made", "split": "test", "modality": "rgb", **view, **pose, "near": 0.1, "frames": frames}]


def scene_file(made: dict, size: tuple[int, int], first: bool) -> bytes:
    """A scene file (docs/reference/scene-file.md) whose numbers are exact; `first`: of the first version, which has no coarse parts."""
    count, moving = len(made["core"]), len(made["motion"])
    sections, coarse, written = [], [], []

    def section(name: str, rows: list, at: int) -> None:
        numbers = array("f", [number for row in rows for number in row])
        if numbers or name == "points":
            sections.append({"name": name, "at": at, "floats": len(numbers), "coding": {"kind": "exact"}})
            written.append(numbers.tobytes())

    section("points", [], 0)
    harmonics = [[*rgb, 0] for rgb in made["colour"]]
    before = [0, moving]
    for share in [1] if first else [0.125, 0.5, 1]:
        ends = [math.ceil(share * moving), moving + math.ceil(share * (count - moving))]
        for name, rows, floats in (("core", made["core"], 12), ("sh", harmonics, 4), ("motion", made["motion"], 8)):
            if first:
                section(name, rows, 0)
                continue
            for group in range(2):
                section(name, rows[before[group] : ends[group]], before[group] * floats)
        if share < 1:
            coarse.append({"sections": len(sections), "dynamic": ends[0], "still": ends[1] - moving})
        before = ends
    motion = {"kind": "free-time", "intervals": INTERVALS, "least_life": LEAST_LIFE, "gone": -40.0, "knots": 0, "spacing": 1.0}
    header = {
        "count": count, "dynamic": moving, "sh_degree": 0, "active_sh_degree": 0, "background": [0.0, 0.0, 0.0], "near": [0.1, 0.0],
        "near_sigmas": 3.0, "span_ns": [0, 1_000_000_000], "motion": motion if moving else {"kind": "still"}, "only_server": None,
        "cameras": cameras(*size), "events": {"edges": [], "counts": []}, "sections": sections, "coarse": coarse,
    }
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    magic = b"ERFGS4D1" if first else b"ERFGS4D2"
    return magic + struct.pack("<I", len(text)) + text + b"".join(written)


def ply(made: dict) -> bytes:
    """The layout of 3D Gaussian splatting."""
    names = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", *(f"scale_{k}" for k in range(3)), *(f"rot_{k}" for k in range(4))]
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(made['core'])}\n"
    head += "".join(f"property float {name}\n" for name in names) + "end_header\n"
    numbers = array("f")
    for core, rgb in zip(made["core"], made["colour"]):
        numbers.extend([*core[:3], *rgb, core[10], *core[3:6], *core[6:10]])
    return head.encode() + numbers.tobytes()


def splatv(made: dict) -> bytes:
    """The layout of splaTV, which gsplat.js reads: 16 words a Gaussian in rows of a texture, halves in pairs but for the place and colour.

    What moves is at p + v dt + a dt^2 with opacity o exp(-(dt / s)^2), dt the time since its instant, in a film that takes 1."""
    count = len(made["core"])
    height = math.ceil(count / 1024)
    rows = bytearray(height * 1024 * 64)
    for row, (core, rgb) in enumerate(zip(made["core"], made["colour"])):
        # What stands still lives for ever.
        speed, instant, bend, life = [0.0] * 3, 0.0, [0.0] * 3, 60_000.0
        if row < len(made["motion"]):
            vx, vy, vz, instant, ax, ay, az, life = made["motion"][row]
            speed, bend = [v * INTERVALS for v in (vx, vy, vz)], [a * INTERVALS**2 / 2 for a in (ax, ay, az)]
            instant, life = instant / INTERVALS, (LEAST_LIFE + math.exp(life)) * math.sqrt(2) / INTERVALS
        rotation = [part / math.hypot(*core[6:10]) for part in core[6:10]]
        bytes_of = [*(0.5 + SH_C0 * c for c in rgb), 1 / (1 + math.exp(-core[10]))]
        struct.pack_into("<3f4e3e2x4B9e2x4e2e", rows, 64 * row, *core[:3], *rotation, *map(math.exp, core[3:6]),
                         *(round(255 * min(max(v, 0), 1)) for v in bytes_of), *speed, *bend, *[0.0] * 3, *[0.0] * 4, instant, life)
    chunks = json.dumps([{"type": "splat", "size": len(rows), "texwidth": 4096, "texheight": height, "cameras": []}]).encode()
    return struct.pack("<II", 0x674B, len(chunks)) + chunks + rows


class Browser:
    """Chromium, told over the pipe of its DevTools what to do."""

    def __init__(self) -> None:
        self.folder = tempfile.TemporaryDirectory()
        (to, self.to), (self.answers, answers) = os.pipe(), os.pipe()
        environment = {name: value for name, value in os.environ.items() if name not in ("VK_DRIVER_FILES", "VK_ICD_FILENAMES")}
        script = f'exec chromium --user-data-dir={self.folder.name} "$@" 3<&{to} 4>&{answers}'
        command = ["bash", "-c", script, "chromium", *FLAGS]
        quiet = subprocess.DEVNULL
        self.program = subprocess.Popen(command, pass_fds=(to, answers), env=environment, stdin=quiet, stdout=quiet, stderr=quiet, start_new_session=True)
        os.close(to)
        os.close(answers)
        self.calls, self.left, self.session = 0, b"", None

    def call(self, method: str, parameters: dict) -> dict:
        self.calls += 1
        message = {"id": self.calls, "method": method, "params": parameters}
        if self.session:
            message["sessionId"] = self.session
        os.write(self.to, json.dumps(message).encode() + b"\0")
        while True:
            while b"\0" not in self.left:
                more = os.read(self.answers, 1 << 20)
                if not more:
                    raise SystemExit("bench-view.py: Chromium ended (scripts/setup.sh --browser installs it)")
                self.left += more
            text, self.left = self.left.split(b"\0", 1)
            answer = json.loads(text)
            if answer.get("id") == self.calls:
                if "error" in answer:
                    raise SystemExit(f"bench-view.py: {method}: {answer['error']}")
                return answer["result"]

    def open(self, url: str, mbit: float = 0) -> None:
        """Opens a page in place of the one that is open, over a line that is so fast."""
        if self.session:
            self.session, target = None, self.target
            self.call("Target.closeTarget", {"targetId": target})
        self.target = self.call("Target.createTarget", {"url": "about:blank"})["targetId"]
        self.session = self.call("Target.attachToTarget", {"targetId": self.target, "flatten": True})["sessionId"]
        self.call("Network.enable", {})
        self.call("Network.setCacheDisabled", {"cacheDisabled": True})
        if mbit:
            rate = mbit * 1e6 / 8
            line = {"offline": False, "latency": 20, "downloadThroughput": rate, "uploadThroughput": rate}
            self.call("Network.emulateNetworkConditions", line)
        self.call("Page.navigate", {"url": url})

    def evaluate(self, expression: str):
        parameters = {"expression": expression, "returnByValue": True, "awaitPromise": True}
        answer = self.call("Runtime.evaluate", parameters)
        if "exceptionDetails" in answer:
            raise SystemExit(f"bench-view.py: {json.dumps(answer['exceptionDetails'])[:600]}")
        return answer["result"].get("value")

    def wait(self, expression: str, seconds: float = 300) -> float:
        """Waits until an expression is true; seconds."""
        start = time.monotonic()
        while not self.evaluate(f"(() => {{ try {{ return Boolean({expression}); }} catch {{ return false; }} }})()"):
            if time.monotonic() - start > seconds:
                raise SystemExit(f"bench-view.py: {expression} does not come true: {self.evaluate('document.body.innerText')[:400]}")
            time.sleep(0.02)
        return time.monotonic() - start

    def cpu_ms(self) -> float:
        """What all processes of this browser have taken of the processor."""
        ticks = 0
        for stat in pathlib.Path("/proc").glob("[0-9]*/stat"):
            try:
                fields = stat.read_text().rsplit(") ", 1)[1].split()
            except OSError:
                continue
            # Those of its session.
            if int(fields[3]) == self.program.pid:
                ticks += int(fields[11]) + int(fields[12])
        return ticks * 1000 / os.sysconf("SC_CLK_TCK")

    def timed(self, expression: str, pictures: int) -> tuple[float, float]:
        """The milliseconds that an expression gives for a picture, and those of the processor for each of so many pictures."""
        before = self.cpu_ms()
        wall = self.evaluate(expression)
        return wall, (self.cpu_ms() - before) / pictures

    def picture(self, path: pathlib.Path) -> None:
        path.write_bytes(base64.b64decode(self.call("Page.captureScreenshot", {})["data"]))

    def close(self) -> None:
        os.killpg(self.program.pid, signal.SIGKILL)
        self.program.wait()
        self.folder.cleanup()


# Pictures by the page's own modules, on a device of their own; each waited for.
OURS = """(async () => {
  const [width, height, frames] = SETTINGS;
  const at = (name) => import(new URL(`file/js/${name}`, location.href));
  const [{ open }, { SceneReader }, { Viewer }, source] = await Promise.all(['gpu.js', 'scene.js', 'viewer.js', 'source.js'].map(at));
  const gpu = await open(navigator.gpu);
  const bytes = new Uint8Array(await (await fetch('api/scene/0')).arrayBuffer());
  const reader = new SceneReader(bytes.length);
  reader.push(bytes);
  const scene = await reader.better(Infinity);
  const texts = { train: (name) => source.text(`train/${name}`), own: (name) => source.text(`wgsl/${name}`) };
  const viewer = await Viewer.make(gpu, texts, scene, 'rgba8unorm');
  const usage = GPUTextureUsage.RENDER_ATTACHMENT | GPUTextureUsage.COPY_SRC;
  const target = gpu.device.createTexture({ size: [width, height], format: 'rgba8unorm', usage }).createView();
  const camera = scene.header.cameras[0];
  // Turns about the scene, and time goes on.
  const view = (k) => {
    const [c, s] = [Math.cos(0.03 * k), Math.sin(0.03 * k)];
    return { ...camera, rotation: [[c, 0, s], [0, 1, 0], [-s, 0, c]], near: 0.1 };
  };
  const median = async (run) => {
    const all = [];
    for (let k = -1; k < frames; k++) {
      const from = performance.now();
      await run(Math.max(k, 0));
      await gpu.done();
      if (k >= 0) all.push(performance.now() - from);
    }
    return all.sort((a, b) => a - b)[all.length >> 1];
  };
  const alone = (record) => median(() => { const commands = gpu.commands(); record(commands); commands.submit(); });
  await viewer.prepare({ mode: 'tiles' });
  await viewer.pixels(view(0), 0.5, { mode: 'tiles', near: 0.1 });
  const { projector, motion, quads } = viewer;
  const deltas = motion?.record(gpu.commands(), viewer.scene, 0.5);
  const frame = (mode) => median((k) => viewer.frame(view(k), (0.3 + 0.01 * k) % 1, () => target, { mode, near: 0.1 }));
  globalThis.bench = {
    fast: () => frame('quads'),
    exactly: () => frame('tiles'),
    waiting: () => alone(() => {}),
    motion: () => alone((commands) => motion?.record(commands, viewer.scene, 0.5)),
    projection: () => alone((commands) => projector.record(commands, viewer.scene, deltas)),
    sorting: () => (gpu.onProcessor ? median(() => quads.order()) : alone((commands) => quads.recordOrder(commands))),
  };
  return viewer.tiles.wanted();
})()"""
PARTS = ["fast", "exactly", "waiting", "motion", "projection", "sorting"]

# A peer draws while its camera turns; each picture is waited for by reading a pixel. Of a page that has `gl`, `frames` and
# `draw(k)`, which draws the k-th picture:
TIMED = """
const pixel = new Uint8Array(4);
const once = async (k) => {
  await new Promise(requestAnimationFrame);
  const from = performance.now();
  draw(k);
  gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
  return performance.now() - from;
};
// What is sorted in a worker comes after some pictures.
for (let k = 0; k < 5; k++) { await once(0); await new Promise((done) => { setTimeout(done, 300); }); }
globalThis.bench = async () => {
  const all = [];
  for (let k = -1; k < frames; k++) all.push(await once(Math.max(k, 0)));
  return all.slice(1).sort((a, b) => a - b)[frames >> 1];
};"""
PEER_PAGE = """<!doctype html><meta charset="utf-8"><style>html,body{margin:0}canvas{display:block}</style>
<script type="importmap">{"imports": {"three": "/node_modules/three/build/three.module.js", "three/addons/": "/node_modules/three/examples/jsm/",
  "spark": "/node_modules/@sparkjsdev/spark/dist/spark.module.js", "splats3d": "/node_modules/@mkkellogg/gaussian-splats-3d/build/gaussian-splats-3d.module.js"}}</script>
<body><script type="module">
import * as THREE from 'three';
const [width, height, frames, who] = SETTINGS;
const renderer = new THREE.WebGLRenderer({ antialias: false });
renderer.setPixelRatio(1);
renderer.setSize(width, height);
document.body.append(renderer.domElement);
const camera = new THREE.PerspectiveCamera(2 * Math.atan(height / 2 / (0.8 * width)) * 180 / Math.PI, width / height, 0.1, 100);
// Its axes are right, up, back; those of the scene right, down, forward.
const turn = (k) => {
  const [c, s] = [Math.cos(0.03 * k), Math.sin(0.03 * k)];
  camera.up.set(0, -1, 0);
  // As the page's own cameras turn: what is 3 m before the eye is the origin.
  camera.position.set(3 * s, 0, -3 * c);
  camera.lookAt(0, 0, 0);
  camera.updateMatrixWorld();
};
const gl = renderer.getContext();
let draw;
if (who === 'spark') {
  const { SparkRenderer, SplatMesh } = await import('spark');
  const scene = new THREE.Scene();
  const spark = new SparkRenderer({ renderer });
  scene.add(spark);
  const mesh = new SplatMesh({ url: '/still.ply' });
  await mesh.initialized;
  scene.add(mesh);
  draw = (k) => { turn(k); renderer.render(scene, camera); };
} else {
  const { Viewer, SceneRevealMode } = await import('splats3d');
  const viewer = new Viewer({ selfDrivenMode: false, renderer, camera, useBuiltInControls: false, sharedMemoryForWorkers: false, gpuAcceleratedSort: false, sphericalHarmonicsDegree: 0, sceneRevealMode: SceneRevealMode.Instant });
  await viewer.addSplatScene('/still.ply', { showLoadingUI: false });
  draw = (k) => { turn(k); viewer.update(); viewer.render(); };
}
TIMED
</script>"""

# The peer that plays what moves. It takes the time from the clock.
MOVING_PEER_PAGE = """<!doctype html><meta charset="utf-8"><style>html,body{margin:0}canvas{display:block}</style><body><script type="module">
import * as SPLAT from '/node_modules/gsplat/dist/index.es.js';
const [width, height, frames] = SETTINGS;
const canvas = document.body.appendChild(document.createElement('canvas'));
const renderer = new SPLAT.WebGLRenderer(canvas, []);
renderer.addProgram(new SPLAT.VideoRenderProgram(renderer, []));
renderer.setSize(width, height);
const [scene, camera] = [new SPLAT.Scene(), new SPLAT.Camera()];
camera.data.fx = camera.data.fy = 0.8 * width;
camera.data.setSize(width, height);
await SPLAT.SplatvLoader.LoadAsync('/moving.splatv', scene, null);
const gl = renderer.gl;
const draw = (k) => {
  const [c, s] = [Math.cos(0.03 * k), Math.sin(0.03 * k)];
  camera.position = new SPLAT.Vector3(3 * s, 0, -3 * c);
  camera.rotation = new SPLAT.Quaternion(0, -Math.sin(0.015 * k), 0, Math.cos(0.015 * k));
  // It draws the time sin(now) / 2 + 1 / 2, now in seconds.
  const now = 1000 * Math.asin(2 * ((0.3 + 0.01 * k) % 1) - 1);
  Date.now = () => now;
  renderer.render(scene, camera);
};
TIMED
</script>"""


def served_by_erfgs(erfgs: str, path: pathlib.Path):
    command = [erfgs, "view", str(path), "--address", "127.0.0.1:0", "--no-browser", "--json"]
    program = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    text = ""
    while not text.rstrip().endswith("\n}"):
        line = program.stdout.readline()
        if not line:
            raise SystemExit(f"bench-view.py: {' '.join(command)} ended")
        text += line
    return program, json.loads(text)["link"]


def ours(browser: Browser, arguments, count: int, folder: pathlib.Path) -> None:
    made = cloud(count, count // 5)
    # A program without coarse parts opens files of the first version alone.
    for first in (True,) if arguments.older else (False, True):
        path = folder / f"made{count}{'-first' if first else ''}.e4d"
        raw = scene_file(made, arguments.size, first)
        path.write_bytes(gzip.compress(raw, 6))
        program, link = served_by_erfgs(arguments.erfgs, path)
        kind = "whole at once" if first else "coarse parts first"
        for mbit in (0, arguments.mbit):
            browser.open(f"{link}&renderer=webgpu#t=0.5", mbit)
            early = browser.wait("document.body.dataset.drawn > 0")
            late = early + browser.wait(ALL)
            line = f"{mbit:g} Mbit/s" if mbit else "loopback"
            print(f"{count} Gaussians, {len(raw) / 1e6:.1f} MB, {kind}, {line}: first picture after {early:.1f} s, all after {late:.1f} s", flush=True)
        if not first:
            browser.picture(folder / f"made{count}.png")
            settings = json.dumps([*arguments.size, arguments.frames])
            covered = browser.evaluate(OURS.replace("SETTINGS", settings))
            print(f"{count} Gaussians, {count // 5} move, {'x'.join(map(str, arguments.size))}, {covered} tiles covered; ms (of the processor in brackets):")
            for part in PARTS:
                wall, cpu = browser.timed(f"bench.{part}()", arguments.frames + 1)
                print(f"  {part} {wall:.0f} ({cpu:.0f})", flush=True)
        browser.open("about:blank")
        program.terminate()
        program.wait()


def peers(browser: Browser, arguments, count: int, folder: pathlib.Path) -> None:
    packages = ROOT / "target/bench-view"
    packages.mkdir(parents=True, exist_ok=True)
    stamp = packages / "packages.txt"
    if not stamp.is_file() or stamp.read_text() != "\n".join(PEERS):
        (packages / "package.json").write_text('{"private": true}')
        subprocess.run(["npm", "install", "--silent", "--no-audit", "--no-fund", "--ignore-scripts", *PEERS], cwd=packages, check=True)
        stamp.write_text("\n".join(PEERS))
    size, settings = "x".join(map(str, arguments.size)), [*arguments.size, arguments.frames]

    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *_):
            pass

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=str(packages)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    for who, page in (("spark", PEER_PAGE), ("splats3d", PEER_PAGE), ("gsplat", MOVING_PEER_PAGE)):
        (packages / f"{who}.html").write_text(page.replace("SETTINGS", json.dumps([*settings, who])).replace("TIMED", TIMED))
    for what, moving, others in (("that stand still", 0, ("spark", "splats3d")), ("of which a fifth moves", count // 5, ("gsplat",))):
        made = cloud(count, moving)
        if moving:
            (packages / "moving.splatv").write_bytes(splatv(made))
        else:
            (packages / "still.ply").write_bytes(ply(made))
        path = folder / f"{'moving' if moving else 'still'}.e4d"
        path.write_bytes(gzip.compress(scene_file(made, arguments.size, False), 6))
        program, link = served_by_erfgs(arguments.erfgs, path)
        rounds = {who: [] for who in ("erfgs", *others)}
        # They take turns, for the machine may do other things besides.
        for _ in range(arguments.rounds):
            browser.open(f"{link}&renderer=webgpu#t=0.3")
            browser.wait(ALL)
            browser.evaluate(OURS.replace("SETTINGS", json.dumps(settings)))
            rounds["erfgs"].append(browser.timed("bench.fast()", arguments.frames + 1))
            browser.picture(folder / f"peer-{path.stem}-erfgs.png")
            for who in others:
                browser.open(f"http://127.0.0.1:{server.server_address[1]}/{who}.html")
                browser.wait("globalThis.bench")
                rounds[who].append(browser.timed("bench()", arguments.frames + 1))
                browser.picture(folder / f"peer-{who}.png")
        program.terminate()
        program.wait()
        for who, took in rounds.items():
            wall, cpu = (statistics.median(column) for column in zip(*took))
            print(f"{count} Gaussians {what}, {size}, {who}: {wall:.0f} ms a picture, {cpu:.0f} of the processor", flush=True)
    server.shutdown()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--erfgs", default=str(ROOT / "target/release/erfgs"))
    parser.add_argument("--counts", default="20000,50000")
    parser.add_argument("--size", default="640x360")
    parser.add_argument("--frames", type=int, default=9)
    parser.add_argument("--rounds", type=int, default=3, help="with --peers: how often each has its turn")
    parser.add_argument("--mbit", type=float, default=10)
    parser.add_argument("--older", action="store_true", help="an erfgs that has no coarse parts: how long its page takes to load alone")
    parser.add_argument("--peers", action="store_true")
    parser.add_argument("--out", type=pathlib.Path, help="a folder for pictures of what was drawn")
    arguments = parser.parse_args()
    arguments.size = tuple(map(int, arguments.size.split("x")))
    folder = arguments.out or pathlib.Path(tempfile.mkdtemp())
    folder.mkdir(parents=True, exist_ok=True)
    load = os.getloadavg()[0]
    print(f"{platform.machine()}, {os.cpu_count()} cores, load {load:.1f}; pictures in {folder}", flush=True)
    browser = Browser()
    try:
        for count in map(int, arguments.counts.split(",")):
            ours(browser, arguments, count, folder)
            if arguments.peers:
                peers(browser, arguments, count, folder)
    finally:
        browser.close()


if __name__ == "__main__":
    main()
