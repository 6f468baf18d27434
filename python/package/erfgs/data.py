"""Recordings as map-style datasets, which a `torch.utils.data.DataLoader` with workers takes as they are."""

from __future__ import annotations

import os
from typing import Any, Callable, Dict, Generic, List, Optional, Tuple, TypeVar, Union, overload

from . import _erfgs
from ._types import Slice

T = TypeVar("T")


class SliceDataset(Generic[T]):
    """Slices of a recording by their number: `dataset[i]` is what the cameras saw in the i-th stretch of `dt` microseconds.

    Each process opens the file for itself when it first reads, so that the dataset pickles as its arguments; `transform` must pickle,
    too, for workers that are not forked. A session is read from the last stored state of its decoders on. Event files of other
    programs are read from their beginning for each slice: make a session of a long one (`erfgs import`).
    """

    @overload
    def __init__(
        self: SliceDataset[Slice],
        path: Union[str, os.PathLike[str]],
        dt: int,
        streams: Optional[List[str]] = ...,
        start: Optional[int] = ...,
        end: Optional[int] = ...,
        *,
        transform: None = ...,
        depth: int = ...,
        bits: Optional[int] = ...,
    ) -> None: ...

    @overload
    def __init__(
        self,
        path: Union[str, os.PathLike[str]],
        dt: int,
        streams: Optional[List[str]] = ...,
        start: Optional[int] = ...,
        end: Optional[int] = ...,
        *,
        transform: Callable[[Slice], T],
        depth: int = ...,
        bits: Optional[int] = ...,
    ) -> None: ...

    def __init__(
        self,
        path: Union[str, os.PathLike[str]],
        dt: int,
        streams: Optional[List[str]] = None,
        start: Optional[int] = None,
        end: Optional[int] = None,
        *,
        transform: Optional[Callable[[Slice], T]] = None,
        depth: int = 8,
        bits: Optional[int] = None,
    ) -> None:
        if dt <= 0:
            raise ValueError(f"slices of {dt} µs hold nothing: give a length above 0")
        self.path = os.fspath(path)
        self.dt = dt
        self.streams = streams
        self.transform = transform
        self.depth = depth
        self.bits = bits
        self._open: Optional[Tuple[int, _erfgs.Recording]] = None
        self.start = 0 if start is None else start
        self.end = self._recording().duration + 1 if end is None else end

    def _recording(self) -> _erfgs.Recording:
        """The recording, opened by this process: a fork's parent and child must not share a file's position."""
        if self._open is None or self._open[0] != os.getpid():
            self._open = (os.getpid(), _erfgs.open(self.path))
        return self._open[1]

    def __len__(self) -> int:
        return max(0, -(-(self.end - self.start) // self.dt))

    def __getitem__(self, index: int) -> T:
        if not -len(self) <= index < len(self):
            raise IndexError(f"{self.path} has {len(self)} slices of {self.dt} µs, and none of index {index}")
        start = self.start + (index % len(self)) * self.dt
        end = min(start + self.dt, self.end)
        found: Any = self._recording().slice(start, end, self.streams, depth=self.depth, bits=self.bits)
        return self.transform(found) if self.transform else found

    def __getstate__(self) -> Dict[str, Any]:
        return {**self.__dict__, "_open": None}
