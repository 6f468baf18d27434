#!/usr/bin/env python3
"""Compare the decoding of event files with faery and expelliarmus, on one core, in one run.

usage: scripts/bench-decode.py [--erfgs BINARY] [--runs N] [--rounds N] [EVT3.raw EVT2.raw DAVIS.aedat4 ...]

A dense EVT 3 file is made besides, and measured after them: vectors alone, 0.7 words for each event, as a sensor sends them that sees
much at once. The first file of all and the dense one are also measured as AEDAT 4, which expelliarmus
does not read.

The three take turns; for each the fastest CPU time counts (wall time on a busy machine measures its neighbours). faery and
expelliarmus come from PyPI into target/bench-decode. They read the files from the page cache, erfgs from memory.
"""

import argparse
import array
import json
import pathlib
import random
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
PACKAGES = ["faery==0.7.1", "expelliarmus==1.1.12"]

OTHERS = r"""
import json, sys, time
tool, path, runs = sys.argv[1], sys.argv[2], int(sys.argv[3])
kind = "evt2" if b"evt 2.0" in open(path, "rb").read(4096) else "evt3"
if tool == "faery":
    import faery
    size = (640, 480) if kind == "evt2" else (1280, 720)
    def decode():
        return sum(len(events) for events in faery.events_stream_from_file(path, dimensions_fallback=size))
else:
    from expelliarmus import Wizard
    wizard = Wizard(encoding=kind)
    def decode():
        return len(wizard.read(path))
best = float("inf")
for _ in range(runs):
    start = time.process_time()
    events = decode()
    best = min(best, time.process_time() - start)
print(json.dumps({"events": events, "Mev_per_s": events / best * 1e-6}))
"""


def environment() -> str:
    folder = ROOT / "target/bench-decode"
    python = folder / "bin/python"
    stamp = folder / "packages.txt"
    if not stamp.is_file() or stamp.read_text() != "\n".join(PACKAGES):
        subprocess.run([sys.executable, "-m", "venv", "--clear", folder], check=True)
        command = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *PACKAGES]
        subprocess.run(command, check=True)
        stamp.write_text("\n".join(PACKAGES))
    return str(python)


def dense() -> str:
    """Makes a RAW file of EVT 3 whose events lie in vectors: 3 million words, the same each time."""
    path = ROOT / "target/bench-decode/dense.raw"
    if path.is_file():
        return str(path)
    pick = random.Random(15)
    words, high = array.array("H"), None
    for step in range(4200):
        t = 1000 + 37 * step
        if t >> 12 != high:
            high = t >> 12
            words.append(0x8000 | high & 0xFFF)
        words.append(0x6000 | t & 0xFFF)
        for _ in range(16):
            words.append(pick.randrange(720))
            for block in sorted(pick.sample(range(40), 10)):
                words.append(0x3000 | pick.getrandbits(1) << 11 | 32 * block)
                mask = pick.getrandbits(32) & pick.getrandbits(32) & (pick.getrandbits(32) | pick.getrandbits(32))
                words.extend((0x4000 | mask & 0xFFF, 0x4000 | mask >> 12 & 0xFFF, 0x5000 | mask >> 24))
    if sys.byteorder == "big":
        words.byteswap()
    header = "% evt 3.0\n% format EVT3;height=720;width=1280\n% geometry 1280x720\n% end\n"
    path.write_bytes(header.encode() + words.tobytes())
    return str(path)


def aedat4(erfgs: str, path: str) -> str:
    """The same events as AEDAT 4."""
    copy = ROOT / "target/bench-decode" / (pathlib.Path(path).stem + ".aedat4")
    subprocess.run([erfgs, "export", path, "--to", "aedat4", "--out", copy, "--force"], check=True, capture_output=True)
    return str(copy)


def figures(command: list) -> dict:
    return json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--erfgs", default=str(ROOT / "target/release/erfgs"), help="the program to measure")
    parser.add_argument("--runs", type=int, default=15, help="runs of each tool in a round")
    parser.add_argument("--rounds", type=int, default=3, help="how often the tools take turns")
    parser.add_argument("files", nargs="*", help="RAW files with EVT 2 or EVT 3, AEDAT 4 files")
    arguments = parser.parse_args()
    python, runs = environment(), str(arguments.runs)
    heading = ["file", "events", "erfgs", "faery", "expelliarmus", "/ faery", "/ expelliarmus"]
    print("Mev/s on one core\n\n| " + " | ".join(heading) + " |\n|" + "---|" * len(heading))
    files = [*arguments.files, dense()]
    copies = [aedat4(arguments.erfgs, path) for path in dict.fromkeys([files[0], files[-1]]) if not path.endswith(".aedat4")]
    for path in files + copies:
        commands = {
            "erfgs": [arguments.erfgs, "bench", "decode", path, "--json", "--runs", runs],
            "faery": [python, "-c", OTHERS, "faery", path, runs],
            "expelliarmus": [python, "-c", OTHERS, "expelliarmus", path, runs],
        }
        if path.endswith(".aedat4"):
            del commands["expelliarmus"]
        speed, events = dict.fromkeys(commands, 0.0), {}
        for _ in range(arguments.rounds):
            for tool, command in commands.items():
                found = figures(command)
                speed[tool] = max(speed[tool], found["Mev_per_s"])
                events[tool] = found["events"]
        if len(set(events.values())) != 1:
            sys.exit(f"bench-decode.py: the tools disagree on the number of events: {events}")
        tools = ("erfgs", "faery", "expelliarmus")
        rates = [f"{speed[tool]:.0f}" if tool in speed else "" for tool in tools]
        ratios = [f"{speed['erfgs'] / speed[tool]:.2f}" if tool in speed else "" for tool in tools[1:]]
        cells = [pathlib.Path(path).name, f"{events['erfgs']:,}", *rates, *ratios]
        print("| " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
