"""What all cameras of a session saw, slice by slice on one clock.

usage: slices.py TAKE.mcap [MILLISECONDS]
"""

import sys

import erfgs


def main(path: str, milliseconds: str = "50") -> None:
    with erfgs.open(path) as session:
        for id, stream in session.streams.items():
            if stream.kind != "trigger":
                clock = session.clock(id)
                print(f"{id}: {clock.tier}, 95 of 100 samples within {clock.p95:.1f} µs")
        for part in session.slices(dt=int(float(milliseconds) * 1000)):
            events = ", ".join(f"{id} {len(found)}" for id, found in part.events.items())
            frames = ", ".join(f"{id} {frame.t / 1000:.1f} ms" for id, taken in part.frames.items() for frame in taken)
            print(f"{part.start / 1000:8.1f} ms: events {events}; frames {frames or 'none'}")


if __name__ == "__main__":
    main(*sys.argv[1:])
