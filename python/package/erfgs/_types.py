"""What the reading of recordings gives: named tuples, which pickle."""

from __future__ import annotations

from typing import Any, Dict, List, NamedTuple, Optional, Tuple

import numpy as np
from numpy.typing import NDArray

EVENT_DTYPE = np.dtype(
    {
        "names": ["x", "y", "p", "t"],
        "formats": ["<u2", "<u2", "<i2", "<i8"],
        "offsets": [0, 2, 4, 8],
        "itemsize": 16,
    }
)
"""An event as Metavision lays it out: column, row, polarity (1 for a rise, 0 for a fall), time (microseconds)."""


class Frame(NamedTuple):
    """A frame and when it was taken."""

    image: NDArray[Any]
    """(height, width) of grey cameras, else (height, width, 3): red, green, blue; uint8, or uint16 with depth=16."""
    t: int
    """The middle of the exposure, microseconds of session time."""
    exposure: Optional[Tuple[int, int]]
    """When the exposure began and ended, microseconds of session time; None where nothing tells its length."""
    sequence: int
    """The number of the packet that it came in."""


class FrameTime(NamedTuple):
    """When a frame of a dataset was taken."""

    t: int
    """The time that the frame is labelled with, microseconds."""
    exposure: Tuple[int, int]
    """When the exposure began and ended, microseconds; equal where the frame is an instant."""


class Slice(NamedTuple):
    """What cameras saw in a stretch of time."""

    start: int
    """Where it begins, microseconds of session time."""
    end: int
    """Where it ends, microseconds of session time; the end belongs to the next slice."""
    events: Dict[str, NDArray[Any]]
    """The events of each stream that has them: structured arrays of EVENT_DTYPE, in the order of t."""
    frames: Dict[str, List[Frame]]
    """The frames of each stream that has them, in the order of t."""


class Rendering(NamedTuple):
    """What a camera sees of a reconstruction."""

    image: NDArray[np.uint8]
    """(height, width, 3): red, green, blue over the run's background, encoded for display (sRGB)."""
    opacity: NDArray[np.float32]
    """(height, width): how much of the background is covered, 0 to 1."""
    depth: NDArray[np.float32]
    """(height, width): mean depth along the optical axis by opacity, metres; 0 where nothing is."""


class Gaussians(NamedTuple):
    """The Gaussians of a reconstruction at an instant, as gsplat takes them."""

    means: NDArray[np.float32]
    """(n, 3): centres in the world, metres."""
    quaternions: NDArray[np.float32]
    """(n, 4): rotations of their axes, w, x, y, z, of length 1."""
    scales: NDArray[np.float32]
    """(n, 3): standard deviations along their axes, metres."""
    opacities: NDArray[np.float32]
    """(n,): 0 to 1."""
    harmonics: NDArray[np.float32]
    """(n, k, 3): coefficients of the spherical harmonics of red, green, blue: 1, 4, 9 or 16, those of degree 0 first. Their sum and 0.5 are the
    colour in the direction from the camera, encoded for display."""
