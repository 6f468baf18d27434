"""Trainings from Python: followed, stopped, gone on with, and refused."""

import logging
import os
import signal
import subprocess
import sys
import textwrap

import pytest

import erfgs

SHORT = {"iterations": "40+160", "motion": "free-time", "seed": 3}


@pytest.fixture(autouse=True)
def on_the_path(programs, monkeypatch):
    monkeypatch.setenv("PATH", f"{programs}{os.pathsep}{os.environ['PATH']}")


def test_a_training_is_followed_to_its_end(trained, tmp_path, caplog):
    film, _ = trained
    seen = []
    with caplog.at_level(logging.INFO, logger="erfgs"):
        done = erfgs.train(film, tmp_path / "run", callback=seen.append, settings={"density.max_gaussians": 4000}, **SHORT)
    assert done.run == tmp_path / "run" and done.figures["iterations"] == 200 and done.figures["finished"]
    assert "max_gaussians = 4000" in (tmp_path / "run/config.toml").read_text()
    shares = [now.share for now in seen if now.task == "training"]
    assert len(shares) > 3 and shares == sorted(shares) and shares[-1] == 1.0
    last = seen[-1].values
    assert last["iteration"] == last["iterations"] == 200 and last["stage"] == "fine" and last["gaussians"] > 500
    assert any((now.values.get("psnr") or 0) > 10 for now in seen) and done.figures["psnr"] > 10
    assert "Gaussians" in seen[-1].text and any("memory" in line for line in caplog.messages), caplog.messages
    scene = erfgs.Scene.open(done.run)
    assert scene.count == done.figures["gaussians"] and scene.render("rgb00", 50_000).image.std() > 5


def test_a_callback_that_fails_stops_a_training_which_goes_on_from_there(trained, tmp_path):
    film, _ = trained
    run = tmp_path / "run"

    def half(now):
        if now.task == "training" and now.share > 0.4:
            raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        erfgs.train(film, run, callback=half, **SHORT)
    with pytest.raises(ValueError, match="holds a run already"):
        erfgs.train(film, run, **SHORT)
    first = []
    done = erfgs.train(film, run, resume=True, callback=first.append, **SHORT)
    begun = [now.values["iteration"] for now in first if now.task == "training"]
    assert begun[0] > 60 and done.figures["iterations"] == 200
    assert erfgs.train(film, run, resume=True, **SHORT).figures["iterations"] == 200


def test_ctrl_c_saves_a_checkpoint(trained, tmp_path):
    film, _ = trained
    program = """
        import signal, sys, erfgs
        # What is started in the background is often started with it ignored.
        signal.signal(signal.SIGINT, signal.default_int_handler)
        tell = lambda now: now.task == "training" and now.share > 0.01 and print("begun", flush=True)
        try:
            erfgs.train(sys.argv[1], sys.argv[2], callback=tell, iterations="40+20000", motion="free-time")
        except KeyboardInterrupt:
            print("interrupted")
    """
    command = [sys.executable, "-c", textwrap.dedent(program), film, tmp_path / "run"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout.readline() == "begun\n"
        child.send_signal(signal.SIGINT)
        output, _ = child.communicate(timeout=120)
        assert output.splitlines()[-1] == "interrupted"
    assert child.returncode == 0 and (tmp_path / "run/checkpoint.bin").is_file()


def test_what_is_refused_says_so_in_the_words_of_the_program(trained, tmp_path, monkeypatch):
    film, _ = trained
    for error, message, dataset, options in (
        (ValueError, "unexpected argument '--itertions'", film, {"itertions": 5}),
        (ValueError, "invalid value 'best'", film, {"method": "best"}),
        (ValueError, "density.most", film, {"settings": {"density.most": 5}}),
        (erfgs.Error, "nothing-here", tmp_path / "nothing-here", {}),
    ):
        with pytest.raises(error, match=message):
            erfgs.train(dataset, tmp_path / "refused", **options)
    assert not (tmp_path / "refused/checkpoint.bin").exists()
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(erfgs.Error, match="nor on the PATH"):
        erfgs.train(film, tmp_path / "run")
    other = tmp_path / "erfgs"
    other.write_text("#!/bin/sh\necho erfgs 9.9.9\n")
    other.chmod(0o755)
    with pytest.raises(erfgs.Error, match="version 9.9.9, and this module of"):
        erfgs.train(film, tmp_path / "run")
