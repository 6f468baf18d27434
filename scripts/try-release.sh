#!/usr/bin/env bash
# Installs a release on a bare Debian 12, in a folder that debootstrap fills, uses it and takes it off again: the tarball, the Debian
# package and the wheel, each alone. Needs root, and the package sources of this machine.
# usage: scripts/try-release.sh FOLDER    what scripts/release.sh made
set -euo pipefail
cd "$(dirname "$0")/.."

fail() { echo "try-release.sh: $1" >&2; exit "${2:-1}"; }
[ $# = 1 ] && [ "$1" != -h ] && [ "$1" != --help ] || { sed -n '2,4p' "$0" | cut -c3-; [ $# = 1 ] && exit 0 || exit 2; }
made=$(cd "$1" && pwd)
[ "$(id -u)" = 0 ] || fail "only root can make a bare Debian: sudo scripts/try-release.sh $1"
command -v debootstrap >/dev/null || fail "debootstrap is missing: apt-get install debootstrap"
(cd "$made" && sha256sum --check --quiet SHA256SUMS) || fail "a file is not the one that SHA256SUMS is of"

mirror=$(apt-get indextargets --format '$(RELEASE) $(REPO_URI)' 'Created-By: Packages' | awk '$1 == "bookworm" { print $2; exit }')
[ -n "$mirror" ] || fail "none of this machine's apt sources is Debian 12 (bookworm)"
kept=${CARGO_TARGET_DIR:-$PWD/target}/bare-bookworm
if [ ! -e "$kept.tar" ]; then
  debootstrap --variant=minbase bookworm "$kept" "$mirror" >"$kept.log" || fail "debootstrap failed: $kept.log"
  tar -C "$kept" -cf "$kept.part" . && mv "$kept.part" "$kept.tar"
  rm -rf "$kept"
fi

# A namespace of its own: what is mounted in it and what runs in it ends with it. The network is that of this machine.
bare=$(mktemp -d)
trap 'rm -rf "$bare"' EXIT
inside() { unshare --mount --pid --fork --mount-proc="$bare/proc" chroot "$bare" env -i PATH=/usr/local/bin:/usr/bin:/bin:/usr/sbin:/sbin HOME=/root DEBIAN_FRONTEND=noninteractive bash -euo pipefail -c "$1"; }
fresh() {
  find "$bare" -mindepth 1 -delete
  tar -C "$bare" -xf "$kept.tar"
  mknod -m 666 "$bare/dev/null" c 1 3 2>/dev/null || true
  cp /etc/resolv.conf /etc/hosts "$bare/etc/"
  mkdir -p "$bare/made" && cp "$made"/* "$bare/made/"
  {
    echo t,x,y,on
    for ((n = 0; n < 3000; n++)); do echo "$((1000 + 100 * n)),$((n % 64)),$((n % 48)),$((n % 2))"; done
  } >"$bare/made/events.csv"
}

# The version, the smallest replay, and a conversion with each of the formats that need a library.
use='erfgs --version
  erfgs replay /made/events.csv --speed max --json | grep -q "\"events\"\|\"packets\"\|\"bytes\""
  erfgs export /made/events.csv --to h5 --out /tmp/again.h5 >/dev/null && erfgs info /tmp/again.h5 --json | grep -q 3000'
gone='if command -v erfgs; then echo "erfgs is still there" >&2; exit 1; fi'

echo "== the Debian package"
fresh
inside "apt-get update -qq; apt-get install -y -qq --no-install-recommends /made/erfgs_*_amd64.deb >/dev/null
  $use
  test -e /usr/lib/udev/rules.d/60-erfgs.rules; test -e /usr/share/bash-completion/completions/erfgs
  test \$(ls /usr/share/man/man1/erfgs*.1.gz | wc -l) -gt 20
  apt-get purge -y -qq erfgs >/dev/null; hash -r; $gone
  test ! -e /usr/share/doc/erfgs && test ! -e /usr/lib/udev/rules.d/60-erfgs.rules"

echo "== the tarball"
fresh
inside "apt-get update -qq; apt-get install -y -qq --no-install-recommends libusb-1.0-0 >/dev/null
  tar -xzf /made/erfgs-*-x86_64-linux.tar.gz -C /opt; export PATH=\$(echo /opt/erfgs-*/bin):\$PATH
  $use
  rm -r /opt/erfgs-*; hash -r; $gone"

echo "== the wheel"
fresh
inside "apt-get update -qq; apt-get install -y -qq --no-install-recommends libusb-1.0-0 python3-venv >/dev/null"
# NumPy comes from this machine's index, which a bare Debian does not know.
python3 -m pip download --quiet --disable-pip-version-check --dest "$bare/made" --python-version 3.11 --only-binary :all: 'numpy>=1.21'
inside "python3 -m venv /opt/venv; export PATH=/opt/venv/bin:\$PATH
  pip install --quiet --no-index --find-links /made /made/erfgs-*.whl
  $use
  cd /tmp && python -c 'import erfgs; events = erfgs.open(\"/made/events.csv\")[\"events\"].events(); assert len(events) == 3000, events'
  pip uninstall -y -q erfgs; hash -r; $gone
  if python -c 'import erfgs' 2>/dev/null; then echo 'the module is still there' >&2; exit 1; fi"
echo "try-release.sh: tarball, Debian package and wheel were installed, used and taken off on a bare Debian 12"
