"""Fetches recordings of real event cameras that the tests decode: those that the source package of faery carries.

usage: recordings.py FOLDER

faery (https://github.com/neuromorphicsystems/faery) is under the LGPL 3; its files are fetched, not redistributed: an EVK4's
EVT 3, a generation 3 sensor's EVT 2, the former as DAT, a DAVIS346's AEDAT 4, and two small AEDAT 4 files with frames of 16 bits.
The tests compare with the digests that faery's own tests state (session/tests/codecs/digests.json).
"""

import hashlib
import io
import os
import pathlib
import re
import sys
import tarfile
import time
import urllib.parse
import urllib.request

from pip._internal.models.index import PyPI

PACKAGE = "faery-0.7.1"
SHA256 = "15ddf16d927d6b7c88c1e8b9adb72fe17dc17d08f6ac81f7404ec4d5e9528e56"
FILES = [
    "davis346.aedat4",
    "evt2.raw",
    "evt3.raw",
    "gen4.dat",
    "test_data_gray16.aedat4",
    "test_data_unknown_then_gray16.aedat4",
]


def get(url, tries=3):
    try:
        with urllib.request.urlopen(url, timeout=180) as answer:
            return answer.read()
    except OSError as error:
        if tries == 1:
            sys.exit(f"recordings.py: cannot fetch {url}: {error}")
        time.sleep(5)
        return get(url, tries - 1)


def main(folder):
    folder = pathlib.Path(folder)
    if all((folder / name).is_file() for name in FILES):
        return
    index = os.environ.get("PIP_INDEX_URL", PyPI.simple_url).rstrip("/") + "/faery/"
    link = re.search(rf'href="([^"]*{re.escape(PACKAGE)}\.tar\.gz[^"]*)"', get(index).decode())
    if not link:
        sys.exit(f"recordings.py: {index} has no {PACKAGE}.tar.gz")
    package = get(urllib.parse.urljoin(index, link[1]))
    if hashlib.sha256(package).hexdigest() != SHA256:
        sys.exit(f"recordings.py: {PACKAGE}.tar.gz is not the file that the tests were written for")
    folder.mkdir(parents=True, exist_ok=True)
    with tarfile.open(fileobj=io.BytesIO(package)) as archive:
        for name in FILES:
            data = archive.extractfile(f"{PACKAGE}/tests/data/{name}").read()
            part = folder / (name + ".part")
            part.write_bytes(data)
            part.rename(folder / name)


main(sys.argv[1])
