"""Sessions of several frame and event cameras on one clock, calibrated rigs, datasets and reconstructions, as NumPy arrays.

    import erfgs

    with erfgs.open("take.mcap") as session:
        for part in session.slices(dt=10_000):
            print(part.start, len(part.events["ev0"]), len(part.frames["rgb0"]))

Every time is in microseconds. Those of a recording begin with it and are the same for all of its streams.
Files that are refused raise `Error`, with what to do about it; what is passed over is told by a `DamageWarning`.
"""

from ._erfgs import (
    Camera,
    Clock,
    ClockPart,
    DamageWarning,
    Dataset,
    DatasetCamera,
    Error,
    FrameIterator,
    Recording,
    Rig,
    Scene,
    Simulator,
    SliceIterator,
    Stream,
    __version__,
    open,
)
from ._types import EVENT_DTYPE, Frame, FrameTime, Gaussians, Rendering, Slice
from .data import SliceDataset
from .training import Trained, Training, train
from .video import simulate

__all__ = [
    "EVENT_DTYPE",
    "Camera",
    "Clock",
    "ClockPart",
    "DamageWarning",
    "Dataset",
    "DatasetCamera",
    "Error",
    "Frame",
    "FrameIterator",
    "FrameTime",
    "Gaussians",
    "Recording",
    "Rendering",
    "Rig",
    "Scene",
    "Simulator",
    "Slice",
    "SliceDataset",
    "SliceIterator",
    "Stream",
    "Trained",
    "Training",
    "__version__",
    "open",
    "simulate",
    "train",
]
