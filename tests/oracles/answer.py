"""Answers a list of questions to the oracles: reads JSON from a file, writes JSON to another.

    python answer.py QUESTIONS.json ANSWERS.json

A question names its oracle under "oracle": raster, field, event, motion or bodies. All arithmetic is float64.
"""

import json
import sys

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np  # noqa: E402

import bodies  # noqa: E402
import event  # noqa: E402
import field  # noqa: E402
import motion  # noqa: E402
import raster  # noqa: E402

ORACLES = {"raster": raster.run, "field": field.run, "event": event.run, "motion": motion.run, "bodies": bodies.run}


def plain(value):
    if isinstance(value, dict):
        return {key: plain(entry) for key, entry in value.items()}
    return np.asarray(value).ravel().tolist()


def main():
    with open(sys.argv[1], encoding="utf-8") as file:
        questions = json.load(file)
    answers = [plain(ORACLES[question["oracle"]](question)) for question in questions]
    with open(sys.argv[2], "w", encoding="utf-8") as file:
        json.dump(answers, file)


if __name__ == "__main__":
    main()
