#!/usr/bin/env python3
"""What is compiled into a package of the workspace, from what cargo knows: the bill of materials as CycloneDX 1.5 has it (every crate
with version, licence and checksum), and the texts of all licences, which those who pass the program on have to pass on, too.

usage: sbom.py PACKAGE FEATURES VERSION FOLDER    writes PACKAGE-VERSION.cdx.json and THIRD-PARTY.txt
"""

import json
import pathlib
import subprocess
import sys
import tomllib

TARGET = "x86_64-unknown-linux-gnu"


class Materials:
    """The crates that a package is made of, without those of its tests."""

    def __init__(self, package, features):
        run = ["cargo", "metadata", "--locked", "--format-version", "1", "--filter-platform", TARGET, "--features", features]
        told = json.loads(subprocess.run(run, check=True, stdout=subprocess.PIPE).stdout)
        self.packages = {one["id"]: one for one in told["packages"]}
        self.nodes = {node["id"]: node for node in told["resolve"]["nodes"]}
        self.root = next(id for id, one in self.packages.items() if one["name"] == package and one["source"] is None)
        found, waiting = set(), [self.root]
        while waiting:
            id = waiting.pop()
            if id not in found:
                found.add(id)
                waiting += self.needs(id)
        self.others = sorted(found - {self.root}, key=self.reference)
        with open("Cargo.lock", "rb") as lock:
            self.sums = {(one["name"], one["version"]): one.get("checksum") for one in tomllib.load(lock)["package"]}

    def needs(self, id):
        return [of["pkg"] for of in self.nodes[id]["deps"] if any(kind["kind"] != "dev" for kind in of["dep_kinds"])]

    def reference(self, id):
        return f"pkg:cargo/{self.packages[id]['name']}@{self.packages[id]['version']}"

    def component(self, id):
        one = self.packages[id]
        sum = self.sums.get((one["name"], one["version"]))
        licence = {"expression": one["license"].replace("/", " OR ")} if one["license"] else {"license": {"name": one["license_file"]}}
        return {
            "type": "library",
            "bom-ref": self.reference(id),
            "name": one["name"],
            "version": one["version"],
            "purl": self.reference(id),
            "licenses": [licence],
            **({"hashes": [{"alg": "SHA-256", "content": sum}]} if sum else {}),
        }

    def bill(self, version):
        every = [self.root, *self.others]
        return {
            "bomFormat": "CycloneDX",
            "specVersion": "1.5",
            "version": 1,
            "metadata": {"component": {**self.component(self.root), "type": "application", "version": version}},
            "components": [self.component(id) for id in self.others],
            "dependencies": [{"ref": self.reference(id), "dependsOn": sorted(map(self.reference, self.needs(id)))} for id in every],
        }

    def licences(self):
        """Each text once, below the crates that it is of. A crate without one is named with its licence."""
        texts, without = {}, []
        for id in (id for id in self.others if self.packages[id]["source"]):
            one, folder = self.packages[id], pathlib.Path(self.packages[id]["manifest_path"]).parent
            files = [path for path in sorted(folder.iterdir()) if path.name.upper().startswith(("LICEN", "COPYING", "NOTICE", "UNLICENSE"))]
            files += [folder / one["license_file"]] if one["license_file"] else []
            said = {path.read_text(errors="replace").strip() for path in files if path.is_file()}
            name = f"{one['name']} {one['version']}"
            if not said:
                without.append(f"{name}: {one['license']}, {one['repository'] or one['homepage']}")
            for text in said:
                texts.setdefault(text, []).append(name)
        for text, names in sorted(texts.items(), key=lambda entry: entry[1]):
            yield "\n".join([", ".join(names), "=" * 100, text, "", ""])
        yield "\n".join(["Crates without a text of their own:", *without, ""])


def main(package, features, version, folder):
    materials = Materials(package, features)
    folder = pathlib.Path(folder)
    (folder / f"{package}-{version}.cdx.json").write_text(json.dumps(materials.bill(version), indent=1) + "\n")
    (folder / "THIRD-PARTY.txt").write_text("\n".join(materials.licences()))


if len(sys.argv) != 5:
    sys.exit(__doc__)
main(*sys.argv[1:])
