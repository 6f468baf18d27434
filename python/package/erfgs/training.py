"""Trainings by the program `erfgs`, followed from Python."""

from __future__ import annotations

import json
import logging
import os
import shutil
import subprocess
import sysconfig
import tempfile
from pathlib import Path
from typing import Any, Callable, Dict, Iterator, List, Mapping, NamedTuple, Optional, Union

from ._erfgs import Error, __version__

LOG = logging.getLogger("erfgs")


class Training(NamedTuple):
    """Where a training stands."""

    task: str
    """What is done: "training", or before it for example the trial of bodies."""
    share: float
    """How much of the task is done, 0 to 1."""
    text: str
    """The same as a line for people, without the time left."""
    values: Dict[str, Any]
    """Of the training itself: stage, iteration, iterations, seconds, cpu_seconds, gaussians, dynamic (Gaussians that move), and where they were
    just measured loss_rgb, loss_event, psnr, dpsnr (dB, held-out cameras); else None."""


class Trained(NamedTuple):
    """How a training ended."""

    run: Path
    """The run's folder, for `Scene.open`."""
    figures: Dict[str, Any]
    """What `erfgs train --json` prints: iterations, train_seconds, cpu_seconds, gaussians, psnr, dpsnr (dB, at the last look) and more."""


def program() -> str:
    """The program of this version: that of this wheel, else the first on the PATH."""
    beside = Path(sysconfig.get_path("scripts"), "erfgs")
    found = str(beside) if beside.is_file() else shutil.which("erfgs")
    if found is None:
        raise Error(f"the program erfgs is neither {beside} nor on the PATH: install the wheel of a release, or build it (`cargo install --path .`)")
    words = subprocess.run([found, "--version"], capture_output=True, text=True, check=False).stdout.split()
    if words[:2] != ["erfgs", __version__]:
        raise Error(f"{found} is of version {' '.join(words[1:2]) or 'none'}, and this module of {__version__}: install both of one version")
    return found


def train(
    dataset: Union[str, os.PathLike[str]],
    out: Union[str, os.PathLike[str]],
    *,
    callback: Optional[Callable[[Training], Any]] = None,
    resume: bool = False,
    settings: Optional[Mapping[str, Any]] = None,
    **options: Union[str, float, bool, None],
) -> Trained:
    """Trains a dynamic scene from a dataset into the folder `out` by the program `erfgs train`, and waits for its end.

    callback is called up to five times a second and at each look at held-out cameras. Ctrl-C, and an exception of the callback, stop the
    training, which saves a checkpoint first: the same call with resume=True goes on from there, or begins where there is none.

    options are those of the program, with underscores: method="4dgs", motion="bodies", iterations="600+4000", minutes=3, cpu_minutes=3,
    seed=1, deterministic=True, adapter="llvmpipe" and others (`erfgs train --help`). settings are single ones of the configuration:
    {"density.max_gaussians": 100_000}. Its remarks go to the logger "erfgs".
    """
    command = [program(), "train", os.fspath(dataset), "--out", os.fspath(out), "--json", "--progress", "json"]
    command += words({"resume": resume, **options})
    command += [f"--set={name}={literal(value)}" for name, value in (settings or {}).items()]
    with tempfile.TemporaryFile("w+", encoding="utf-8") as figures:
        # In a group of its own, so that Ctrl-C stops it once: a second one would end it without a checkpoint.
        child = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=figures,
            stderr=subprocess.PIPE,
            encoding="utf-8",
            errors="replace",
            start_new_session=True,
        )
        with child:
            try:
                remarks = list(follow(child, callback))
            except BaseException:
                stop(child)
                raise
        refuse(child.returncode, remarks)
        figures.seek(0)
        return Trained(Path(out), json.load(figures))


def words(options: Mapping[str, Any]) -> Iterator[str]:
    """Options as the program takes them."""
    for name, value in options.items():
        option = "--" + name.replace("_", "-")
        if value is True:
            yield option
        elif value is not None and value is not False:
            yield f"{option}={os.fspath(value) if isinstance(value, os.PathLike) else value}"


def literal(value: Any) -> str:
    """A setting as TOML has it."""
    if isinstance(value, str):
        return value
    return json.dumps(value)


def follow(child: subprocess.Popen[str], callback: Optional[Callable[[Training], Any]]) -> Iterator[str]:
    """Tells the callback of the progress, and gives what else the program says."""
    assert child.stderr is not None
    for line in child.stderr:
        if line.startswith('{"progress":'):
            progress = json.loads(line)["progress"]
            if callback is not None:
                callback(Training(**{"values": {}, **progress}))
        elif line.strip():
            LOG.info(line.rstrip())
            yield line.rstrip()


def stop(child: subprocess.Popen[str]) -> None:
    """Asks the program to save a checkpoint and to end, and waits for it, unless whoever waits interrupts once more."""
    child.terminate()
    try:
        child.communicate()
    except BaseException:
        child.kill()
        raise


def refuse(code: int, remarks: List[str]) -> None:
    """Raises what ended a training that did not come to its end, in its own words."""
    if code == 0:
        return
    at = next((at for at, line in enumerate(remarks) if line.startswith("error: ")), max(len(remarks) - 1, 0))
    message = "\n".join(line for line in remarks[at:] if not line.startswith("  see `erfgs")).replace("error: ", "", 1)
    if code == 2:
        raise ValueError(message)
    raise Error(message or f"the training ended with code {code}")
