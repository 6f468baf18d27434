"""Event cameras that look at videos."""

from __future__ import annotations

from typing import Any, Iterable, List, Literal, Optional, Union

import numpy as np
from numpy.typing import NDArray

from . import _erfgs
from ._types import EVENT_DTYPE


def simulate(
    frames: Iterable[NDArray[Any]],
    fps: float,
    preset: Literal["noiseless", "clean", "noisy"] = "noiseless",
    *,
    seed: int = 0,
    camera: str = "",
    **parameters: Union[float, bool, str],
) -> NDArray[np.void]:
    """The events of a camera that looks at a video, `fps` frames a second: a structured array of `EVENT_DTYPE`, whose times begin with 0 at
    the first frame.

    frames: an array of shape (n, height, width), or with colours (n, height, width, 3), or anything that gives them one by one, as
    `Simulator.step` takes them; one frame at a time is held. Preset, seed, camera and parameters are those of `Simulator`.
    """
    if not 1e-3 <= fps <= 1e6:
        raise ValueError(f"{fps} frames a second: a rate from 0.001 to 1000000 is needed")
    sensor: Optional[_erfgs.Simulator] = None
    events: List[NDArray[np.void]] = [np.empty(0, EVENT_DTYPE)]
    for index, frame in enumerate(frames):
        if sensor is None:
            shape = np.shape(frame)
            if len(shape) not in (2, 3):
                raise ValueError(f"frames have shape (height, width) or (height, width, 3); the first one has {shape}")
            height, width = shape[:2]
            sensor = _erfgs.Simulator(width, height, preset, seed=seed, camera=camera, **parameters)
        events.append(sensor.step(frame, index * 1e6 / fps))
    # Without an array to write to, NumPy leaves out the padding of rows.
    return np.concatenate(events, out=np.zeros(sum(map(len, events)), EVENT_DTYPE))
